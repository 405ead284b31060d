"""In which regime of the load an effect does its work, and when: told from what it explains, row by row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .fit import Evidence
from .naming import Tried

LEVELS = 10
MOST = 0.8  # of what is explained: the range of loads that holds it
MOSTLY = 0.6  # of it: one phase
QUANTILES = (0.1, 0.9)  # of it, by speed
STILL = 0.01  # of the span within a second: less is a hold
WINDOW_S = 5.0
NEARLY_ALL = 0.95  # of it: the stretch of time that holds it
SHORT = 0.6  # of the recording: longer, and it is there all the time
IDLE = 0.2  # of the load's doing that has to lie outside the stretch: else nothing could be seen there


@dataclass(frozen=True, slots=True, eq=False)
class Gain:
    """What an effect explains: n rows."""

    square: Array  # (n,) less of the sum of squares than without it
    load_pa: Array  # (n,)
    rate_pa_s: Array  # (n,)
    t_s: Array  # (n,)
    recording: NDArray[np.intp]  # (n,)


def gained(evidence: Evidence, without: Tried, best: Tried) -> Gain:
    """By the set `best` beyond the set `without`."""
    load_pa, recording = without.fitted.effective_pa.mean(axis=1), evidence.recording
    rate = [np.gradient(load_pa[recording == i], each.t_s) for i, each in enumerate(evidence.observed)]
    return Gain(
        np.sum(without.fitted.residual**2 - best.fitted.residual**2, axis=1), load_pa, np.concatenate(rate),
        np.concatenate([each.t_s for each in evidence.observed]), recording,
    )  # fmt: skip


def regime(gain: Gain) -> dict[str, Any]:
    """`pressure_pa` and `rate_pa_s` that hold most of it, and `phase` where one prevails."""
    span, total = float(np.ptp(gain.load_pa)), float(gain.square.sum())
    if not total > 0 or not span > 0:
        return {}
    edges = np.linspace(gain.load_pa.min(), gain.load_pa.max(), LEVELS + 1)
    level = np.clip(np.digitize(gain.load_pa, edges) - 1, 0, LEVELS - 1)
    a, b = _shortest(np.bincount(level, gain.square, LEVELS), MOST)
    found: dict[str, Any] = {"pressure_pa": [round(float(edges[a])), round(float(edges[b]))]}
    still, rising = np.abs(gain.rate_pa_s) < STILL * span, gain.rate_pa_s > 0
    for phase, rows in {"holding": still, "loading": ~still & rising, "unloading": ~still & ~rising}.items():
        if gain.square[rows].sum() > MOSTLY * total:
            found["phase"] = phase
    order = np.argsort(np.abs(gain.rate_pa_s))
    grown = np.cumsum(np.maximum(gain.square[order], 0.0))
    at = np.searchsorted(grown, np.array(QUANTILES) * grown[-1])
    found["rate_pa_s"] = np.round(np.abs(gain.rate_pa_s)[order][at]).astype(int).tolist()
    return found


def when(gain: Gain, recording: int) -> tuple[tuple[float, float], ...]:
    """The stretch of one recording in which nearly all is explained; empty where it is there all the time."""
    rows = gain.recording == recording
    t_s, load_pa = gain.t_s[rows], gain.load_pa[rows]
    window = ((t_s - t_s[0]) // WINDOW_S).astype(np.intp)
    own, load = np.bincount(window, gain.square[rows]), np.bincount(window, (load_pa - load_pa.min()) ** 2)
    if not own.sum() > 0 or not load.sum() > 0:
        return ()
    a, b = _shortest(own, NEARLY_ALL)
    if b - a > SHORT * len(own) or load[a:b].sum() > (1 - IDLE) * load.sum():
        return ()
    inside = t_s[(window >= a) & (window < b)]
    return ((float(inside[0]), float(inside[-1])),)


def _shortest(of_bins: NDArray[Any], share: float) -> tuple[int, int]:
    """From which to before which bin the shortest run lies that holds `share` of the whole."""
    total = np.concatenate([[0.0], np.cumsum(of_bins)])
    n = len(of_bins)
    holds = [(b - a, a, b) for a in range(n) for b in range(a + 1, n + 1) if total[b] - total[a] >= share * total[-1]]
    _, a, b = min(holds)
    return a, b
