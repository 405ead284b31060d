"""Fit the shares of a set of candidates: a small least squares problem with constraints of sign and sum."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear, nnls

from ...physics.law import Array
from .regression import PlacedTerm, Regression

LEAST_EIGENVALUE = 1e-4  # of the Gram matrix of columns scaled to 1; smaller ones are raised to it
RIDGE = 1e-6  # relative to a column's square: coefficients that the data do not determine stay near 0
FIRST_SHARE = 0.06  # of a term, for the prior of its companions, before its shares are known
SETTLED = 0.05  # relative change of shares at which the iteration ends
PULL, TOLERANCE = 100.0, 1e-3  # least weight in a row that holds a sum at its bound, and tolerance of the bound
LEAST_VARIANCE = 1e-8  # of a companion
MOST_ABSORBED = 2.0  # largest companion, in prior standard deviations: no larger than the memory itself


def solve_shares(design: Regression, chosen: Sequence[PlacedTerm]) -> tuple[tuple[Array, ...], float]:
    """Return the shares of `chosen`, and the reduction of the residual sum of squares by them and their companions.

    Companions, the static part of a term that a calibration may have absorbed, have priors proportional to the term's
    shares, so priors and shares are fitted in turn. A companion is at most MOST_ABSORBED standard deviations.
    """
    if not chosen:
        return (), 0.0
    shares: list[Array] = [np.empty(0)] * len(chosen)
    cross, gain = design.cross, 0.0
    whole = [i for i, candidate in enumerate(chosen) if candidate.term.share == "whole"]
    fixed = np.concatenate([chosen[i].columns for i in whole] or [np.empty(0, np.intp)])
    if len(fixed):
        gain += float(2 * cross[fixed].sum() - design.gram[fixed[:, None], fixed].sum())
        cross = cross - design.gram[:, fixed].sum(axis=1)
        for i in whole:
            shares[i] = np.ones(len(chosen[i].columns))
    rest = [i for i in range(len(chosen)) if i not in whole]
    if rest:
        own_columns = np.concatenate([chosen[i].columns for i in rest])
        companions = _companions([chosen[i] for i in rest], own_columns)
        columns = np.concatenate([own_columns, companions])
        positive = np.concatenate([np.full(len(chosen[i].columns), chosen[i].term.share == "positive") for i in rest])
        positive = np.concatenate([positive, np.zeros(len(companions), bool)])
        gram = with_ridge(design.gram[columns[:, None], columns])
        variances = _absorbed_variances(chosen, companions)
        strengths = [
            FIRST_SHARE * (1.0 if not candidate.term.plausible else candidate.term.plausible / 0.1)
            for candidate in chosen
        ]
        k = len(own_columns)
        sums = _sums([chosen[i] for i in rest], design.load.is_known)
        for _ in range(3 if len(companions) else 1):
            std = _std(variances, strengths)
            with_priors = gram + np.diag(np.concatenate([np.zeros(k), std**-2.0]))
            coefficients = bounded(with_priors, cross[columns], positive, sums)
            _assign_shares(coefficients, chosen, rest, shares)
            before = [strengths[i] for i in rest]
            for i in rest:
                strengths[i] = float(np.abs(shares[i]).sum())
            if all(abs(strengths[i] - old) <= SETTLED * strengths[i] for i, old in zip(rest, before, strict=True)):
                break
        bound = np.concatenate([np.full(k, np.inf), MOST_ABSORBED * _std(variances, strengths)])
        if np.any(np.abs(coefficients) > bound):
            # Under a known load companions are many. Fitted together they take up effects that no law describes.
            if design.load.is_known:
                coefficients = _held_in_turn(coefficients, with_priors, cross[columns], positive, bound, sums)
            else:
                coefficients = _within(with_priors, cross[columns], positive, bound, sums)
        _assign_shares(coefficients, chosen, rest, shares)
        gain += float(2 * coefficients @ cross[columns] - coefficients @ with_priors @ coefficients)
    return tuple(shares), gain


def with_ridge(gram: Array) -> Array:
    """Return a Gram matrix (k, k) with the part RIDGE of its diagonal added, so that it can be inverted."""
    return np.asarray(gram + np.diag(RIDGE * np.diag(gram) + 1e-12))


def _sums(chosen: Sequence[PlacedTerm], load_is_known: bool) -> list[tuple[slice, float]]:
    """Return the slice of the shares of each candidate whose sum has a bound, and the bound."""
    sums, start = [], 0
    for candidate in chosen:
        shares = slice(start, start + len(candidate.columns))
        start = shares.stop
        if np.isfinite(bound := candidate.term.sum_bound(load_is_known)):
            sums.append((shares, bound))
    return sums


def _assign_shares(coefficients: Array, chosen: Sequence[PlacedTerm], rest: Sequence[int], shares: list[Array]) -> None:
    """Set `shares` of the candidates numbered `rest`, whose `coefficients` follow each other."""
    start = 0
    for i in rest:
        shares[i] = coefficients[start : start + len(chosen[i].columns)]
        start += len(chosen[i].columns)


def solve_companions(
    design: Regression, chosen: Sequence[PlacedTerm], shares: Sequence[Array]
) -> tuple[NDArray[np.intp], Array]:
    """Return the columns (k,) of the companions of `chosen` and their coefficients (k,), for given `shares`."""
    own = np.concatenate([candidate.columns for candidate in chosen])
    companions = _companions(chosen, own)
    std = absorbed_std(chosen, [float(np.abs(of_term).sum()) for of_term in shares], companions)
    remainder = design.cross[companions] - design.gram[companions[:, None], own] @ np.concatenate(shares)
    gram = design.gram[companions[:, None], companions]
    coefficients = (
        np.linalg.solve(gram + np.diag(RIDGE * np.diag(gram) + std**-2.0), remainder) if len(companions) else remainder
    )
    return companions, np.clip(coefficients, -MOST_ABSORBED * std, MOST_ABSORBED * std)


def is_possible(chosen: Sequence[PlacedTerm], shares: Sequence[Array], load_is_known: bool) -> bool:
    """Return whether the laws of all terms are valid with these shares (`Term.limit`, `Term.is_possible`)."""
    return all(
        float(np.abs(own).max()) <= candidate.term.limit
        and candidate.term.is_possible(candidate.settings, own, load_is_known or candidate.term.is_of_load)
        for own, candidate in zip(shares, chosen, strict=True)
    )


def absorbed_std(chosen: Sequence[PlacedTerm], strengths: Sequence[float], columns: NDArray[np.intp]) -> Array:
    """Return the prior standard deviations (k,) of the companions `columns` (k,) of terms.

    `strengths`: sum of the absolute shares of each term. Variances of a companion of several terms add up.
    """
    return _std(_absorbed_variances(chosen, columns), strengths)


def _absorbed_variances(chosen: Sequence[PlacedTerm], columns: NDArray[np.intp]) -> Array:
    """Return the prior variances (n, k) of the companions `columns` (k,) of each term at a strength of 1."""
    position = {column: k for k, column in enumerate(columns.tolist())}
    variances = np.zeros((len(chosen), len(columns)))
    for own, candidate in zip(variances, chosen, strict=True):
        for column, std in zip(candidate.companions.tolist(), candidate.companion_std, strict=True):
            if column in position:
                own[position[column]] += std**2
    return variances


def _std(variances: Array, strengths: Sequence[float]) -> Array:
    """Return standard deviations (k,) from the `variances` (n, k) of terms with these `strengths` (n)."""
    return np.asarray(np.sqrt(LEAST_VARIANCE + np.square(strengths) @ variances))


def _companions(chosen: Sequence[PlacedTerm], own: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the columns of the companions of `chosen` in ascending order, without their `own` columns."""
    columns = {column for candidate in chosen for column in candidate.companions.tolist()}
    return np.array(sorted(columns.difference(own.tolist())), np.intp)


