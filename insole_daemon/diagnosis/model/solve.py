"""Shares of a set of candidates: a small least squares problem with signs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ...physics.law import Array
from .regression import PlacedTerm, Regression

LEAST_EIGENVALUE = 1e-4  # of columns scaled to 1: what is less is not determined
RIDGE = 1e-6  # of a column's own square: what is not determined stays near 0
FIRST_SHARE = 0.06  # of a term, for the prior of the static part it may have left, before its shares are known
SETTLED = 0.05  # by which shares may still change
PULL, TOLERANCE = 100.0, 1e-3  # towards the bound on a sum, of a column's size; what is over it by less is at it
MOST_ABSORBED = 2.0  # standard deviations: the mean curve of a memory is no larger than the memory


def solve_shares(design: Regression, chosen: Sequence[PlacedTerm]) -> tuple[tuple[Array, ...], float]:
    """Shares of `chosen` within their signs, and the squared residual they take away.

    The static part that a calibration may have absorbed of a term is fitted beside it, within a prior as wide as
    the term's own shares make it, and never larger than these.
    """
    if not chosen:
        return (), 0.0
    shares: list[Array] = [np.empty(0)] * len(chosen)
    cross, gain = design.cross, 0.0
    whole = [i for i, each in enumerate(chosen) if each.term.share == "whole"]
    fixed = np.concatenate([chosen[i].columns for i in whole] or [np.empty(0, np.intp)])
    if len(fixed):
        gain += float(2 * cross[fixed].sum() - design.gram[np.ix_(fixed, fixed)].sum())
        cross = cross - design.gram[:, fixed].sum(axis=1)
        for i in whole:
            shares[i] = np.ones(len(chosen[i].columns))
    rest = [i for i in range(len(chosen)) if i not in whole]
    if rest:
        own_columns = np.concatenate([chosen[i].columns for i in rest])
        beside = [chosen[i].companions for i in rest if len(chosen[i].companions)]
        extra = np.setdiff1d(np.concatenate(beside), own_columns) if beside else np.empty(0, np.intp)
        columns = np.concatenate([own_columns, extra])
        positive = np.concatenate([np.full(len(chosen[i].columns), chosen[i].term.share == "positive") for i in rest])
        positive = np.concatenate([positive, np.zeros(len(extra), bool)])
        plain = design.gram[np.ix_(columns, columns)]
        plain = plain + np.diag(RIDGE * np.diag(plain) + 1e-12)
        strengths = [FIRST_SHARE * (1.0 if not each.term.plausible else each.term.plausible / 0.1) for each in chosen]
        k = len(own_columns)
        sums = _sums([chosen[i] for i in rest], design.load.is_known)
        for _ in range(3 if len(extra) else 1):
            std = absorbed_std(chosen, strengths, extra)
            own = plain + np.diag(np.concatenate([np.zeros(k), std**-2.0]))
            found = bounded(own, cross[columns], positive, sums)
            _hand_out(found, chosen, rest, shares)
            before = [strengths[i] for i in rest]
            for i in rest:
                strengths[i] = float(np.abs(shares[i]).sum())
            if np.allclose(before, [strengths[i] for i in rest], rtol=SETTLED):
                break
        most = MOST_ABSORBED * absorbed_std(chosen, strengths, extra)
        held = np.zeros(len(found), bool)
        most = np.concatenate([np.full(k, np.inf), most])
        while np.any(over := ~held & (np.abs(found) > most)):
            held |= over
            found[held] = np.clip(found[held], -most[held], most[held])
            left = cross[columns] - own[:, held] @ found[held]
            found[~held] = bounded(own[np.ix_(~held, ~held)], left[~held], positive[~held], sums)
        _hand_out(found, chosen, rest, shares)
        gain += float(2 * found @ cross[columns] - found @ own @ found)
    return tuple(shares), gain


def _sums(chosen: Sequence[PlacedTerm], load_is_known: bool) -> list[tuple[slice, float]]:
    """Where the shares of each of `chosen` stand whose sum has a bound, and the bound."""
    found, at = [], 0
    for each in chosen:
        own = slice(at, at + len(each.columns))
        at = own.stop
        if np.isfinite(most := each.term.most(load_is_known)):
            found.append((own, most))
    return found


def _hand_out(found: Array, chosen: Sequence[PlacedTerm], rest: Sequence[int], shares: list[Array]) -> None:
    """Put the shares of the candidates `rest` of `chosen`, one after the other in `found`, into `shares`."""
    at = 0
    for i in rest:
        shares[i] = found[at : at + len(chosen[i].columns)]
        at += len(chosen[i].columns)


def solve_companions(
    design: Regression, chosen: Sequence[PlacedTerm], shares: Sequence[Array]
) -> tuple[NDArray[np.intp], Array]:
    """Columns of what is fitted beside `chosen`, whose shares are known, and its own (k,) shares."""
    own = np.concatenate([each.columns for each in chosen])
    beside = np.setdiff1d(np.concatenate([each.companions for each in chosen]), own).astype(np.intp)
    std = absorbed_std(chosen, [float(np.abs(each).sum()) for each in shares], beside)
    left = design.cross[beside] - design.gram[np.ix_(beside, own)] @ np.concatenate(shares)
    gram = design.gram[np.ix_(beside, beside)]
    found = np.linalg.solve(gram + np.diag(RIDGE * np.diag(gram) + std**-2.0), left) if len(beside) else left
    return beside, np.clip(found, -MOST_ABSORBED * std, MOST_ABSORBED * std)


def is_possible(chosen: Sequence[PlacedTerm], shares: Sequence[Array], load_is_known: bool) -> bool:
    """Whether all shares are within what the terms' laws make sense for."""
    return all(
        float(np.abs(own).max()) <= each.term.limit
        and each.term.is_possible(each.settings, own, load_is_known or each.term.is_of_load)
        for own, each in zip(shares, chosen, strict=True)
    )


