"""`temperature`: baseline and gain depend on the temperature. a ← (1 + γ·(T − T0))·a − β·(T − T0).

T0 is the temperature of the calibration. The difference of the recording's mean temperature to T0 is a static part,
which companions describe (`absorbs`); columns use the deviation from the recording's mean.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns

ABSORBED_K = 5.0  # prior standard deviation of the temperature between calibration and recording
# Ten per cent of the range in 8 K is about one count per kelvin; much more, over a fraction of a kelvin, is a drift.
MOST_COUNT_PER_K = 4.0
LEAST_K, LEAST_COUNT = 0.5, 1.0  # smallest range of the temperature, or of the pads, that shows an effect


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: one count, and one per cent of gain, per kelvin or per count of the pads."""
    if _needs(load) is not None:
        return []
    seen = load.observation
    assert seen.temperature_c is not None
    deviation = (seen.temperature_c - seen.temperature_c.mean())[:, None, None]
    offset = load.wrench_of(load.slope_pa)
    gain = load.wrench_of(-load.slope_pa * load.gained_count) * 0.01
    columns = np.stack([offset * deviation, gain * deviation], axis=-1)
    return [TermColumns(({"part": 0.0}, {"part": 1.0}), by_triangle=columns, joint=True)]


def _needs(load: LoadEstimate) -> str | None:
    """Return the reason why a recording cannot show the effect."""
    if load.observation.temperature_c is None:
        return "the reference has no temperature_c, and the thermal pads do not agree on one"
    spread = float(np.ptp(load.observation.temperature_c))
    if load.observation.temperature_is_in_counts:
        return None if spread >= LEAST_COUNT else f"the thermal pads move by less than {LEAST_COUNT:g} count"
    if spread < LEAST_K:
        return f"the temperature moves by less than {LEAST_K} K"
    return None


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return β, counts per kelvin, and γ, per kelvin."""
    return {"count_per_k": float(shares[0]), "gain_per_k": 0.01 * float(shares[1])}


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Return whether β is at most MOST_COUNT_PER_K."""
    return abs(float(shares[0])) <= MOST_COUNT_PER_K


TERM = Term(
    word="temperature",
    scopes=("insole", "board", "triangle"),
    share="free",
    columns=_columns,
    parameters=_parameters,
    plausible=0.05,
    limit=8.0,  # counts, or per cent of gain, per kelvin
    is_possible=_is_possible,
    needs=_needs,
    record_instead="an insole that warms up and cools down, with temperature_c in the reference",
    absorbs={"baseline": ABSORBED_K, "gain": ABSORBED_K * 0.01},
    misfit=0.01,
    likeness=0.3,
)
