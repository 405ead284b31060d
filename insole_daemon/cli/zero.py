"""`insole zero`: let the running daemon measure the readings without load."""

from __future__ import annotations

import sys
import threading
import time
from typing import Annotated, Any

import typer

from ..config import DEFAULT_ENDPOINT
from .options import Connect, RigName, Which, ZenohFile, name_next
from .progress import show_work
from .tables import fold

_COUNTDOWN_S = 3
_POLL_S = 0.2
_PRESSURE_TAXELS = 10  # of a triangle; importing the geometry would import numpy
_TRIANGLES_SHOWN = 12


def zero(
    foot: Annotated[Which, typer.Option("--foot", help="Insole to zero; for both, lift both feet.")] = Which.both,
    seconds: Annotated[float, typer.Option(min=0.5, max=60, help="How long the readings are averaged.")] = 3.0,
    force: Annotated[bool, typer.Option("--force", help="Also zero a foot that seems loaded or moves.")] = False,
    wait: Annotated[bool, typer.Option(help="Count down first.")] = True,
    rig: RigName = "*",
    connect: Connect = DEFAULT_ENDPOINT,
    zenoh_config: ZenohFile = None,
) -> None:
    """Take the zero of unloaded insoles and store it.

    Exit status 1: refused, and nothing changed.
    """
    from concurrent.futures import ThreadPoolExecutor
    from concurrent.futures import wait as wait_for

    from ..errors import WireError
    from ..wire.client import Client

    # The pool is outside: Ctrl-C then ends the session first, and with it the requests that the pool waits for.
    with ThreadPoolExecutor(2) as pool, Client(connect, rig, zenoh_config) as insole:
        published = [name for _, name in insole.feet()]
        feet = [name for name in ("left", "right") if name in published and foot in (Which.both, name)]
        if not feet:
            raise WireError(f"no daemon behind {connect} has the foot that is to be zeroed ({foot.value})")
        for name in feet:
            insole.rig_of(name)  # refuse an ambiguous rig before anybody lifts a foot
        _print_line(f"lift the {' and the '.join(feet)} foot, so that nothing presses on the insole, and keep still")
        for count in range(_COUNTDOWN_S if wait else 0, 0, -1):
            _print_line(f"  {count} …")
            threading.Event().wait(1.0)
        _print_line(f"  taking {seconds:g} s of readings …")
        refused = False
        jobs = [pool.submit(insole.request, name, "zero", seconds=seconds, force=force) for name in feet]
        with show_work("averaging") as work:
            began_s = time.monotonic()
            while wait_for(jobs, _POLL_S).not_done:
                work.done(min((time.monotonic() - began_s) / seconds, 1.0))
        for job in jobs:
            reply = job.result()
            refused |= not reply["ok"]
            print("\n".join(fold(line, 4) for line in _reply_lines(reply)), flush=True)
    if refused:
        name_next("insole zero, with the foot in the air")
        raise typer.Exit(1)
    name_next("insole record walk-1 --remote, or insole view --open")


def _reply_lines(reply: dict[str, Any]) -> list[str]:
    """Format the reply of one foot as lines."""
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
    for condition, taxels in (("loaded", reply["loaded"]), ("noisy", reply["noisy"]), *reply["left_out"].items()):
        if taxels:
            lines.append(
                f"  {condition}: {_taxel_names(taxels)}" + (" (left out)" if condition in reply["left_out"] else "")
            )
    if reply["note"]:
        lines.append(f"  {reply['note']}")
    return lines


def _taxel_names(taxels: list[list[int]]) -> str:
    """Format [[5, 0, 1], [5, 0, 2]] as "board 5 triangle 0: 1, 2"; a complete triangle by its number alone."""
    by_triangle: dict[tuple[int, int], list[int]] = {}
    for board, triangle, taxel in taxels:
        by_triangle.setdefault((board, triangle), []).append(taxel)
    complete: dict[int, list[str]] = {}
    partial = []
    for (board, triangle), numbers in by_triangle.items():
        if len(numbers) == _PRESSURE_TAXELS:
            complete.setdefault(board, []).append(str(triangle))
        else:
            partial.append(f"board {board} triangle {triangle}: {', '.join(map(str, numbers))}")
    if len(partial) > _TRIANGLES_SHOWN:
        partial[_TRIANGLES_SHOWN:] = [f"and taxels of {len(partial) - _TRIANGLES_SHOWN} more triangles"]
    return "; ".join([f"board {b} all of triangles {', '.join(numbers)}" for b, numbers in complete.items()] + partial)


def _print_line(text: str) -> None:
    print(fold(text, 4), file=sys.stderr, flush=True)
