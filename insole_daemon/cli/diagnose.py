"""`insole diagnose`: detect effects that a model left out, and write a model that has them."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import Force, OneFoot, is_repeatable, name_next
from .progress import show_work
from .recordings import load_recordings
from .tables import fold

if TYPE_CHECKING:
    from ..config import Foot
    from ..diagnosis.outcome import Outcome

EXIT = {"no mismatch": 0, "explained": 0, "partly explained": 1, "unexplained": 1, "not decidable": 3}
_SIMULATED, _READ, _SEARCHED, _VERIFIED = (
    (3,),
    (1,),
    (12, 4),
    (1,),
)  # relative durations of the stages of each recording


def diagnose(
    recordings: Annotated[list[Path], typer.Argument(help="Folders of recordings of one insole, explained together.")],
    out: Annotated[
        Path,
        typer.Option("--out", help="Folder for diagnosis.json, model.json and report.html."),
    ],
    calibration: Annotated[
        Path | None, typer.Option("--calibration", help="The static model to diagnose; default: that of the recording.")
    ] = None,
    simulation: Annotated[
        list[Path] | None,
        typer.Option(
            "--simulation",
            help="A simulated recording of the same trial, whose load replaces a reference. Give one for all "
            "recordings, or one for each, in their order.",
        ),
    ] = None,
    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate",
            help="Chambers: compare with the model's own simulation of the trial, made from the pressure of its "
            "reference; the model may have effects.",
        ),
    ] = False,
    verify: Annotated[
        Path | None,
        typer.Option(
            "--verify", help="A recording that is not diagnosed; the model's error before and after is measured on it."
        ),
    ] = None,
    foot: Annotated[
        OneFoot | None, typer.Option("--foot", help="Foot to diagnose; needed if the recordings have both.")
    ] = None,
    force: Force = False,
) -> None:
    """Detect effects that the model of recordings left out, and write a model that has them.

    Exit status: 0 no mismatch or explained, 1 partly explained or unexplained, 2 wrong usage, 3 not decidable from
    this data, 4 a recording was refused.
    """
    if simulate and simulation:
        raise typer.BadParameter("--simulate makes the simulations that --simulation names: give one of them")
    outcome = diagnosed(recordings, out, calibration, simulation or (), verify, foot, force, simulate)
    report = out / "report.html"
    model = f"insole validate OTHER-RECORDINGS --calibration {out / 'model.json'}"
    name_next(f"open {report}" + (f"; then {model}" if outcome.findings else ""))
    raise typer.Exit(EXIT[outcome.verdict])


def diagnosed(
    recordings: Sequence[Path],
    out: Path,
    calibration: Path | None = None,
    simulations: Sequence[Path] = (),
    verify: Path | None = None,
    foot: OneFoot | None = None,
    force: bool = False,
    simulate: bool = False,
) -> Outcome:
    """Diagnose, write the files into `out`, print the result and return it."""
    from ..diagnosis import verifying, writing
    from ..diagnosis.feet import choose
    from ..diagnosis.pipeline import diagnose
    from ..files import set_aside, write_text
    from ..physics import calibration as calibrations
    from . import own_simulations

    if not force:
        writing.refuse_taken(out)
    earlier = [out / name for name in (*writing.FILES, verifying.FILE)]
    if simulate and force:
        earlier += [each for each in own_simulations.simulation_folders(out, len(recordings)) if is_repeatable(each)]
    loaded = load_recordings(recordings)
    simulated = load_recordings(simulations)
    new = None if verify is None else load_recordings([verify])[0]
    if new is not None:
        verifying.refuse_known(new, loaded)
    side: Foot | None = None if foot is None else "left" if foot is OneFoot.left else "right"
    model = (
        None if calibration is None else calibrations.load(calibration, choose(loaded, side, bool(simulated))[0].layout)
    )
    feet = choose(loaded, side) if simulate else []
    to_simulate = own_simulations.model_to_simulate(loaded, feet, model) if simulate else None

    simulating = _SIMULATED * len(feet)
    stages = [*simulating, *_READ * len(loaded), *_SEARCHED * len(loaded), *(_VERIFIED if new is not None else ())]
    with contextlib.ExitStack() as stack:
        stack.enter_context(set_aside(earlier))
        work = stack.enter_context(show_work("diagnosing", stages))
        if to_simulate is None:
            outcome = diagnose(loaded, model, work, simulated, side)
        else:
            simulated = stack.enter_context(own_simulations.simulated(loaded, feet, to_simulate, out, work))
            beside = own_simulations.beside_effects(loaded, to_simulate)
            outcome = diagnose(beside, own_simulations.without_effects(to_simulate), work, simulated, side)
            outcome = own_simulations.with_simulated_effects(outcome, to_simulate)
        writing.write(outcome, out)
        if new is not None:
            work("verifying the model")
            verified = verifying.verify(outcome.static(), out / "model.json", new, outcome.results[0].seen.layout.foot)
            write_text(out / verifying.FILE, json.dumps(verified.document(), indent=1) + "\n")
    _print(outcome, out)
    if new is not None:
        unit = "counts" if verified.unit == "count" else verified.unit
        print(f"verified on {verified.recording}: {verified.before:.2f} → {verified.after:.2f} {unit}")
    return outcome


def _print(outcome: Outcome, out: Path) -> None:
    heldout = outcome.heldout
    errors = [heldout, heldout["f_z"]] if "f_z" in heldout else [heldout]
    print(f"{outcome.verdict}: {'; '.join(map(_error, errors))}")
    all_recordings = {name for finding in outcome.findings for name in finding.recordings}
    for finding in outcome.findings:
        only = "" if all_recordings <= set(finding.recordings) else f" [{', '.join(finding.recordings)}]"
        print(fold(f"  {finding.effect}: {finding.sentence}{only}", 4))
    for effect in outcome.not_identifiable:
        print(fold(f"  not identifiable: {effect['effect']}: {effect['why']}; record {effect['record_instead']}", 4))
    print(f"{out}/report.html  {out}/diagnosis.json  {out}/model.json")


def _error(error: Mapping[str, Any]) -> str:
    unit = "counts" if error["unit"] == "count" else error["unit"]
    return f"{error['before']:.2f} → {error['after']:.2f} {unit}, noise {error['floor']:.2f}"
