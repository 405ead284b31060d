"""`insole map`: somebody presses triangle after triangle, and the layout is written."""

from __future__ import annotations

import contextlib
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import ConfigFile, Force, Which, name_next, on_end, refuse_existing_file

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..bus.recovering import RecoveringSource
    from ..config import Config, Insole
    from ..skin.layout import Foot, Layout
    from ..skin.mapping import Found, Mapping, Position
    from ..skin.touch import Touch

_LOOK_NS = 25_000_000
_PICTURE_MM = (11.0, 6.0)  # of a line and of a character, about as tall as wide


def map_(
    out: Annotated[Path, typer.Option("--out", help="Folder for left-layout.yaml and right-layout.yaml.")],
    foot: Annotated[Which, typer.Option("--foot", help="Which insole is pressed.")] = Which.both,
    config: ConfigFile = None,
    template: Annotated[
        Path | None,
        typer.Option(help="Layout of one foot whose positions are asked for; without it, the configured one."),
    ] = None,
    wait_s: Annotated[float, typer.Option("--wait", min=1, help="Seconds to wait for a press.")] = 15.0,
    force: Force = False,
) -> None:
    """Find out which triangle lies where: press them one after another.

    Reads the buses of the configuration itself, beside a daemon or without one; the boards must be streaming.
    Exit status 1: written, but something is missing or in doubt.
    """
    from .. import config as configs
    from ..bus.recovering import RecoveringSource
    from ..errors import BusError, InsoleError
    from ..skin.mapping import Mapping, positions
    from ..skin.touch import Touch

    settings = configs.load(config)
    for insole in _chosen(settings, foot):
        refuse_existing_file(_path(out, insole.foot), force)
    templates = [_template(insole, template) for insole in _chosen(settings, foot)]
    owners = {board.address: insole.foot for insole in settings.insoles for board in insole.boards}
    asked = [position for layout in templates for position in positions(layout)]
    stop = threading.Event()
    on_end(stop.set)
    touch, mapping = Touch(), Mapping(asked, owners, wait_s)
    with contextlib.closing(RecoveringSource(settings.buses)) as source:
        for change in source.changes():
            raise BusError(change.text)  # an interface that is not up: better known before somebody presses
        _say(f"reading {', '.join(map(str, settings.buses))}; {len(asked)} positions to press")
        watch_presses(source, touch, mapping, asked, stop)
    if stop.is_set() and not mapping.done:
        raise InsoleError("ended before every position was pressed: nothing is written")
    complete = write_layouts(out, templates, mapping.found(), owners, touch)
    if not complete:
        raise typer.Exit(1)


def _path(out: Path, foot: Foot) -> Path:
    return out / f"{foot}-layout.yaml"


def _chosen(settings: Config, foot: Which) -> list[Insole]:
    from ..errors import InsoleError

    chosen = [insole for insole in settings.insoles if foot in (Which.both, insole.foot)]
    if not chosen or (foot is Which.both and len(chosen) < 2):
        known = " and ".join(insole.foot for insole in settings.insoles)
        raise InsoleError(f"--foot {foot.value}: the configuration has the {known} foot only")
    return chosen


def _template(insole: Insole, given: Path | None) -> Layout:
    from ..service.foot_setup import load_layout
    from ..skin import layout as layouts

    return layouts.load(given, insole.foot) if given is not None else load_layout(insole)


def watch_presses(
    source: RecoveringSource, touch: Touch, mapping: Mapping, asked: list[Position], stop: threading.Event
) -> None:
    """Look at the bus forty times a second until every position has been asked."""
    from ..bus.source import collect
    from ..errors import BusError

    begun_ns = source.clock_ns()
    while not mapping.done and not stop.is_set():
        batch, now_ns = collect(source, 1 << 30, source.clock_ns() + _LOOK_NS)
        for change in source.changes():
            _say(f"  {change.text}")
        touch.feed(batch)
        if not touch.seen().any():
            if now_ns - begun_ns > 3_000_000_000:
                raise BusError(
                    "no board sends: expected skin frames within 3 s, found none. Are the boards powered, and "
                    "told to stream? A daemon that manages them does that"
                )
            continue
        for say in mapping.update(now_ns, touch.level_count(now_ns)):
            if say.what == "press" and say.position is not None:
                _say("")
                _say(picture(asked, say.position))
                _say(
                    f"[{asked.index(say.position) + 1}/{len(asked)}] {say.text} "
                    f"({say.position.x_mm:.0f} mm from the heel, {_beside(say.position.y_mm)})"
                )
            else:
                _say(f"  {say.text}" + ("\a" if say.what in ("lift", "missing", "again") else ""))


def write_layouts(
    out: Path, templates: list[Layout], found: list[Found], owners: dict[int, Foot], touch: Touch
) -> bool:
    """Write what was found, and say what was not; whether all is well."""
    import numpy as np

    from ..errors import InsoleError
    from ..skin import layout as layouts
    from ..skin.mapping_result import layout_of, summary

    def identities(marked: NDArray[np.bool_]) -> list[tuple[int, int]]:
        return [(board, triangle) for board, triangle in np.argwhere(marked).tolist()]

    _say("")
    for template in templates:
        layout = layout_of(template, found)
        if layout is None:
            _say(f"{template.foot}: no position answered for certain, nothing is written")
            continue
        path = _path(out, template.foot)
        remark = (
            "Written by `insole map`: board and triangle of every position were found by pressing it.\n"
            "Places, rotations and mirroring are those of the template; a press does not tell them."
        )
        try:
            layouts.write(path, layout, remark)
        except OSError as error:
            raise InsoleError(f"{path}: cannot be written: {error.strerror or error}") from error
        _say(f"{template.foot}: {len(layout)} of {len(template)} positions in {path}")
        name_next(f"in config.yaml, under the {template.foot} foot: layout: {path}; then insole zero")
    lines = summary(
        found, owners, identities(touch.seen()), identities(touch.faulty() & touch.seen())
    )  # fmt: skip
    for line in lines:
        _say(f"  {line}")
    if not lines:
        _say("  nothing missing, doubled or swapped")
    return all(each.state == "answered" for each in found) and not any(line.startswith("swapped") for line in lines)


def picture(asked: list[Position], wanted: Position) -> str:
    """The foot from above, toes up, with a dot at every position and the one to press in brackets."""
    own = [position for position in asked if position.foot == wanted.foot]
    top, left = max(position.x_mm for position in own), max(position.y_mm for position in own)
    rows = 1 + round((top - min(position.x_mm for position in own)) / _PICTURE_MM[0])
    columns = 1 + round((left - min(position.y_mm for position in own)) / _PICTURE_MM[1])
    grid = [[" "] * (columns + 2) for _ in range(rows)]
    for position in own:
        row, column = round((top - position.x_mm) / _PICTURE_MM[0]), 1 + round((left - position.y_mm) / _PICTURE_MM[1])
        grid[row][column] = "●" if position is wanted else "·" if grid[row][column] == " " else grid[row][column]
        if position is wanted:
            grid[row][column - 1], grid[row][column + 1] = "[", "]"
    return "\n".join("    " + "".join(row).rstrip() for row in grid)


def _beside(y_mm: float) -> str:
    if abs(y_mm) < 0.5:
        return "on the midline"
    return f"{abs(y_mm):.0f} mm to the {'left' if y_mm > 0 else 'right'} of the midline"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
