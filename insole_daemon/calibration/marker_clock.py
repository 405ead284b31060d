"""Fit offset and rate between two clocks from events that both have recorded: triggers, or markers of an LSL stream.

    t_other = offset_s + (1 + rate)·t_own

Events are paired first, by the offset with which the most events agree. Offset and rate are then fitted by least
squares with the weights of `fit_clock`, so that a missed or a false trigger has no influence. Without markers but with
forces on both sides, `fit_clock` aligns the forces, as in the diagnosis; both return a `Clock`.
"""

from __future__ import annotations

import numpy as np

from ..errors import CalibrationError
from .clock import Array, Clock, tukey_weights

MAX_RATE = 500e-6  # largest rate between two crystal clocks
NEAR_S = 0.05  # largest distance of two paired events, beyond what the rate explains
MIN_PAIRS = 3  # pairs; offset and rate are two unknowns
_ROUNDS = 30
_MIN_STD_S = 1e-6


def fit_marker_clock(own_s: Array, other_s: Array) -> Clock:
    """Fit the clock of `other_s` (m,) relative to that of `own_s` (n,), both increasing.

    Raises CalibrationError if too few events agree on one offset, or on a rate that two crystal clocks do not have.
    """
    paired_own, paired_other = _pair_events(own_s, other_s)
    if len(paired_own) < MIN_PAIRS:
        raise CalibrationError(
            f"the clocks cannot be aligned: {len(own_s)} and {len(other_s)} markers, of which {len(paired_own)} agree "
            f"on one offset; expected {MIN_PAIRS} or more, at intervals that are not all the same"
        )
    middle = float(paired_own.mean())
    design = np.stack([np.ones_like(paired_own), paired_own - middle], axis=1)
    difference = paired_other - paired_own
    weight = np.ones(len(paired_own))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(design * root[:, None], difference * root, rcond=None)[0]
        residual = difference - design @ solution
        weight = tukey_weights(residual[:, None], _MIN_STD_S)
    degrees_of_freedom = max(float(weight.sum()) - 2.0, 1.0)
    covariance = (
        np.linalg.inv(design.T @ (design * weight[:, None])) * float((weight * residual**2).sum()) / degrees_of_freedom
    )
    rate, rate_std = float(solution[1]), float(np.sqrt(covariance[1, 1]))
    if abs(rate) > MAX_RATE:
        raise CalibrationError(
            f"the clocks cannot be aligned: {len(paired_own)} markers agree on one offset, but on a rate of "
            f"{1e6 * rate:.0f} ± {1e6 * rate_std:.0f} ppm, and two clocks differ by {1e6 * MAX_RATE:.0f} at most: "
            "expected markers from the beginning to the end of the trial"
        )
    to_zero = np.array([1.0, -middle])
    variance = float(((difference - difference.mean()) ** 2).sum())
    return Clock(
        offset_s=float(to_zero @ solution),
        rate=rate,
        offset_std_s=float(np.sqrt(to_zero @ covariance @ to_zero)),
        rate_std=rate_std,
        explained=1.0 - float((residual**2).sum()) / variance if variance > 0 else 1.0,
    )


def _pair_events(own_s: Array, other_s: Array) -> tuple[Array, Array]:
    """Return the events of both sides that belong together, one to one; none if two offsets are nearly as good.

    Of a regular series one event less agrees at the next offset: which one is right depends on what was missed.
    """
    if not len(own_s) or not len(other_s):
        return np.empty(0), np.empty(0)
    reach_s = NEAR_S + MAX_RATE * max(float(np.ptp(own_s)), float(np.ptp(other_s)))
    offsets = np.sort((other_s[:, None] - own_s[None, :]).ravel())
    n_agreeing = np.searchsorted(offsets, offsets + reach_s, side="right") - np.arange(len(offsets))
    best = int(n_agreeing.argmax())
    offset_s = float(np.median(offsets[best : best + int(n_agreeing[best])]))
    rivals = n_agreeing[np.abs(offsets - offset_s) > 2 * reach_s]
    if len(rivals) and int(rivals.max()) >= n_agreeing[best] - 1:
        return np.empty(0), np.empty(0)
    distance_s = np.abs(other_s[None, :] - own_s[:, None] - offset_s)
    nearest, nearest_own = distance_s.argmin(axis=1), distance_s.argmin(axis=0)
    own = np.arange(len(own_s))
    belongs = (nearest_own[nearest] == own) & (distance_s[own, nearest] <= reach_s)
    return own_s[belongs], other_s[nearest[belongs]]