def bounded(gram: Array, cross: Array, positive: NDArray[np.bool_], sums: Sequence[tuple[slice, float]] = ()) -> Array:
    """Return θ (p,) that minimises θᵀ·gram·θ − 2·crossᵀ·θ under the constraints θ ≥ 0 where `positive`, and `sums`.

    `sums`: slices of θ, all positive, with the upper bound of the sum of each. Free coefficients are eliminated; the
    rest is a problem of non-negative least squares (Lawson and Hanson, Solving least squares problems, 1974).
    """
    scale = np.sqrt(np.diag(gram))
    gram, cross = gram / scale[:, None] / scale, cross / scale
    free = ~positive
    theta = np.empty(len(cross))
    reduced, right = gram[positive][:, positive], cross[positive]
    if free.any():
        between = gram[free][:, positive]
        of_free = np.linalg.solve(gram[free][:, free], np.column_stack([between, cross[free]]))
        reduced = reduced - between.T @ of_free[:, :-1]
        right = right - between.T @ of_free[:, -1]
    if positive.any():
        within = [(pull[positive], bound) for pull, bound in _pulls(sums, scale)]
        theta[positive] = _least_squares(reduced, right, within, lambda rows, target: nnls(rows, target)[0])
    if free.any():
        theta[free] = of_free[:, -1] - of_free[:, :-1] @ theta[positive]
    return theta / scale


