"""A small simulated insole: every second triangle of the left foot, which is fast and still has heel and ball."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from insole_daemon.config import Config
from insole_daemon.simulation.conditions import Conditions, InstrumentConditions
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin import layout as layouts

BUILTIN = layouts.builtin("left", (5, 6, 7))
LAYOUT = layouts.assigned(BUILTIN, BUILTIN.triangles[::2])
CONFIG = replace(Config(), insoles=Config().insoles[:1])
SEED = 4


OFFSET_S, RATE = 0.4, 1e-3  # of the reference's clock, planted
_CLOCK = InstrumentConditions(offset_s=OFFSET_S, rate_ppm=RATE * 1e6)


def made(folder: Path, name: str, seconds: float | None = None, **conditions: Any) -> Path:
    """Record scenario `name` with the left foot."""
    chosen = Conditions(reference=_CLOCK, **conditions)
    return Trial(name, CONFIG, [LAYOUT], seed=SEED, conditions=chosen).write(folder, seconds)
