"""`insole demo --hide`: conceal something in a simulated trial, diagnose the recording, and then say what it was.

At last, what the daemon would publish of another trial of the same insole, with the calibration and with the model.
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

_PASSED_OVER = ("gain", "baseline")  # as the benchmark does: other effects bring them along, as warmth moves the rest
_LEAST_BETTER = 0.95  # times the error before: more, and nothing was undone
_NOT_UNDONE = {
    "clock": "it is the reference's clock, which the daemon does not read",
    "reference_fault": "it is the reference that is off, which the daemon does not read",
    "noise_burst": "noise of a moment can be told and not undone",
    "frame_loss": "what was never sent cannot be undone; the daemon marks it as missing",
    "open_triangle": "the daemon masks a triangle without contact by itself, with any model",
    "dead_taxels": "the daemon masks taxels that rest by itself once their neighbours are loaded, with any model",
    "temperature": "boards do not send their temperature with the counts",
    "baseline": "the daemon masks a board whose readings are off without load; take a zero instead",
    "delay": "a delay of some boards alone is told by age_ms; the force is of what each of them said last",
    "lag": "of a single taxel it makes more noise than it takes away; forces, sums of many, gain",
    "drift": "its course is that of the trial it was found in; take a zero instead",
    "rezero": "it happened in the trial it was found in; take a zero instead",
}


def hide_and_seek(word: str, seed: int | None, trial: TrialKind | None) -> bool:
    """Whether the diagnosis names `word` first; it is given the folder of the recording and nothing else.

    `trial` None: a chamber where it can show the word, else a walk.
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
    told = "".join(f" --simulation {each}" for each in simulations)
    print(f"insole: diagnosing it: insole diagnose {recording}{told} --out {out}", file=sys.stderr, flush=True)
    found = diagnosed([recording], out, simulations=simulations)
    words = [finding.effect for finding in found.findings]
    named = next((each for each in words if each == word or each not in _PASSED_OVER), NOTHING)
    print(f"What was concealed: {hidden} (seed {drawn}); named first: {named}")
    _print_live_errors(word, found, recording, again, out, layout.foot)
    print(f"insole: {time.monotonic() - began:.0f} s from start to report", file=sys.stderr)
    name_next(f"open {out / 'report.html'}")
    return named == word


def _print_live_errors(word: str, found: Outcome, recording: Path, again: Path, out: Path, foot: Foot) -> None:
    from ..diagnosis.live_error import live_error
    from ..errors import CalibrationError
    from ..recording.loading import load

    trial = load(again)
    (calibration,) = recording.glob("*calibration.json")
    try:
        before, after = (live_error(model, trial, foot) for model in (calibration, out / "model.json"))
    except CalibrationError as error:
        print(fold(f"The daemon on {again}: nothing can be undone live: {error}", 4))
        return
    what = "pressure" if after.unit == "kPa" else "f_z"
    print(
        f"The daemon on {again}: {what} off by {before.value:.2f} {before.unit} with the calibration, "
        f"{after.value:.2f} {after.unit} with {out / 'model.json'}"
    )
    why = _why_not_undone(word, found, before, after)
    if why is not None:
        print(fold(f"  {word} is not undone live: {why}", 4))


def _why_not_undone(word: str, found: Outcome, before: LiveError, after: LiveError) -> str | None:
    """None where the model makes the daemon's error smaller, or where nothing was concealed."""
    if word == "nothing" or after.value < _LEAST_BETTER * before.value:
        return None
    if word not in {finding.effect for finding in found.findings}:
        return "the diagnosis did not find it"
    left_out = [each.why for each in after.left_out if each.effect.law.word == word]
    return left_out[0] if left_out else _NOT_UNDONE.get(word, "the daemon's error is of other causes")