def absorbed_std(chosen: Sequence[PlacedTerm], strengths: Sequence[float], columns: NDArray[np.intp]) -> Array:
    """(k,) prior standard deviations of static parts that terms of these `strengths` (sums of shares) have left."""
    square = np.full(len(columns), 1e-8)
    for each, strength in zip(chosen, strengths, strict=True):
        for column, std in zip(each.companions.tolist(), each.companion_std, strict=True):
            square[columns == column] += (std * strength) ** 2
    return np.asarray(np.sqrt(square))


def bounded(gram: Array, cross: Array, positive: NDArray[np.bool_], sums: Sequence[tuple[slice, float]] = ()) -> Array:
    """θ that minimises θᵀ·gram·θ − 2·crossᵀθ with θ ≥ 0 where `positive`, and sums of slices of θ up to a bound each.

    A slice whose sum has a bound is of positive ones.
    """
    scale = np.sqrt(np.diag(gram))
    gram, cross = gram / scale[:, None] / scale, cross / scale
    free = ~positive
    found = np.empty(len(cross))
    inner, r = gram[np.ix_(positive, positive)], cross[positive]
    if free.any():
        through = np.linalg.solve(
            gram[np.ix_(free, free)], np.column_stack([gram[np.ix_(free, positive)], cross[free]])
        )
        inner = inner - gram[np.ix_(positive, free)] @ through[:, :-1]
        r = r - gram[np.ix_(positive, free)] @ through[:, -1]
    if positive.any():
        values, vectors = np.linalg.eigh(inner)
        root = np.sqrt(np.maximum(values, LEAST_EIGENVALUE))
        rows, target = root[:, None] * vectors.T, (vectors.T @ r) / root
        found[positive] = nnls(rows, target)[0]
        held: set[int] = set()
        while over := {k for k, (own, most) in enumerate(sums) if _sum(found, scale, own) > most * (1.0 + TOLERANCE)}:
            if over <= held:
                break
            held |= over
            for own, most in (sums[k] for k in over):
                pull = np.zeros(len(cross))
                pull[own] = 1.0 / scale[own]
                size = PULL / float(np.linalg.norm(pull))
                rows, target = np.vstack([rows, size * pull[positive]]), np.append(target, size * most)
            found[positive] = nnls(rows, target)[0]
    if free.any():
        found[free] = through[:, -1] - through[:, :-1] @ found[positive]
    return found / scale


def _sum(scaled: Array, scale: Array, own: slice) -> float:
    return float(np.sum(scaled[own] / scale[own]))
