"""Offset and rate between two clocks from moments that both have seen: triggers, or markers of an LSL stream.

    t_other = offset_s + (1 + rate)·t_own

Moments are paired first: of all offsets between two moments, the one that most moments agree with. Then offset and rate
are fitted by least squares with the weights of `fit_clock`, so that a missed or a false trigger does not pull. Where
there are no markers but forces on both sides, `fit_clock` aligns the forces, as in the diagnosis; both give a `Clock`.
"""

from __future__ import annotations

import numpy as np

from ..errors import CalibrationError
from .clock import Array, Clock, tukey_weights

MOST_RATE = 500e-6  # of two clocks of crystals
NEAR_S = 0.05  # beyond what the rate explains: two moments farther apart are not the same
FEWEST = 3  # pairs, of which offset and rate are two unknowns
_MOST_STEPS = 30
_LEAST_STD_S = 1e-6


def fit_marker_clock(own_s: Array, other_s: Array) -> Clock:
    """The clock of `other_s` (m,) against that of `own_s` (n,), increasing; CalibrationError where too few agree."""
    own, other = _paired(own_s, other_s)
    if len(own) < FEWEST:
        raise CalibrationError(
            f"the clocks cannot be aligned: {len(own_s)} and {len(other_s)} markers, of which {len(own)} agree on one "
            f"offset; expected {FEWEST} or more, at intervals that are not all the same"
        )
    middle = float(own.mean())
    design = np.stack([np.ones_like(own), own - middle], axis=1)
    difference = other - own
    weight = np.ones(len(own))
    for _ in range(_MOST_STEPS):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(design * root[:, None], difference * root, rcond=None)[0]
        left = difference - design @ solution
        weight = tukey_weights(left[:, None], _LEAST_STD_S)
    freedom = max(float(weight.sum()) - 2.0, 1.0)
    covariance = np.linalg.inv(design.T @ (design * weight[:, None])) * float((weight * left**2).sum()) / freedom
    to_zero = np.array([1.0, -middle])
    variance = float(((difference - difference.mean()) ** 2).sum())
    return Clock(
        offset_s=float(to_zero @ solution),
        rate=float(solution[1]),
        offset_std_s=float(np.sqrt(to_zero @ covariance @ to_zero)),
        rate_std=float(np.sqrt(covariance[1, 1])),
        explained=1.0 - float((left**2).sum()) / variance if variance > 0 else 1.0,
    )


def _paired(own_s: Array, other_s: Array) -> tuple[Array, Array]:
    """The moments of both sides that belong together; none where two offsets are as good as each other."""
    if not len(own_s) or not len(other_s):
        return np.empty(0), np.empty(0)
    reach_s = NEAR_S + MOST_RATE * max(float(np.ptp(own_s)), float(np.ptp(other_s)))
    offsets = np.sort((other_s[:, None] - own_s[None, :]).ravel())
    within = np.searchsorted(offsets, offsets + reach_s, side="right") - np.arange(len(offsets))
    best = int(within.argmax())
    offset_s = float(np.median(offsets[best : best + int(within[best])]))
    rivals = within[np.abs(offsets - offset_s) > 2 * reach_s]
    if len(rivals) and int(rivals.max()) >= within[best]:
        return np.empty(0), np.empty(0)
    nearest = np.abs(other_s[None, :] - own_s[:, None] - offset_s).argmin(axis=1)
    close = np.abs(other_s[nearest] - own_s - offset_s) <= reach_s
    return own_s[close], other_s[nearest[close]]
