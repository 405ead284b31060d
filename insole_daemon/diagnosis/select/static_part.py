"""Identify a static effect that the search left to the curves of a chamber, beside a memory.

A calibration that was made while a memory acted contains up to all of the memory's mean curve, and its loads decide
whether it shows the quick response of the material or the whole one. A temperature of the set adds what it changed
between calibration and recording. The search leaves all this, and every static effect alike, to loose curves or to the
companions of the memory. Afterwards the mean error of the curves at load P is compared with c·m(P), 0 ≤ c ≤ 1, where m
is the mean effect of the memory on a reading at that load, beside one static effect of the whole insole:

- a stiffening, beside γ·a(P) + β, the gain and the baseline that calibration, quick response and temperature leave;
- a gain, if it describes the error, and κ·P·a′(P) does not: another response of the material, quick or slower than the
  recording is long, scales the load, and a gain the reading.

All of this changes the curves of all boards alike, so a gain or baseline of one board is fitted to the difference of
its error from that of the others.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
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
LEAST_CLASSES = 6  # of the load, to tell shapes of an error apart
LEAST_OTHERS = 2  # boards beside one with an effect
MOST_APART = 0.5  # RMS difference of any two of these, relative to the effect
ALIKE, MOST_TRIANGLES = 0.5, 0.75  # relative deviation of a place's share, and part of the triangles that keep to it
DESCRIBED = 0.15  # RMS that a gain may leave, in the noise of a reading: that of the smallest effect of a search
KNEES = np.array([0.0, 0.15, 0.3, 0.4, 0.5, 0.65])  # of a stiffening, relative to the largest load
SPANS = np.geomspace(0.3, 30.0, 15)  # of a stiffening, relative to the largest load


@dataclass(frozen=True, slots=True)
class StaticPart:
    """One static effect: stiffening or gain of the whole insole, or gain or baseline of a board."""

    word: str
    values: Mapping[str, float]
    square: float  # mean square of its effect on the readings, counts²
    std: float  # relative standard deviation of its size, from the residuals of the load classes
    where: Where = field(default_factory=Where)


def static_part(refined: Refined[BlockDesign]) -> tuple[StaticPart | None, bool]:
    """Return the stiffening or gain of the whole insole beside the memories of `refined`, and whether curves are off.

    They are off if the memory's mean curve leaves at least the size of a reported effect. None if usual curves are not,
    if neither effect describes the error, or if there are too few loads to tell.
    """
    boards = refined.design.seen.layout.identities[:, 0]
    places = [np.ones(len(boards), bool), *(boards == each for each in np.unique(boards))]
    error, *by_board = errors_by_load(refined, places)
    if len(error.load_pa) < LEAST_CLASSES:
        return None, False
    is_off = _left(error, error.after, []) > (LEAST_SIZE * error.noise_count) ** 2
    if not (is_off or refined.design.priors.has_loose_curves):
        return None, False
    return _stiffening(error) or _gain(error, by_board, {each.word for each in refined.design.candidates}), is_off


def _stiffening(error: ErrorByLoad) -> StaticPart | None:
    """Return the stiffening that describes the error.

    None if the memory's mean curve, a gain and a baseline are enough, if no stiffening describes the rest, or if the
    error without it is far larger than the memory's mean curve: the calibration was made otherwise, such as at few
    loads. A larger stiffening with a gain against it describes about the same, so of those with residuals up to SIMILAR
    times the least it is the smallest.
    """
    weights = _weights(error)
    beside = [shape for _, shape in _shapes(error)]
    most = MOST_LEFT * _left(error, error.after, beside)
    of_memory = float(np.sum((weights * error.memory) ** 2))
    least_square = max((LEAST_SIZE * error.noise_count) ** 2, LEAST_OF_MEMORY * of_memory)
    possible: list[tuple[float, StaticPart]] = []
    for values, column in _stiffenings(error):
        square = float(np.sum((weights * column) ** 2))
        residual = _left(error, error.after - column, beside)
        rest = float(np.sum((weights * (error.after - column)) ** 2))
        if square >= least_square and residual < most and rest < MOST_OF_MEMORY * of_memory:
            std = float(np.sqrt(residual / square / len(column)))
            possible.append((residual, StaticPart("stiffening", values, square, std)))
    if not possible:
        return None
    least = min(residual for residual, _ in possible)
    return min((part for residual, part in possible if residual <= SIMILAR * least), key=lambda part: part.square)


def _gain(error: ErrorByLoad, by_board: Sequence[ErrorByLoad], words: Collection[str]) -> StaticPart | None:
    """Return the gain that describes the error beside a set of these `words`.

    None if another response of the material describes it as well, if the boards do not show it alike, or beside a
    temperature, which leaves a gain. A viscoelasticity is over within the recording, so all that the calibration can
    have is a quicker response, which reads more than expected; a creep may go on, and a loop has no end.
    """
    if "temperature" in words:
        return None
    reading, weights = error.activation_count, _weights(error)
    scaled_load = error.load_pa * np.gradient(reading, error.load_pa)
    is_quick = not {"creep", "hysteresis", "snap"}.intersection(words)
    of_material = _left(error, error.after, [scaled_load], most=0.0 if is_quick else np.inf)
    residual = _left(error, error.after, [reading])
    if residual > min(MOST_LEFT * of_material, (DESCRIBED * error.noise_count) ** 2):
        return None
    share, *of_boards = (_fitted(each, each.after, [each.activation_count])[1] for each in (error, *by_board))
    square = float(np.sum((weights * share * reading) ** 2))
    is_alike = all(abs(own - share) <= ALIKE * abs(share) for own in of_boards)
    if square < (LEAST_SIZE * error.noise_count) ** 2 or not is_alike:
        return None
    return StaticPart("gain", _values("gain", share), square, float(np.sqrt(residual / square / len(reading))))


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
    return {"gain": 1.0 - float(share)} if word == "gain" else {"shift_count": float(share)}


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
        weights = _weights(error)
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


def _weights(error: ErrorByLoad) -> Array:
    """Return the weights (k,) of the load classes in a mean square."""
    return np.asarray(np.sqrt(error.rows / error.rows.sum()))


def _left(error: ErrorByLoad, rest: Array, beside: Sequence[Array], most: float = np.inf) -> float:
    """Return the mean square of `rest` (k,) after the fit of `_fitted`, counts²."""
    coefficients = _fitted(error, rest, beside, most)
    fitted = np.stack([error.memory, *beside], axis=1) @ coefficients
    return float(np.sum((_weights(error) * (rest - fitted)) ** 2))


def _fitted(error: ErrorByLoad, rest: Array, beside: Sequence[Array], most: float = np.inf) -> Array:
    """Return the coefficients (1 + n,) of the memory's mean curve, 0 to 1, and of n columns `beside`, up to `most`."""
    columns = np.stack([error.memory, *beside], axis=1)
    size = np.sqrt(np.sum(columns**2, axis=0)) + 1e-12
    bounds = ([0.0, *(-np.inf for _ in beside)], [size[0], *(most for _ in beside)])
    weights = _weights(error)
    return np.asarray(lsq_linear(weights[:, None] * columns / size, weights * rest, bounds).x / size)