def _held_in_turn(
    theta: Array,
    gram: Array,
    cross: Array,
    positive: NDArray[np.bool_],
    bound: Array,
    sums: Sequence[tuple[slice, float]],
) -> Array:
    """Return θ (p,) with |θ| ≤ `bound` from the result `theta` of `bounded`, which is overwritten.

    What exceeds its bound is held there, and the rest is fitted again. Free coefficients come after those of `sums`, so
    these keep their places.
    """
    held = np.zeros(len(theta), bool)
    while np.any(over := ~held & (np.abs(theta) > bound)):
        held |= over
        theta[held] = np.clip(theta[held], -bound[held], bound[held])
        remainder = cross - gram[:, held] @ theta[held]
        theta[~held] = bounded(gram[~held][:, ~held], remainder[~held], positive[~held], sums)
    return theta


def _within(
    gram: Array, cross: Array, positive: NDArray[np.bool_], bound: Array, sums: Sequence[tuple[slice, float]]
) -> Array:
    """Return the best θ (p,) as `bounded` with |θ| ≤ `bound`.

    Bounded-variable least squares (Stark and Parker, Comput. Stat. 10 (1995) 129).
    """
    scale = np.sqrt(np.diag(gram))
    bounds = np.where(positive, 0.0, -bound) * scale, bound * scale
    theta = _least_squares(
        gram / scale[:, None] / scale, cross / scale, _pulls(sums, scale),
        lambda rows, target: lsq_linear(rows, target, bounds, method="bvls").x,
    )  # fmt: skip
    return theta / scale


def _pulls(sums: Sequence[tuple[slice, float]], scale: Array) -> list[tuple[Array, float]]:
    """Return the row (p,) and the bound of each sum of coefficients, for columns scaled to 1."""
    pulls = []
    for own, bound in sums:
        pull = np.zeros(len(scale))
        pull[own] = 1.0 / scale[own]
        pulls.append((pull, bound))
    return pulls


def _least_squares(
    gram: Array, cross: Array, sums: Sequence[tuple[Array, float]], solve: Callable[[Array, Array], Array]
) -> Array:
    """Return θ (p,) by `solve` of rows and target, with the bound of each sum row @ θ.

    `gram` is that of columns scaled to 1. A sum above its bound is held there by a heavily weighted row.
    """
    values, vectors = np.linalg.eigh(gram)
    root = np.sqrt(np.maximum(values, LEAST_EIGENVALUE))
    rows, target = root[:, None] * vectors.T, (vectors.T @ cross) / root
    theta = solve(rows, target)
    held: set[int] = set()
    while over := {k for k, (pull, bound) in enumerate(sums) if float(pull @ theta) > bound * (1.0 + TOLERANCE)}:
        if over <= held:
            break
        held |= over
        for pull, bound in (sums[k] for k in over):
            size = PULL / float(pull[pull > 0.0].min())  # enough for the largest column, too
            rows, target = np.vstack([rows, size * pull]), np.append(target, size * bound)
        theta = solve(rows, target)
    return theta
