"""`insole validate`: measure the errors of a calibration on other recordings."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Force, name_next, refuse_existing_file, write_whole
from .progress import show_work
from .recordings import load_recordings
from .tables import fold, print_table, terminal_width

if TYPE_CHECKING:
    from ..calibration.validation import Result


def validate(
    recordings: Annotated[list[Path], typer.Argument(help="Folders of recordings with a reference.")],
    calibration: Annotated[Path, typer.Option("--calibration", help="The calibration to validate.")],
    out: Annotated[Path | None, typer.Option("--json", help="File for all errors, insole-validation/2.")] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Report to write, one HTML file.")] = None,
    force: Force = False,
) -> None:
    """Measure the errors of a calibration on recordings with a known load, as in the published tables."""
    from rich.console import Console

    from ..calibration import validation
    from ..calibration.validation_report import validation_page
    from ..documents import Reading
    from ..errors import CalibrationError
    from ..physics import calibration as calibrations

    for file in (out, report):
        refuse_existing_file(file, force)
    loaded = load_recordings(recordings)
    document = Reading(calibration).document
    foot = document.get("foot") if isinstance(document, dict) else None
    layout = next((f.layout for recording in loaded for f in recording.feet if f.foot == foot), None)
    if foot in ("left", "right") and layout is None:
        raise CalibrationError(f"{calibration}: a calibration of the {foot} foot, which none of the recordings has")
    judged = calibrations.load(calibration, layout or loaded[0].feet[0].layout)
    with show_work(f"judging {calibration.name}") as work:
        results, remarks = validation.validate(loaded, judged, work.done)
    for remark in remarks:
        print(f"insole: {remark}", file=sys.stderr)
    if out is not None:
        document = validation.validation_document(results, str(calibration))
        write_whole(out, json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    if report is not None:
        write_whole(report, validation_page(results, judged, calibration.name))
    console = Console(width=terminal_width(200))
    for columns, rows, names in _tables(results):
        print_table(console, columns, rows)
        for name in names:
            print(fold(f"{name}: {validation.DEFINITIONS[name]}", 2), file=sys.stderr)
    if judged.effects:
        print(fold(f"model: {validation.DEFINITIONS['model']}", 2), file=sys.stderr)
    for file in (out, report):
        if file is not None:
            print(f"insole: wrote {file}", file=sys.stderr)
    name_next(f"in config.yaml, under the {judged.foot} foot: calibration: {calibration}; then insole run")


def _tables(results: Sequence[Result]) -> Iterator[tuple[Sequence[str], Sequence[Sequence[str]], Sequence[str]]]:
    """Yield the columns and rows of each table, and the names of the figures to define below it."""
    from ..calibration.validation import ShoeResult
    from ..calibration.validation_rows import CHAMBER_COLUMNS, SHOE_COLUMNS, chamber_rows, shoe_rows

    shoe_results = [result for result in results if isinstance(result.outcome, ShoeResult)]
    chamber_results = [result for result in results if not isinstance(result.outcome, ShoeResult)]
    if shoe_results:
        yield SHOE_COLUMNS, shoe_rows(shoe_results), ("rmse", "accuracy", "steady", "cop", "clock")
    if chamber_results:
        yield CHAMBER_COLUMNS, chamber_rows(chamber_results), ("taxels", "clock")
