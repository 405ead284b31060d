"""`insole model`: show and switch the model that a running daemon uses."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

import typer

from ..config import DEFAULT_ENDPOINT
from .options import Connect, RigName, Which, ZenohFile, name_next
from .tables import fold


class Model(StrEnum):
    """The curves alone, or with compensation of effects."""

    static = "static"
    dynamic = "dynamic"


def model(
    switch: Annotated[Model | None, typer.Argument(help="Model to use; without it, nothing changes.")] = None,
    foot: Annotated[Which, typer.Option("--foot", help="Insole to list or switch.")] = Which.both,
    rig: RigName = "*",
    connect: Connect = DEFAULT_ENDPOINT,
    zenoh_config: ZenohFile = None,
) -> None:
    """List the effects of a calibration, and switch their compensation on or off until the daemon restarts."""
    from ..errors import WireError
    from ..wire.client import Client

    with Client(connect, rig, zenoh_config) as insole:
        published = [name for _, name in insole.feet()]
        feet = [name for name in ("left", "right") if name in published and foot in (Which.both, name)]
        if not feet:
            raise WireError(f"no daemon behind {connect} has the foot that is meant ({foot.value})")
        for name in feet:
            reply = insole.request(name, "model", do="tell" if switch is None else switch.value)
            print("\n".join(fold(line, 4) for line in _reply_lines(reply)), flush=True)
    name_next("insole view --open" if switch is not None else "insole model static, or dynamic: switches")


def _reply_lines(reply: dict[str, Any]) -> list[str]:
    """Format the reply of one foot as lines."""
    lines = [f"{reply['foot']}: {reply['model']} model of {reply['calibration']}"]
    lines += [f"  loads are {reply['late_ms']:.0f} ms older than their frames"] if reply["late_ms"] else []
    for effect in reply["effects"]:
        where = "the whole insole" if effect["scope"] == "insole" else f"{len(effect['ids'])} × {effect['scope']}"
        lines.append(
            f"  {effect['effect']}, {where}" + (f": left out, {effect['left_out']}" if effect["left_out"] else "")
        )
    return lines if reply["effects"] else [*lines, "  no effects: nothing to switch"]
