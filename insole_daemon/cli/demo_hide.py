"""`insole demo --hide`: conceal an effect in a simulated trial, diagnose the recording, and then say what it was."""

from __future__ import annotations

import secrets
import sys
import time
from pathlib import Path

from .diagnose import diagnosed
from .options import name_next
from .progress import show_work

_PASSED_OVER = ("gain", "baseline")  # as the benchmark does: other effects bring them along, as warmth moves the rest


def hide_and_seek(word: str, seed: int | None) -> bool:
    """Whether the diagnosis names `word` first; it is given the folder of the recording and nothing else."""
    from .. import config as configs
    from ..recording.writer import refuse_existing
    from ..service.foot_setup import load_layout
    from ..simulation.concealed import NOTHING, check_word, conceal

    check_word(word)
    began = time.monotonic()
    drawn = secrets.randbelow(1_000_000) if seed is None else seed
    folder = Path(f"concealed-{drawn}")
    refuse_existing(folder)
    config = configs.load(None)
    layout = load_layout(config.insoles[0])
    trial, out = folder / "trial", folder / "diagnosis"
    print(f"insole: recording a chamber trial into {trial}", file=sys.stderr, flush=True)
    with show_work("recording") as work:
        hidden = conceal(word, trial, config, layout, drawn, work.done)
    print(f"insole: diagnosing it: insole diagnose {trial} --out {out}", file=sys.stderr, flush=True)
    words = [finding.effect for finding in diagnosed([trial], out).findings]
    named = next((each for each in words if each == word or each not in _PASSED_OVER), NOTHING)
    print(f"What was concealed: {hidden} (seed {drawn}); named first: {named}")
    print(f"insole: {time.monotonic() - began:.0f} s from start to report", file=sys.stderr)
    name_next(f"open {out / 'report.html'}")
    return named == word
