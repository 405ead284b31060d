"""`insole diagnose`: where recordings differ from their model, which physics was left out, and the model with it."""

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
)  # how long each recording's stages take beside each other


def diagnose(
    recordings: Annotated[list[Path], typer.Argument(help="Folders of recordings of one insole, explained together.")],
    out: Annotated[
        Path,
        typer.Option("--out", help="Folder for diagnosis.json, model.json and report.html."),
    ],
    calibration: Annotated[
        Path | None, typer.Option("--calibration", help="The static model that is asked about, if not the recording's.")
    ] = None,
    simulation: Annotated[
        list[Path] | None,
        typer.Option(
            "--simulation",
            help="A simulated recording of the same trial: its load stands for a reference. One for all recordings, "
            "or again for each, in their order.",
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
        typer.Option("--verify", help="A recording that has no part in it, to tell the errors before and after on."),
    ] = None,
    foot: Annotated[OneFoot | None, typer.Option("--foot", help="Needed where the recordings have both.")] = None,
    force: Force = False,
) -> None:
    """Say where recordings differ from their model, which physics was left out, and model it.

    Exit status: 0 no mismatch or explained, 1 partly explained or unexplained, 2 wrong usage, 3 not decidable from
    this data, 4 a recording was refused.
    """
    if simulate and simulation:
        raise typer.BadParameter("--simulate makes the simulations that --simulation names: give one of them")
    found = diagnosed(recordings, out, calibration, simulation or (), verify, foot, force, simulate)
    report = out / "report.html"
    model = f"insole validate OTHER-RECORDINGS --calibration {out / 'model.json'}"
    name_next(f"open {report}" + (f"; then {model}" if found.findings else ""))
    raise typer.Exit(EXIT[found.verdict])


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
    """What the command does, up to its exit status."""
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
    asked: Foot | None = None if foot is None else "left" if foot is OneFoot.left else "right"
    model = (
        None
        if calibration is None
        else calibrations.load(calibration, choose(loaded, asked, bool(simulated))[0].layout)
    )
    feet = choose(loaded, asked) if simulate else []
    to_simulate = own_simulations.model_to_simulate(loaded, feet, model) if simulate else None

    simulating = _SIMULATED * len(feet)
    stages = [*simulating, *_READ * len(loaded), *_SEARCHED * len(loaded), *(_VERIFIED if new is not None else ())]
    with contextlib.ExitStack() as stack:
        stack.enter_context(set_aside(earlier))
        work = stack.enter_context(show_work("diagnosing", stages))
        if to_simulate is None:
            found = diagnose(loaded, model, work, simulated, asked)
        else:
            simulated = stack.enter_context(own_simulations.simulated(loaded, feet, to_simulate, out, work))
            beside = own_simulations.beside_effects(loaded, to_simulate)
            found = diagnose(beside, own_simulations.without_effects(to_simulate), work, simulated, asked)
            found = own_simulations.with_simulated_effects(found, to_simulate)
        writing.write(found, out)
        if new is not None:
            work("verifying the model")
            verified = verifying.verify(found.static(), out / "model.json", new, found.results[0].seen.layout.foot)
            write_text(out / verifying.FILE, json.dumps(verified.document(), indent=1) + "\n")
    _print(found, out)
    if new is not None:
        unit = "counts" if verified.unit == "count" else verified.unit
        print(f"verified on {verified.recording}: {verified.before:.2f} → {verified.after:.2f} {unit}")
    return found


def _print(found: Outcome, out: Path) -> None:
    heldout = found.heldout
    errors = [heldout, heldout["f_z"]] if "f_z" in heldout else [heldout]
    print(f"{found.verdict}: {'; '.join(map(_error, errors))}")
    every = {name for each in found.findings for name in each.recordings}
    for each in found.findings:
        only = "" if every <= set(each.recordings) else f" [{', '.join(each.recordings)}]"
        print(fold(f"  {each.effect}: {each.sentence}{only}", 4))
    for known in found.not_identifiable:
        print(fold(f"  not identifiable: {known['effect']}: {known['why']}; record {known['record_instead']}", 4))
    print(f"{out}/report.html  {out}/diagnosis.json  {out}/model.json")


def _error(of: Mapping[str, Any]) -> str:
    unit = "counts" if of["unit"] == "count" else of["unit"]
    return f"{of['before']:.2f} → {of['after']:.2f} {unit}, noise {of['floor']:.2f}"
