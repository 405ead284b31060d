"""`insole calibrate`: fit a curve for every taxel to recordings with a known load."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Force, OneFoot, name_next, refuse_existing_file, write_whole
from .progress import show_work
from .recordings import load_recordings

if TYPE_CHECKING:
    from ..config import Foot
    from ..recording.loading import Recording


class Method(StrEnum):
    """The weights and constraints of the fit."""

    default = "default"
    paper = "paper"


# Relative durations of the stages: cycles, clocks, first fit; then three degrees, weights and constraints, or the
# published fit.
_STAGES = {Method.default: (2, 3, 8, 3, 3, 5, 1, 1), Method.paper: (2, 3, 8, 2)}


def calibrate(
    recordings: Annotated[list[Path], typer.Argument(help="Folders of recordings: chamber, force shoe, or both.")],
    out: Annotated[Path, typer.Option("--out", help="Calibration file to write.")],
    report: Annotated[Path | None, typer.Option("--report", help="Report to write, one HTML file.")] = None,
    foot: Annotated[
        OneFoot | None, typer.Option("--foot", help="Foot to calibrate; needed if the recordings have both.")
    ] = None,
    method: Annotated[
        Method,
        typer.Option(
            help="default: weights from the residuals, curves that start at 0 and never fall, degree and penalty by "
            "cross-validation. paper: a cubic in raw counts with the published weights and λ."
        ),
    ] = Method.default,
    force: Force = False,
) -> None:
    """Fit the curve of every taxel of one foot to recordings with a known load."""
    from ..calibration import document
    from ..calibration.calibrating import calibrate as fitted
    from ..calibration.report import calibration_page

    if out.suffix.lower() != ".json":
        raise typer.BadParameter(f"expected an --out that ends in .json, found {out}")
    for file in (out, report):
        refuse_existing_file(file, force)
    loaded = load_recordings(recordings)
    side = choose_foot(loaded, foot)
    with show_work(f"fitting the {side} foot", _STAGES[method]) as work:
        calibrated = fitted(loaded, side, method.value, work)
    for remark in (*calibrated.remarks, f"area of a taxel: from {document.provenance(calibrated)['area_from']}"):
        print(f"insole: {remark}", file=sys.stderr)
    document.save_calibration(calibrated, out)
    if report is not None:
        write_whole(report, calibration_page(calibrated))
    fit = calibrated.fit
    print(
        f"{out}: {side} foot, {len(calibrated.slots)} taxels, {len(calibrated.left_out)} left out, degree {fit.degree}"
    )
    if report is not None:
        print(f"insole: wrote {report}", file=sys.stderr)
    name_next(f"insole validate OTHER-RECORDINGS --calibration {out}")


def choose_foot(loaded: list[Recording], chosen: OneFoot | None) -> Foot:
    """Return the chosen foot, or the only one that all recordings have; BadParameter if `--foot` is needed."""
    from ..calibration.trials import feet_with_reference

    sides = feet_with_reference(loaded)
    if chosen is not None:
        return "left" if chosen is OneFoot.left else "right"
    if len(sides) > 1:
        raise typer.BadParameter("the recordings have both feet: give --foot left or --foot right")
    if not sides:
        raise typer.BadParameter("no foot has a reference in all recordings: give --foot to see which one lacks it")
    return sides.pop()
