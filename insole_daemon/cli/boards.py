"""`insole boards`: list, configure, start and stop the boards through the running daemon."""

from __future__ import annotations

import sys
from enum import StrEnum
from typing import Annotated, Any

import typer

from ..config import DEFAULT_ENDPOINT
from .options import Connect, RigName, ZenohFile, name_next
from .progress import show_work
from .tables import fold

_UNCONFIRMED = 1  # exit status


class Action(StrEnum):
    """The action of the command."""

    list = "list"
    configure = "configure"
    start = "start"
    stop = "stop"
    temperature = "temperature"


class FootName(StrEnum):
    """The foot whose boards the command addresses."""

    left = "left"
    right = "right"


_NEXT = {
    Action.list: "insole zero, with the feet off the ground",
    Action.configure: "insole zero, with the feet off the ground",
    Action.start: "insole status",
    Action.stop: "insole boards start",
    Action.temperature: "insole status",
}


def boards(
    action: Annotated[Action, typer.Argument(help="What to do.")] = Action.list,
    foot: Annotated[FootName | None, typer.Option("--foot", help="One foot; without it, both.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Configure or start although the foot is loaded.")] = False,
    rig: RigName = "*",
    connect: Connect = DEFAULT_ENDPOINT,
    zenoh_config: ZenohFile = None,
) -> None:
    """List, configure, start and stop the boards.

    The running daemon sends the commands, if its configuration has `boards: {configure: true}`. Boards acknowledge
    nothing: the frames they send afterwards confirm a command. A board that is configured takes a new hardware
    baseline, and so does one that is started after it lost power: the feet must be off the ground. Exit status 1: not
    confirmed; 3: refused or failed.
    """
    from ..errors import WireError
    from ..wire.client import Client

    if force and action not in (Action.configure, Action.start):
        raise typer.BadParameter("only configure and start can be forced", param_hint="--force")
    arguments = {"force": True} if force else {}
    confirmed = True
    with Client(connect, rig, zenoh_config) as insole:
        feet = [name for _, name in insole.feet() if foot is None or name == foot]
        if not feet:
            raise WireError(f"no daemon behind {connect} has {'a foot' if foot is None else f'a {foot} foot'}")
        for name in feet:
            with show_work(f"asking the {name} foot's boards"):
                reply = insole.request(name, "boards", do=str(action), **arguments)
            sys.stdout.write(_screen(name, action, reply))
            sys.stdout.flush()
            confirmed &= bool(reply.get("confirmed", True))
    if not confirmed:
        name_next("insole doctor")
        raise typer.Exit(_UNCONFIRMED)
    name_next(_NEXT[action])


def _screen(foot: str, action: Action, reply: dict[str, Any]) -> str:
    rows = {Action.list: _list_rows, Action.temperature: _temperature_rows}.get(action, _confirmation_rows)(
        reply["boards"]
    )
    lines = [f"{foot}:", *_table(rows)]
    if action is Action.list:
        lines += [fold(line, 4) for line in _difference_lines(reply["boards"])]
    if action is Action.configure:
        lines.append({
            "none": "  baseline taken without load",
            "not known": "  baseline taken under a load that is not known: the boards were silent before. "
            "Was the foot off the ground?",
            "loaded": f"  baseline taken UNDER LOAD ({reply['force_n'] or 0:.0f} N), as you insisted: "
            "that load reads as none now",
        }[reply["load"]])  # fmt: skip
    if action is Action.start and reply["load"] != "none":
        lines.append({
            "not known": "  started under a load that is not known: the boards were silent before, and one that had "
            "lost power took its baseline now. Was the foot off the ground?",
            "loaded": f"  started UNDER LOAD ({reply['force_n'] or 0:.0f} N), as you insisted: on a board that had "
            "lost power that load reads as none now",
        }[reply["load"]])  # fmt: skip
    for stranger in reply.get("strangers", []):
        lines.append(f"  board {stranger['address']} ({_type_name(stranger)}) is not in the configuration")
    for bus in reply.get("bus", []):
        lines.append(
            f"  {bus['interface']}: {bus['frames_per_s']:.0f} frames/s as configured, "
            f"{bus['least']:.0%} to {bus['most']:.0%} of the bus"
        )
    lines += [fold(f"  {note}", 4) for note in reply.get("notes", [])]
    return "\n".join(lines) + "\n"


def _list_rows(boards: list[dict[str, Any]]) -> list[list[str]]:
    rows = [["board", "bus", "type", "firmware", "state", "sends", "new", "triangles", "count"]]
    for board in boards:
        rows.append([
            str(board["address"]), board["interface"], _type_name(board), board["firmware"] or "-", board["state"],
            f"{board['rate_hz']:.1f} Hz", f"{board['change_rate_hz']:.1f} Hz",
            f"{len(board['triangles'])} of {len(board['expected_triangles'])}"
            + (f", {len(board['open_triangles'])} open" if board["open_triangles"] else ""),
            "-" if board["seen_count"] is None else f"{board['seen_count']:.0f}",
        ])  # fmt: skip
    return rows


def _difference_lines(boards: list[dict[str, Any]]) -> list[str]:
    differ = [board for board in boards if board["differences"]]
    lines = [f"  board {board['address']}: {'; '.join(board['differences'])}" for board in differ]
    return lines or ["  every board is as configured"]


def _confirmation_rows(boards: list[dict[str, Any]]) -> list[list[str]]:
    rows = [["board", "confirmed", "observed"]]
    for board in boards:
        period = "" if board["seen_period_ms"] is None else f" every {board['seen_period_ms']:.1f} ms"
        observed = f"{len(board['triangles'])} triangles{period}" if board["triangles"] else "silent"
        rows.append([
            str(board["address"]), "yes" if board["confirmed"] else "NO", "; ".join([observed, *board["differences"]]),
        ])  # fmt: skip
    return rows


def _temperature_rows(boards: list[dict[str, Any]]) -> list[list[str]]:
    rows = [["board", "type", "temperature"]]
    for board in boards:
        degrees = board["why"] if board["temperature_c"] is None else f"{board['temperature_c']:.1f} °C"
        rows.append([str(board["address"]), _type_name(board), degrees])
    return rows


def _type_name(board: dict[str, Any]) -> str:
    return (board["type"] or "-") + (" in its bootloader" if board["bootloader"] else "")


def _table(rows: list[list[str]]) -> list[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
