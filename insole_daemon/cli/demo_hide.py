"""`insole demo --hide`: conceal an effect in a simulated trial, diagnose the recording, then print the effect."""

from __future__ import annotations

import secrets
import sys
import time
from pathlib import Path

from .diagnose import diagnosed
from .options import name_next
from .progress import show_work

_IGNORED = ("gain", "baseline")  # as in the benchmark: other effects cause them, for example warmth moves the baseline


def hide_and_seek(word: str, seed: int | None) -> bool:
    """Return whether the diagnosis, given only the folder of the recording, names the effect `word` first."""
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
    effects = [finding.effect for finding in diagnosed([trial], out).findings]
    named = next((effect for effect in effects if effect == word or effect not in _IGNORED), NOTHING)
    print(f"What was concealed: {hidden} (seed {drawn}); named first: {named}")
    print(f"insole: {time.monotonic() - began:.0f} s from start to report", file=sys.stderr)
    name_next(f"open {out / 'report.html'}")
    return named == word
