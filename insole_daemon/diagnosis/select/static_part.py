"""Identify a static effect beside a memory, if the search used loose curves.

A calibration that was made while a memory acted contains up to all of the memory's mean curve, and its loads decide
whether it shows the quick response of the material or the whole one. A temperature of the set adds what it changed
between calibration and recording. Loose curves absorb all this and every static effect alike, so none is a term of the
search. Afterwards the mean error of the curves at load P is fitted as c·m(P) + γ·a(P) + β + s(P), 0 ≤ c ≤ 1: m is the
mean effect of the memory on a reading at that load, γ and β are the gain and the baseline that calibration, quick
response and temperature leave, and s is a stiffening of the whole insole. It is reported if the rest alone leaves
clearly more. All of this changes the curves of all boards alike, so a gain or baseline of one board is fitted to the
difference of its error from that of the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import lsq_linear

from ...physics.effect import Where
from ...physics.law import Array
from ..model.blocks import BlockDesign
from ..model.refine import Refined
from .count_errors import ErrorByLoad, errors_by_load

LEAST_SIZE = 2.0  # RMS of the effect over the rows, in the noise of a reading
MOST_LEFT = 0.5  # of the mean square that the memory's mean curve alone leaves
MOST_OF_MEMORY = 2.0  # mean square of the error without a stiffening, in that of the memory's mean curve
LEAST_OF_MEMORY = 0.1  # mean square of a stiffening, in that of the memory's mean curve, which is known less exactly
SIMILAR = 2.0  # times the smallest residual
LEAST_OTHERS = 2  # boards beside one with an effect
MOST_APART = 0.5  # RMS difference of any two of these, relative to the effect
ALIKE, MOST_TRIANGLES = 0.5, 0.75  # relative deviation of a triangle's share, and part of the triangles that keep to it
KNEES = np.array([0.0, 0.15, 0.3, 0.4, 0.5, 0.65])  # of a stiffening, relative to the largest load
SPANS = np.geomspace(0.3, 30.0, 15)  # of a stiffening, relative to the largest load


@dataclass(frozen=True, slots=True)
class StaticPart:
    """One static effect: stiffening of the whole insole, or gain or baseline of a board."""

    word: str
    values: Mapping[str, float]
    square: float  # mean square of its effect on the readings, counts²
    std: float  # relative standard deviation of its size, from the residuals of the load classes
    where: Where = field(default_factory=Where)


def static_part(refined: Refined[BlockDesign]) -> StaticPart | None:
    """Return the stiffening beside the memories of `refined` that describes the error, or None.

    None if the memory's mean curve, a gain and a baseline are enough, if no stiffening describes the rest, or if the
    error without it is far larger than the memory's mean curve: the calibration was made otherwise, such as at few
    loads. A larger stiffening with a gain against it describes about the same, so of those with residuals up to SIMILAR
    times the least it is the smallest.
    """
    error = errors_by_load(refined, [np.ones(len(refined.design.seen.layout), bool)])[0]
    weights = np.sqrt(error.rows / error.rows.sum())
    most = MOST_LEFT * _residual_square(error, np.zeros_like(error.after), weights)
    of_memory = float(np.sum((weights * error.memory) ** 2))
    least_square = max((LEAST_SIZE * error.noise_count) ** 2, LEAST_OF_MEMORY * of_memory)
    possible: list[tuple[float, StaticPart]] = []
    for values, column in _stiffenings(error):
        square = float(np.sum((weights * column) ** 2))
        residual = _residual_square(error, column, weights)
        rest = float(np.sum((weights * (error.after - column)) ** 2))
        if square >= least_square and residual < most and rest < MOST_OF_MEMORY * of_memory:
            std = float(np.sqrt(residual / square / len(column)))
            possible.append((residual, StaticPart("stiffening", values, square, std)))
    if not possible:
        return None
    least = min(residual for residual, _ in possible)
    return min((part for residual, part in possible if residual <= SIMILAR * least), key=lambda part: part.square)


def _stiffenings(error: ErrorByLoad) -> Iterator[tuple[dict[str, float], Array]]:
    """Yield the parameters of every setting of KNEES and SPANS, and its change of the readings (k,), counts."""
    highest = float(error.load_pa.max())
    for knee_pa in highest * KNEES:
        over = np.maximum(error.load_pa - knee_pa, 0.0)
        for span_pa in highest * SPANS:
            felt = error.load_pa - over + over * span_pa / (span_pa + over)
            less = error.activation_count - np.interp(felt, error.load_pa, error.activation_count)
            yield {"knee_pa": float(knee_pa), "span_pa": float(span_pa)}, less


def _shapes(error: ErrorByLoad) -> tuple[tuple[str, Array], ...]:
    """Return gain and baseline with the change of the readings (k,) for a share of 1, counts."""
    return ("gain", error.activation_count), ("baseline", np.ones_like(error.after))


def _values(word: str, share: float) -> dict[str, float]:
    return {"gain": 1.0 - share} if word == "gain" else {"shift_count": share}


def static_part_of_board(refined: Refined[BlockDesign]) -> StaticPart | None:
    """Return the gain or baseline by which one board differs from all others; None if there is none.

    The others have to agree with each other, one shape has to describe the difference at all loads, and most triangles
    of the board have to show it.
    """
    boards = refined.design.seen.layout.identities[:, 0]
    addresses = np.unique(boards).tolist()
    if len(addresses) <= LEAST_OTHERS:
        return None
    places = [boards == each for each in addresses] + list(np.eye(len(boards), dtype=bool))
    errors = errors_by_load(refined, places)
    by_board, by_triangle = errors[: len(addresses)], errors[len(addresses) :]
    best = None
    for i, (address, error) in enumerate(zip(addresses, by_board, strict=True)):
        weights = np.sqrt(error.rows / error.rows.sum())
        others = [other.after for j, other in enumerate(by_board) if j != i]
        mean = np.mean(others, axis=0)
        apart = max(float(np.sum((weights * (one - other)) ** 2)) for one in others for other in others)
        for word, shape in _shapes(error):
            share, square, left = _difference(error.after - mean, shape, weights)
            is_clear = square > (LEAST_SIZE * error.noise_count) ** 2 and apart < MOST_APART**2 * square
            if not is_clear or left > MOST_LEFT * (square + left) or (best is not None and left >= best[0]):
                continue
            own = [
                _difference(by_triangle[row].after - mean, shape, weights)[0] / share
                for row in np.flatnonzero(boards == address).tolist()
            ]
            if np.mean(np.abs(np.array(own) - 1.0) < ALIKE) > MOST_TRIANGLES:
                std = float(np.sqrt(left / square / len(shape)))
                where = Where("board", ((address,),))
                on_insole = square * float(np.mean(boards == address))
                best = left, StaticPart(word, _values(word, share), on_insole, std, where)
    return None if best is None else best[1]


def _difference(rest: Array, shape: Array, weights: Array) -> tuple[float, float, float]:
    """Return the share of `shape` (k,) in `rest` (k,), and the mean squares of the two parts, counts²."""
    y, column = weights * rest, weights * shape
    share = float(y @ column / max(float(column @ column), 1e-12))
    return share, share**2 * float(column @ column), float(np.sum((y - share * column) ** 2))


def _residual_square(error: ErrorByLoad, column: Array, weights: Array) -> float:
    """Return the mean square of error − `column` beside c·memory, 0 ≤ c ≤ 1, a gain and a baseline, counts²."""
    columns = np.stack([error.memory, *(shape for _, shape in _shapes(error))], axis=1) * weights[:, None]
    bounds = ([0.0, -np.inf, -np.inf], [1.0, np.inf, np.inf])
    return float(2.0 * lsq_linear(columns, weights * (error.after - column), bounds).cost)
