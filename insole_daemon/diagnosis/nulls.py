"""How much the best of all candidates would explain if nothing were there: nulls made of this very recording.

A null is what the static model says of these rows, under this load, with noise at the floor. One Gauss–Newton step
from every start of every candidate is fitted to it, curves and clocks with it, and judged on blocks that were held
out; the best of them all is what a search finds in noise alone (a parametric bootstrap of the best of many: Davison &
Hinkley 1997, section 4.2; White, Econometrica 68 (2000) 1097). What was observed is judged in the same way. Directions
are those of the static model, so hundreds of nulls cost little more than one; they are free of the bounds that a
search has, which makes nulls explain a little more and never less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .candidate import Candidate
from .fit import Evidence, Fitted, Hypothesis
from .floor import noise_of_blocks
from .naming import N_FOLDS, folds

N_NULLS = 200
_RANK = 1e-10  # relative size of a direction that others already hold


@dataclass(frozen=True, slots=True, eq=False)
class Nulls:
    """Share of the held-out mean square that the best single candidate takes away."""

    gains: Array  # (N_NULLS,)
    observed: float
    best: str  # the candidate that explains most of what was observed

    @property
    def p_value(self) -> float:
        """How often noise alone gives as much, at the most."""
        return float((1 + np.count_nonzero(self.gains >= self.observed)) / (1 + len(self.gains)))


@dataclass(frozen=True, slots=True, eq=False)
class _Try:
    """One start of a candidate: what the static model lets it add."""

    word: str
    common: NDArray[np.intp]  # of the directions that all readings share
    columns: Array  # (m, n, k) of which each reading has a share of its own; m as of the designs


def nulls(evidence: Evidence, static: Fitted, candidates: Mapping[str, Candidate], seed: int = 0) -> Nulls:
    """`static`: fitted to `evidence` without any of the `candidates`."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum([len(each.first) for each in evidence.observed])[:-1]
    std = np.concatenate([np.tile(noise_of_blocks(part), (len(part), 1)) for part in np.split(evidence.y, ends)])
    noise = std[..., None] * rng.standard_normal((*std.shape, N_NULLS))
    left = np.concatenate([static.residual[..., None], noise], axis=2)  # what was observed stands first
    directions, tries = _tries(evidence, static, candidates)
    nothing = _Try("", np.empty(0, np.intp), np.empty((1, len(left), 0)))
    squares = np.zeros((1 + len(tries), left.shape[2]))
    load_pa, fold = static.effective_pa.mean(axis=1), folds(evidence)
    clocks = np.arange(len(static.theta))
    for i in range(N_FOLDS):
        fitted_to = fold != i
        out = ~fitted_to & (load_pa >= load_pa[fitted_to].min()) & (load_pa <= load_pa[fitted_to].max())
        common = _Fold(static.design, directions, left, fitted_to, out)
        for at, each in enumerate([nothing, *tries]):
            own = common
            if each.columns.size:
                design = np.concatenate([static.design, each.columns], axis=2)
                own = _Fold(design, directions[..., clocks], left, fitted_to, out)
            squares[at] += own.heldout(np.concatenate([clocks, each.common]))
    gains = 1.0 - squares[1:] / squares[0]
    best = gains.max(axis=0)
    return Nulls(best[1:], float(best[0]), tries[int(np.argmax(gains[:, 0]))].word)


def _tries(evidence: Evidence, static: Fitted, candidates: Mapping[str, Candidate]) -> tuple[Array, list[_Try]]:
    """(n, r, k) directions, those of the clocks first, and what each start of each candidate may combine."""
    clean = evidence.of(evidence.y - static.residual)
    n, r = clean.y.shape
    plain = Hypothesis(clean, ())
    n_clock = len(static.theta)
    directions = [plain.jacobian(plain.at(static.theta)).reshape(n, r, n_clock)]
    tries, at = [], n_clock
    for candidate in candidates.values():
        hypothesis = Hypothesis(clean, (candidate,))
        for start in candidate.starts:
            fitted = hypothesis.at(np.concatenate([static.theta, start]))
            own, columns = np.empty((n, r, 0)), fitted.design[:, :, static.design.shape[2] :]
            if candidate.act is not None:
                own = fitted.residual[..., None]
                if candidate.nudge is None:  # else it is a threshold, which has no slope but its starts
                    slopes = hypothesis.jacobian(fitted).reshape(n, r, -1)[..., n_clock:]
                    own = np.concatenate([own, slopes], axis=2)
            directions.append(own)
            tries.append(_Try(candidate.word, np.arange(at, at + own.shape[2]), columns))
            at += own.shape[2]
    every = np.concatenate(directions, axis=2)
    size = np.sqrt(np.sum(every**2, axis=(0, 1)))
    return every / np.where(size > 0, size, 1.0), tries


class _Fold:
    """Least squares on some rows, judged on others; everything a choice of directions needs is computed once."""

    def __init__(
        self, design: Array, directions: Array, left: Array, fitted_to: NDArray[np.bool_], out: NDArray[np.bool_]
    ) -> None:
        """`design` (m, n, k): each reading has shares of its own; `directions` (n, r, j) and `left` (n, r, N)."""
        j, both = directions.shape[2], np.concatenate([directions, left], axis=2)
        readings = [slice(None)] if len(design) == 1 else [slice(i, i + 1) for i in range(both.shape[1])]
        for reading, own in zip(readings, design, strict=True):
            y = both[:, reading].reshape(len(both), -1)
            y = y - own @ np.linalg.lstsq(own[fitted_to], y[fitted_to], rcond=_RANK)[0]
            both[:, reading] = y.reshape(both[:, reading].shape)
        inside, outside = (both[rows].reshape(-1, j + left.shape[2]) for rows in (fitted_to, out))
        self._normal, self._normal_out = inside[:, :j].T @ inside, outside[:, :j].T @ outside
        self._square: Array = np.sum(outside[:, j:] ** 2, axis=0)
        self._j = j

    def heldout(self, columns: NDArray[np.intp]) -> Array:
        """(N,) sums of squares over the rows held out, with the directions `columns` fitted to the others."""
        if not columns.size:
            return self._square.copy()
        matrix, target = self._normal[np.ix_(columns, columns)], self._normal[columns, self._j :]
        shares = np.linalg.lstsq(matrix, target, rcond=_RANK)[0]
        matrix, target = self._normal_out[np.ix_(columns, columns)], self._normal_out[columns, self._j :]
        found: Array = self._square - 2 * np.sum(shares * target, axis=0) + np.sum(shares * (matrix @ shares), axis=0)
        return found
