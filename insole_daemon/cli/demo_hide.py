"""`insole demo --hide`: conceal an effect in a simulated trial, diagnose the recording, and print what was concealed.

The last lines have the daemon's error on another trial of the same insole, with the calibration and with the model.
"""

from __future__ import annotations

import secrets
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from .diagnose import diagnosed
from .options import name_next
from .progress import show_work
from .tables import fold

if TYPE_CHECKING:
    from ..config import Foot
    from ..diagnosis.live_error import LiveError
    from ..diagnosis.outcome import Outcome
    from ..simulation.concealed import TrialKind

_IGNORED = ("gain", "baseline")  # as in the benchmark: other effects cause them, for example temperature a baseline
_LARGEST_RATIO = 0.95  # of the errors with the model and with the calibration, for an effect to count as undone
_NOT_UNDONE = {
    "clock": "the daemon does not read the reference's clock",
    "reference_fault": "the daemon does not read the reference",
    "noise_burst": "noise can be detected, but not removed",
    "frame_loss": "lost frames cannot be restored; the daemon marks their triangles as missing",
    "open_triangle": "with any model, the daemon masks a triangle without contact",
    "dead_taxels": "with any model, the daemon masks dead taxels once their neighbours are loaded",
    "temperature": "boards do not send their temperature with the counts",
    "baseline": "the daemon masks a board whose readings without load have shifted; take a zero instead",
    "delay": "a delay of single boards is in age_ms; the force uses the last reading of each board",
    "lag": "on single taxels, compensation adds more noise than it removes error; forces, which are sums, improve",
    "drift": "its time course is that of this trial alone; take a zero instead",
    "rezero": "it happened in this trial alone; take a zero instead",
}


def demonstrate_diagnosis(word: str, seed: int | None, trial: TrialKind | None) -> bool:
    """Conceal the effect `word` in a trial, diagnose the recording, and return whether the diagnosis names it first.

    The diagnosis gets the folder of the recording alone. `trial` None: a chamber if that can show the effect, else a
    walk.
    """
    from .. import config as configs
    from ..recording.writer import refuse_existing
    from ..service.foot_setup import load_layout
    from ..simulation.concealed import (
        BESIDE_A_SIMULATION,
        NOTHING,
        TRIALS,
        check_word,
        conceal,
        trials_that_show,
    )

    shown_in = trials_that_show(word) or TRIALS
    kind = shown_in[0] if trial is None else trial
    check_word(word, kind)
    began = time.monotonic()
    drawn = secrets.randbelow(1_000_000) if seed is None else seed
    folder = Path(f"concealed-{drawn}")
    refuse_existing(folder)
    config = configs.load(None)
    layout = load_layout(config.insoles[0])
    recording, again, simulation, out = (
        folder / name for name in ("trial", "another-trial", "simulation", "diagnosis")
    )
    print(f"insole: recording a {kind} trial into {recording}, and another into {again}", file=sys.stderr, flush=True)
    with show_work("recording") as work:
        hidden = conceal(word, recording, config, layout, drawn, lambda share: work.done(share / 2), trial=kind)
        conceal(word, again, config, layout, drawn, lambda share: work.done((1 + share) / 2), trial=kind, take=1)
    simulations = []
    if word in BESIDE_A_SIMULATION:
        print(f"insole: only a simulation of the trial shows it: writing one into {simulation}", file=sys.stderr)
        conceal(NOTHING, simulation, config, layout, drawn, trial=kind, take=2)
        simulations = [simulation]
    options = "".join(f" --simulation {path}" for path in simulations)
    print(f"insole: diagnosing it: insole diagnose {recording}{options} --out {out}", file=sys.stderr, flush=True)
    outcome = diagnosed([recording], out, simulations=simulations)
    words = [finding.effect for finding in outcome.findings]
    named = next((effect for effect in words if effect == word or effect not in _IGNORED), NOTHING)
    print(f"What was concealed: {hidden} (seed {drawn}); named first: {named}")
    _print_live_errors(word, outcome, recording, again, out, layout.foot)
    print(f"insole: {time.monotonic() - began:.0f} s from start to report", file=sys.stderr)
    name_next(f"open {out / 'report.html'}")
    return named == word


def _print_live_errors(word: str, outcome: Outcome, recording: Path, again: Path, out: Path, foot: Foot) -> None:
    from ..diagnosis.live_error import live_error
    from ..errors import CalibrationError
    from ..recording.loading import load

    trial = load(again)
    (calibration,) = recording.glob("*calibration.json")
    try:
        before, after = (live_error(model, trial, foot) for model in (calibration, out / "model.json"))
    except CalibrationError as error:
        print(fold(f"The daemon on {again}: no effect can be undone live: {error}", 4))
        return
    what = "pressure" if after.unit == "kPa" else "f_z"
    print(
        f"The daemon on {again}: {what} off by {before.value:.2f} {before.unit} with the calibration, "
        f"{after.value:.2f} {after.unit} with {out / 'model.json'}"
    )
    why = _why_not_undone(word, outcome, before, after)
    if why is not None:
        print(fold(f"  {word} is not undone live: {why}", 4))


def _why_not_undone(word: str, outcome: Outcome, before: LiveError, after: LiveError) -> str | None:
    """Return why the model does not lower the daemon's error; None if it does, or if nothing was concealed."""
    if word == "nothing" or after.value < _LARGEST_RATIO * before.value:
        return None
    if word not in {finding.effect for finding in outcome.findings}:
        return "the diagnosis did not detect it"
    reasons = [omitted.why for omitted in after.left_out if omitted.effect.law.word == word]
    return reasons[0] if reasons else _NOT_UNDONE.get(word, "the daemon's error has other causes")
