"""`insole model`: which model a running daemon publishes by, and the switch."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

import typer

from ..config import DEFAULT_ENDPOINT
from .options import Connect, RigName, Which, ZenohFile, name_next
from .tables import fold


class Model(StrEnum):
    """The two there are."""

    static = "static"
    dynamic = "dynamic"


def model(
    switch: Annotated[Model | None, typer.Argument(help="Publish by this one; without it, nothing changes.")] = None,
    foot: Annotated[Which, typer.Option("--foot", help="Of which insole.")] = Which.both,
    rig: RigName = "*",
    connect: Connect = DEFAULT_ENDPOINT,
    zenoh_config: ZenohFile = None,
) -> None:
    """Say which effects a calibration has beside its curves, and switch them off and on, until the daemon restarts."""
    from ..errors import WireError
    from ..wire.client import Client

    with Client(connect, rig, zenoh_config) as insole:
        there = [name for _, name in insole.feet()]
        feet = [name for name in ("left", "right") if name in there and foot in (Which.both, name)]
        if not feet:
            raise WireError(f"no daemon behind {connect} has the foot that is meant ({foot.value})")
        for name in feet:
            reply = insole.request(name, "model", do="tell" if switch is None else switch.value)
            print("\n".join(fold(line, 4) for line in report(reply)), flush=True)
    name_next("insole view --open" if switch is not None else "insole model static, or dynamic: switches")


def report(reply: dict[str, Any]) -> list[str]:
    """Of one foot, in lines."""
    lines = [f"{reply['foot']}: {reply['model']} model of {reply['calibration']}"]
    lines += [f"  loads are {reply['late_ms']:.0f} ms older than their frames"] if reply["late_ms"] else []
    for each in reply["effects"]:
        where = "the whole insole" if each["scope"] == "insole" else f"{len(each['ids'])} × {each['scope']}"
        lines.append(f"  {each['effect']}, {where}" + (f": left out, {each['left_out']}" if each["left_out"] else ""))
    return lines if reply["effects"] else [*lines, "  no effects: nothing to switch"]
