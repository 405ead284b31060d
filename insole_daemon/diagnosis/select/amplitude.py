"""Amplitude of a memory: the part of its effect that no static curve of the reading describes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...physics.law import Array
from ..finding import Quantity
from ..model.blocks import RECALIBRATIONS, BlockDesign
from ..model.refine import Refined
from ..model.solve import solve_companions

STD = 0.13  # relative, over laws and calibrations of blind chambers: 1.5 times the median error (docs/evidence)
STD_ON_WALKS = 0.3  # the same of f_z, for which a foot that rolls passes the same force under different triangles
MOST_GONE = 0.9  # of the rows that the most complete triangle at its place has: others are left out
LEAST_ROWS = 50  # for a fit of the static curve
DEGREE = 3  # of the polynomial that is fitted as the static curve
INNER = (0.002, 0.998)  # quantiles that stand for minimum and maximum, which single noisy rows would decide


def amplitude_fraction(refined: Refined[Any], i: int) -> Quantity:
    """Return the amplitude of a memory without its static part, as a fraction of the range of the load.

    The amplitude is half the peak-to-peak of the contribution's residual after regression on a cubic of the load.
    `i`: number of the candidate in `refined`; its contribution includes its internal companions (uneven material, load
    before the recording). Amplitude and load are in Pa, as means of the place, if the load is known on every taxel: in
    counts, an error or a flat part of a static curve would scale them. Otherwise both are of f_z, in N.
    """
    contribution, load = _contribution_and_load(refined, i)
    if len(load) < LEAST_ROWS:
        return Quantity(0.0, 1.0, "1")
    x = (load - load.mean()) / max(float(load.std()), 1e-12)
    static = np.stack([x**k for k in range(DEGREE + 1)], axis=1)
    dynamic = contribution - static @ np.linalg.lstsq(static, contribution, rcond=None)[0]
    low, high = np.quantile(dynamic, INNER)
    lowest_load, highest_load = np.quantile(load, INNER)
    value = 0.5 * float(high - low) / max(float(highest_load - lowest_load), 1e-12)
    std = STD if isinstance(refined.design, BlockDesign) else STD_ON_WALKS
    return Quantity(value, std * value, "1")


def _contribution_and_load(refined: Refined[Any], i: int) -> tuple[Array, Array]:
    """Return the contribution of candidate `i` (n,) and the load (n,), in Pa if the load is known, else f_z in N.

    If the load is not known, the wrench computed from the readings stands for it.
    """
    design, candidate, shares = refined.design, refined.design.candidates[i], refined.shares[i]
    seen = design.load.observation
    if not isinstance(design, BlockDesign):
        known = design.weights[:, 0] > 0
        columns = design.raw[:, candidate.columns].reshape(len(design.weights), 3, -1)[:, 0]
        return (columns @ shares)[known] / design.weights[known, 0], seen.wrench[known, 0]
    place = design.mask[candidate.columns[0]]
    completeness = np.mean(design.weights > 0, axis=0)
    at = place & (completeness > MOST_GONE * completeness[place].max())
    known = np.asarray((design.weights[:, at] > 0).all(axis=1))
    companions, companion_shares = solve_companions(design, design.candidates, refined.shares)
    internal = sorted(
        column
        for column, word in zip(candidate.companions.tolist(), candidate.companion_words, strict=True)
        if word not in RECALIBRATIONS
    )
    columns = design.rows_of(np.array([*candidate.columns, *internal]))[at]  # (t, k, N)
    all_shares = np.concatenate([shares, companion_shares[np.isin(companions, internal)]])
    contribution_pa = np.matmul(all_shares, columns).T[known] / design.weights[known][:, at]
    load_pa = np.broadcast_to(seen.reference.at(seen.reference_s), design.weights.shape)
    return contribution_pa.mean(axis=1), load_pa[known][:, at].mean(axis=1)
