"""How much a memory moves readings beyond what a static curve could say."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...physics.law import Array
from ..finding import Quantity
from ..model.blocks import RECALIBRATIONS, BlockDesign
from ..model.refine import Refined
from ..model.solve import solve_companions

STD = 0.08  # of its value: materials of other families (benchmarks/diagnosis/families.py)
MOST_GONE = 0.9  # of the rows of the triangle at its place that has most: others have no part
LEAST_ROWS = 50
DEGREE = 3  # of the static curve
INNER = (0.002, 0.998)  # quantiles that stand for the ends: single rows are noise


def amplitude_fraction(refined: Refined[Any], i: int) -> Quantity:
    """Half the peak-to-peak of what candidate `i` contributes and no static curve could, over the span of the reading.

    With what a load before the recording has left in it and with what it has and its law has not. In Pa of the mean
    load at its place where that is known, because a curve that is off or flat would multiply it in counts; else in N.
    """
    moved, reading = _courses(refined, i)
    if len(reading) < LEAST_ROWS:
        return Quantity(0.0, 1.0, "1")
    x = (reading - reading.mean()) / max(float(reading.std()), 1e-12)
    static = np.stack([x**k for k in range(DEGREE + 1)], axis=1)
    left = moved - static @ np.linalg.lstsq(static, moved, rcond=None)[0]
    low, high = np.quantile(left, INNER)
    least, most = np.quantile(reading, INNER)
    value = 0.5 * float(high - low) / max(float(most - least), 1e-12)
    return Quantity(value, STD * value, "1")


def _courses(refined: Refined[Any], i: int) -> tuple[Array, Array]:
    """(n,) what the effect contributes, and the load or the reading."""
    design, candidate, shares = refined.design, refined.design.candidates[i], refined.shares[i]
    seen = design.load.observation
    if not isinstance(design, BlockDesign):
        known = design.weights[:, 0] > 0
        columns = design.raw[:, candidate.columns].reshape(len(design.weights), 3, -1)[:, 0]
        return (columns @ shares)[known] / design.weights[known, 0], seen.wrench[known, 0]
    place = design.mask[candidate.columns[0]]
    there = np.mean(design.weights > 0, axis=0)
    at = place & (there > MOST_GONE * there[place].max())
    known = np.asarray((design.weights[:, at] > 0).all(axis=1))
    beside, companion_shares = solve_companions(design, design.candidates, refined.shares)
    internal = sorted(
        column
        for column, word in zip(candidate.companions.tolist(), candidate.companion_words, strict=True)
        if word not in RECALIBRATIONS
    )
    columns = design.rows_of(np.array([*candidate.columns, *internal]))[at]  # (t, k, N)
    every = np.concatenate([shares, companion_shares[np.isin(beside, internal)]])
    moved_pa = np.matmul(every, columns).T[known] / design.weights[known][:, at]
    load_pa = np.broadcast_to(seen.reference.at(seen.reference_s), design.weights.shape)
    return moved_pa.mean(axis=1), load_pa[known][:, at].mean(axis=1)
