"""Which static word describes what curves are off by beside a memory, where they were refitted with it.

A calibration that was made with a memory at work contains up to all of its mean curve, and loose curves take that and
any recalibration alike. By the load they are off by c·m(P) + s(P), 0 ≤ c ≤ 1: m is what the memory moves readings by
on average at that load, and s what one static word does. A word is named that c·m alone does not replace.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from ...physics.law import Array
from ..model.blocks import BlockDesign
from ..model.refine import Refined
from .count_figures import OffByLoad, off_by_load

LEAST_SIZE = 2.0  # of a reading's noise, RMS over the rows
MOST_LEFT = 0.5  # of the mean square that the memory's mean curve leaves, that the word may leave
KNEES = np.array([0.0, 0.15, 0.3, 0.4, 0.5, 0.65])  # of the largest load
SPANS = np.geomspace(0.3, 30.0, 15)  # times the largest load


@dataclass(frozen=True, slots=True)
class StaticPart:
    """One static word of the whole insole."""

    word: str
    values: Mapping[str, float]
    square: float = 0.0  # mean square of what it moves readings by, counts²
    std: float = 0.0  # of its size, as a share of it: by what the classes of the load leave


def static_part(refined: Refined[BlockDesign]) -> StaticPart | None:
    """The static word beside the memories of `refined`; None where none is needed, or none is enough."""
    off = off_by_load(refined)
    weights = np.sqrt(off.rows / off.rows.sum())
    best, least = None, MOST_LEFT * _left(off, np.zeros_like(off.after), weights)
    for part, column in _parts(off, weights):
        square = float(np.sum((weights * column) ** 2))
        if square < (LEAST_SIZE * off.noise_count) ** 2:
            continue
        left = _left(off, column, weights)
        if left < least:
            best, least = replace(part, square=square, std=float(np.sqrt(left / square / len(column)))), left
    # What creep has kept of loads before the recording hardly changes while that lasts, and is no new baseline.
    has_creep = any(each.word == "creep" for each in refined.design.candidates)
    return None if best is not None and best.word == "baseline" and has_creep else best


def _parts(off: OffByLoad, weights: Array) -> Iterator[tuple[StaticPart, Array]]:
    """Every word with its best share, or at each of its settings, and what (k,) it moves readings by."""
    for word, column in (("gain", off.activation_count), ("baseline", np.ones_like(off.after))):
        share = _share(off, column, weights)
        values = {"gain": 1.0 - share} if word == "gain" else {"shift_count": share}
        yield StaticPart(word, values), share * column
    highest = float(off.load_pa.max())
    for knee_pa in highest * KNEES:
        over = np.maximum(off.load_pa - knee_pa, 0.0)
        for span_pa in highest * SPANS:
            felt = off.load_pa - over + over * span_pa / (span_pa + over)
            less = off.activation_count - np.interp(felt, off.load_pa, off.activation_count)
            yield StaticPart("stiffening", {"knee_pa": float(knee_pa), "span_pa": float(span_pa)}), less


def _left(off: OffByLoad, column: Array, weights: Array) -> float:
    """Mean square of what `column` and the best part of the memory's mean curve leave, counts²."""
    rest, moved = weights * (off.after - column), weights * off.moved
    part = np.clip(rest @ moved / max(float(moved @ moved), 1e-12), 0.0, 1.0)
    return float(np.sum((rest - part * moved) ** 2))


def _share(off: OffByLoad, column: Array, weights: Array) -> float:
    """Of `column`, beside the memory's mean curve."""
    columns = np.stack([off.moved, column], axis=1) * weights[:, None]
    found = lsq_linear(columns, weights * off.after, ([0.0, -np.inf], [1.0, np.inf])).x
    return float(found[1])
