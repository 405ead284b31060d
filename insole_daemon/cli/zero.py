"""`insole zero`: what the insoles read without load, taken by the running daemon."""

from __future__ import annotations

import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from typing import Annotated, Any

import typer

from ..config import DEFAULT_ENDPOINT
from .options import Connect, RigName, Which, ZenohFile, name_next
from .progress import show_work
from .tables import fold

_COUNTDOWN_S = 3
_LOOK_S = 0.2
_PRESSURE_TAXELS = 10  # of a triangle; the geometry would be imported with numpy
_PARTS_SHOWN = 12


def zero(
    foot: Annotated[Which, typer.Option("--foot", help="Which insole; both at once if nobody stands.")] = Which.both,
    seconds: Annotated[float, typer.Option(min=0.5, max=60, help="How long the readings are averaged.")] = 3.0,
    force: Annotated[bool, typer.Option("--force", help="Also of a foot that seems loaded or moves.")] = False,
    wait: Annotated[bool, typer.Option(help="Count down first.")] = True,
    rig: RigName = "*",
    connect: Connect = DEFAULT_ENDPOINT,
    zenoh_config: ZenohFile = None,
) -> None:
    """Take the zero of insoles that bear no load, and keep it.

    Exit status 1: refused, and nothing changed.
    """
    from ..errors import WireError
    from ..wire.client import Client

    # the pool outside, so that Ctrl-C ends the session first, and with it the requests that the pool waits for
    with ThreadPoolExecutor(2) as pool, Client(connect, rig, zenoh_config) as insole:
        there = [name for _, name in insole.feet()]
        feet = [name for name in ("left", "right") if name in there and foot in (Which.both, name)]
        if not feet:
            raise WireError(f"no daemon behind {connect} has the foot that is to be zeroed ({foot.value})")
        for name in feet:
            insole.rig_of(name)  # where several rigs have it, say so before anybody lifts a foot
        _say(f"lift the {' and the '.join(feet)} foot, so that nothing presses on the insole, and keep still")
        for left in range(_COUNTDOWN_S if wait else 0, 0, -1):
            _say(f"  {left} …")
            threading.Event().wait(1.0)
        _say(f"  taking {seconds:g} s of readings …")
        refused = False
        jobs = [pool.submit(insole.request, name, "zero", seconds=seconds, force=force) for name in feet]
        with show_work("averaging") as work:
            began_s = time.monotonic()
            while wait_for(jobs, _LOOK_S).not_done:
                work.done(min((time.monotonic() - began_s) / seconds, 1.0))
        for job in jobs:
            reply = job.result()
            refused |= not reply["ok"]
            print("\n".join(fold(line, 4) for line in report(reply)), flush=True)
    if refused:
        name_next("insole zero, with the foot in the air")
        raise typer.Exit(1)
    name_next("insole record walk-1 --remote, or insole view --open")


def report(reply: dict[str, Any]) -> list[str]:
    """What came of one foot, in lines."""
    foot = reply["foot"]
    if reply["ok"]:
        lines = [
            f"{foot}: zeroed {reply['n_taxels']} taxels, noise {reply['noise_count']:.2f} counts",
            f"  moved by {reply['shift_count']:+.2f} counts on average, {reply['largest_shift_count']:+.1f} at most",
            f"  stored in {reply['stored']}",
        ]
        lines += [f"  forced although {why}" for why in reply["refusals"]]
    else:
        lines = [f"{foot}: refused, nothing has changed"]
        lines += [f"  {why}" for why in reply["refusals"]]
    for what, taxels in (("loaded", reply["loaded"]), ("noisy", reply["noisy"]), *reply["left_out"].items()):
        if taxels:
            lines.append(f"  {what}: {_names(taxels)}" + (" (left out)" if what in reply["left_out"] else ""))
    if reply["note"]:
        lines.append(f"  {reply['note']}")
    return lines


def _names(taxels: list[list[int]]) -> str:
    """[[5, 0, 1], [5, 0, 2]] as "board 5 triangle 0: 1, 2"; a triangle of which all are in it by its number alone."""
    by_triangle: dict[tuple[int, int], list[int]] = {}
    for board, triangle, taxel in taxels:
        by_triangle.setdefault((board, triangle), []).append(taxel)
    whole: dict[int, list[str]] = {}
    parts = []
    for (board, triangle), own in by_triangle.items():
        if len(own) == _PRESSURE_TAXELS:
            whole.setdefault(board, []).append(str(triangle))
        else:
            parts.append(f"board {board} triangle {triangle}: {', '.join(map(str, own))}")
    if len(parts) > _PARTS_SHOWN:
        parts[_PARTS_SHOWN:] = [f"and taxels of {len(parts) - _PARTS_SHOWN} more triangles"]
    return "; ".join([f"board {b} all of triangles {', '.join(own)}" for b, own in whole.items()] + parts)


def _say(text: str) -> None:
    print(fold(text, 4), file=sys.stderr, flush=True)
