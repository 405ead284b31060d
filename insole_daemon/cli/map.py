"""`insole map`: measure the layout while a person presses triangle after triangle."""

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
    from ..skin.mapping import Mapping, Position, PositionResult
    from ..skin.touch import Touch

_LOOK_NS = 25_000_000
_PICTURE_MM = (11.0, 6.0)  # height of a line, width of a character


def map_(
    out: Annotated[Path, typer.Option("--out", help="Folder for left-layout.yaml and right-layout.yaml.")],
    foot: Annotated[Which, typer.Option("--foot", help="Insole to map.")] = Which.both,
    config: ConfigFile = None,
    template: Annotated[
        Path | None,
        typer.Option(help="Layout of one foot with the positions to press; default: the configured one."),
    ] = None,
    wait_s: Annotated[float, typer.Option("--wait", min=1, help="Seconds to wait for a press.")] = 15.0,
    force: Force = False,
) -> None:
    """Find out which triangle lies where: press them one after another.

    Reads the buses of the configuration itself, whether or not a daemon runs; the boards must be sending.
    Exit status 1: written, but a position is missing or in doubt.
    """
    from .. import config as configs
    from ..bus.recovering import RecoveringSource
    from ..errors import BusError, InsoleError
    from ..skin.mapping import Mapping, positions
    from ..skin.touch import Touch

    settings = configs.load(config)
    for insole in _chosen_insoles(settings, foot):
        refuse_existing_file(_layout_path(out, insole.foot), force)
    templates = [_template(insole, template) for insole in _chosen_insoles(settings, foot)]
    owners = {board.address: insole.foot for insole in settings.insoles for board in insole.boards}
    targets = [position for layout in templates for position in positions(layout)]
    stop = threading.Event()
    on_end(stop.set)
    touch, mapping = Touch(), Mapping(targets, owners, wait_s)
    with contextlib.closing(RecoveringSource(settings.buses)) as source:
        for change in source.changes():
            raise BusError(change.text)  # an interface that is not up: report it before the person presses
        _print_line(f"reading {', '.join(map(str, settings.buses))}; {len(targets)} positions to press")
        watch_presses(source, touch, mapping, targets, stop)
    if stop.is_set() and not mapping.is_done:
        raise InsoleError("ended before every position was pressed: nothing is written")
    complete = write_layouts(out, templates, mapping.results(), owners, touch)
    if not complete:
        raise typer.Exit(1)


def _layout_path(out: Path, foot: Foot) -> Path:
    return out / f"{foot}-layout.yaml"


def _chosen_insoles(settings: Config, foot: Which) -> list[Insole]:
    from ..errors import InsoleError

    chosen = [insole for insole in settings.insoles if foot in (Which.both, insole.foot)]
    if not chosen or (foot is Which.both and len(chosen) < 2):
        configured = " and ".join(insole.foot for insole in settings.insoles)
        raise InsoleError(f"--foot {foot.value}: the configuration has the {configured} foot only")
    return chosen


def _template(insole: Insole, file: Path | None) -> Layout:
    from ..service.foot_setup import load_layout
    from ..skin import layout as layouts

    return layouts.load(file, insole.foot) if file is not None else load_layout(insole)


def watch_presses(
    source: RecoveringSource, touch: Touch, mapping: Mapping, targets: list[Position], stop: threading.Event
) -> None:
    """Poll the bus forty times a second until every position has been pressed or given up."""
    from ..bus.source import collect
    from ..errors import BusError

    begun_ns = source.clock_ns()
    while not mapping.is_done and not stop.is_set():
        batch, now_ns = collect(source, 1 << 30, source.clock_ns() + _LOOK_NS)
        for change in source.changes():
            _print_line(f"  {change.text}")
        touch.feed(batch)
        if not touch.has_arrived().any():
            if now_ns - begun_ns > 3_000_000_000:
                raise BusError(
                    "no board sends: expected skin frames within 3 s, found none. Are the boards powered, and "
                    "started? 'insole boards start' starts them through the daemon"
                )
            continue
        for prompt in mapping.update(now_ns, touch.level_count(now_ns)):
            if prompt.kind == "press" and prompt.position is not None:
                _print_line("")
                _print_line(picture(targets, prompt.position))
                _print_line(
                    f"[{targets.index(prompt.position) + 1}/{len(targets)}] {prompt.text} "
                    f"({prompt.position.x_mm:.0f} mm from the heel, {_lateral_position(prompt.position.y_mm)})"
                )
            else:
                _print_line(f"  {prompt.text}" + ("\a" if prompt.kind in ("lift", "missing", "again") else ""))


def write_layouts(
    out: Path, templates: list[Layout], placements: list[PositionResult], owners: dict[int, Foot], touch: Touch
) -> bool:
    """Write a layout for each template, print the problems, and return whether there are none."""
    import numpy as np

    from ..errors import InsoleError
    from ..skin import layout as layouts
    from ..skin.mapping_result import layout_of, summary

    def identities(marked: NDArray[np.bool_]) -> list[tuple[int, int]]:
        return [(board, triangle) for board, triangle in np.argwhere(marked).tolist()]

    _print_line("")
    for template in templates:
        layout = layout_of(template, placements)
        if layout is None:
            _print_line(f"{template.foot}: no position answered for certain, nothing is written")
            continue
        path = _layout_path(out, template.foot)
        remark = (
            "Written by `insole map`: board and triangle of every position were found by pressing it.\n"
            "Places, rotations and mirroring are those of the template; a press does not measure them."
        )
        try:
            layouts.write(path, layout, remark)
        except OSError as error:
            raise InsoleError(f"{path}: cannot be written: {error.strerror or error}") from error
        _print_line(f"{template.foot}: {len(layout)} of {len(template)} positions in {path}")
        name_next(f"in config.yaml, under the {template.foot} foot: layout: {path}; then insole zero")
    lines = summary(
        placements, owners, identities(touch.has_arrived()), identities(touch.faulty() & touch.has_arrived())
    )  # fmt: skip
    for line in lines:
        _print_line(f"  {line}")
    if not lines:
        _print_line("  nothing missing, doubled or swapped")
    return all(placement.state == "answered" for placement in placements) and not any(
        line.startswith("swapped") for line in lines
    )


def picture(targets: list[Position], target: Position) -> str:
    """Draw the foot from above, toes up: a dot at every position, brackets around the one to press."""
    same_foot = [position for position in targets if position.foot == target.foot]
    top, leftmost = max(position.x_mm for position in same_foot), max(position.y_mm for position in same_foot)
    rows = 1 + round((top - min(position.x_mm for position in same_foot)) / _PICTURE_MM[0])
    columns = 1 + round((leftmost - min(position.y_mm for position in same_foot)) / _PICTURE_MM[1])
    grid = [[" "] * (columns + 2) for _ in range(rows)]
    for position in same_foot:
        row, column = (
            round((top - position.x_mm) / _PICTURE_MM[0]),
            1 + round((leftmost - position.y_mm) / _PICTURE_MM[1]),
        )
        grid[row][column] = "●" if position is target else "·" if grid[row][column] == " " else grid[row][column]
        if position is target:
            grid[row][column - 1], grid[row][column + 1] = "[", "]"
    return "\n".join("    " + "".join(row).rstrip() for row in grid)


def _lateral_position(y_mm: float) -> str:
    if abs(y_mm) < 0.5:
        return "on the midline"
    return f"{abs(y_mm):.0f} mm to the {'left' if y_mm > 0 else 'right'} of the midline"


def _print_line(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
