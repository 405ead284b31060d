"""`temperature`: offset and gain that go with the temperature. a ← (1 + γ·(T − T0))·a − β·(T − T0).

T0 is where the calibration is right. What the recording is warmer on the whole is an absorbed static component.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns

ABSORBED_K = 5.0  # between the temperature of the calibration and that of the recording
# Ten per cent of the range in 8 K are a count a kelvin; a multiple of it over a fraction of a kelvin is a drift.
MOST_COUNT_PER_K = 4.0
LEAST_K, LEAST_COUNT = 0.5, 1.0  # by which the temperature, or the pads, move: less shows nothing


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Joint columns: a kelvin (or a count of the pads) on the count, and one per cent of gain a kelvin."""
    if _needs(load) is not None:
        return []
    seen = load.observation
    assert seen.temperature_c is not None
    over = (seen.temperature_c - seen.temperature_c.mean())[:, None, None]
    offset = load.wrench_of(load.slope_pa)
    gain = load.wrench_of(-load.slope_pa * load.gained_count) * 0.01
    found = np.stack([offset * over, gain * over], axis=-1)
    return [TermColumns(({"part": 0.0}, {"part": 1.0}), by_triangle=found, joint=True)]


def _needs(load: LoadEstimate) -> str | None:
    """Why a recording cannot show it."""
    if load.observation.temperature_c is None:
        return "the reference has no temperature_c, and the thermal pads do not agree on one"
    moves = float(np.ptp(load.observation.temperature_c))
    if load.observation.temperature_is_in_counts:
        return None if moves >= LEAST_COUNT else f"the thermal pads move by less than {LEAST_COUNT:g} count"
    if moves < LEAST_K:
        return f"the temperature moves by less than {LEAST_K} K"
    return None


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """β in counts a kelvin, γ a kelvin."""
    return {"count_per_k": float(shares[0]), "gain_per_k": 0.01 * float(shares[1])}


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    return abs(float(shares[0])) <= MOST_COUNT_PER_K


TERM = Term(
    word="temperature",
    scopes=("insole", "board", "triangle"),
    share="free",
    columns=_columns,
    parameters=_parameters,
    plausible=0.05,
    limit=8.0,  # counts a kelvin, per cent of gain a kelvin
    is_possible=_is_possible,
    needs=_needs,
    record_instead="an insole that warms up and cools down, with temperature_c in the reference",
    absorbs={"baseline": ABSORBED_K, "gain": ABSORBED_K * 0.01},
    misfit=0.01,
    likeness=0.3,
)
