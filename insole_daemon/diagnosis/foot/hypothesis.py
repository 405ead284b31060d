"""A set of effects fitted to walks: a few parameters searched for, everything else solved for at each step.

Shares of effects are no less than 0 and recalibration costs what it is unlikely to be, so a hypothesis is a small
problem of non-negative least squares (Lawson & Hanson 1974) within the search for its times (variable projection, Golub
& Pereyra 1973). Timing is a nuisance in every fold: offset and rate of a clock of the shoe's own, else what a bus may
take to bring a reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares, nnls

from ...physics.law import Array
from .evidence import N_FOLDS, Evidence

ORDER = ("hysteresis", "viscoelasticity", "lag", "delay")  # on the signal path
MOST_OFFSET_S, MOST_RATE = 0.15, 5e-4  # of a clock of its own, after the edges were aligned
MOST_ON_BUS_S = 0.003  # a reading may take on its way: no delay worth a word
MOST_S = {"delay": 0.3, "lag": 0.3}
TAU_S = (0.03, 4.0)  # of viscoelasticity: slower, and within a walk it is a rest that wanders
_STARTS_S = (0.1, 0.5, 2.0)
_SCALE = {"offset": 0.01, "rate": 1e-4, "delay": 0.01, "lag": 0.01, "viscoelasticity": 0.5}
_SHARED = ("hysteresis", "viscoelasticity")  # what has shares, for each play or one
_MOST_CALLS = 12


@dataclass(frozen=True, slots=True)
class Term:
    """One effect in a set: on all boards, or on some."""

    word: str
    boards: tuple[int, ...] = ()
    backwards: bool = False  # a decoy: the same filter run from the end to the beginning


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis with the values that explain its rows best."""

    terms: tuple[Term, ...]
    theta: Array  # (p,) clocks of every walk, then the times of the terms
    shares: tuple[Array, ...]  # of each term: none of lag and delay, one of viscoelasticity, one a play of hysteresis
    mean_square: float  # what is left of rows fitted to, and of the price of recalibration, in units of the noise

    def times(self, term: Term) -> float:
        """What was searched for of `term`: s; of hysteresis, which has no time, 0."""
        timed = [each for each in self.terms if each.word != "hysteresis"]
        if term not in timed:
            return 0.0
        value = float(self.theta[len(self.theta) - len(timed) + timed.index(term)])
        return float(np.exp(value)) if term.word == "viscoelasticity" else value


class Hypothesis:
    """Terms together, to be fitted to evidence."""

    def __init__(self, evidence: Evidence, terms: Sequence[Term]) -> None:
        self.evidence = evidence
        self.terms = tuple(sorted(terms, key=lambda each: (ORDER.index(each.word), each.boards)))
        self._timed = [each for each in self.terms if each.word != "hysteresis"]
        late = any(each.word == "delay" for each in self.terms)
        low, high, scale = [], [], []
        for part in evidence.parts:
            if part.walk.shoe.clock == "own":
                low += [-MOST_OFFSET_S, -MOST_RATE]
                high += [MOST_OFFSET_S, MOST_RATE]
                scale += [_SCALE["offset"], _SCALE["rate"]]
            elif not late:
                low, high, scale = [*low, -MOST_ON_BUS_S], [*high, MOST_ON_BUS_S], [*scale, _SCALE["offset"]]
        for each in self._timed:
            bounds = np.log(TAU_S) if each.word == "viscoelasticity" else (0.0, MOST_S[each.word])
            low, high, scale = [*low, bounds[0]], [*high, bounds[1]], [*scale, _SCALE[each.word]]
        self._low, self._high, self._scale = np.array(low), np.array(high), np.array(scale)
        self._delayed = late

    def fit(self, start: Array | None = None, without: int | None = None, most_calls: int = _MOST_CALLS) -> Fitted:
        """The best values, from `start` on or from all starts there are; `without` one fold."""
        starts = self._starts if start is None else [start]
        best = min((self._searched(each, without, most_calls) for each in starts), key=lambda found: found[0])
        return self.at(best[1], without)

    def at(self, theta: Array, without: int | None = None) -> Fitted:
        """With these times, everything else solved for."""
        left, shares = self._solved(theta, without)
        n = 3 * int(self.evidence.rows(without).sum())
        return Fitted(self.terms, theta, tuple(self._by_term(shares)), float(left @ left) / max(n, 1))

    def left(self, fitted: Fitted, without: int | None = None) -> Array:
        """(n, 3) what is left of all rows, in units of the noise, with recalibration fitted `without` a fold."""
        rest = self.unexplained(fitted)
        return np.asarray(rest - self.evidence.nuisance @ self.evidence.recalibration(rest, without))

    def unexplained(self, fitted: Fitted) -> Array:
        """(n, 3) what the effects leave of all rows, before any recalibration."""
        shares = np.concatenate([*fitted.shares, np.empty(0)])
        return np.asarray(self._target(fitted.theta) - self._columns(fitted.theta) @ shares)

    def heldout(self, fitted: Fitted) -> tuple[Array, list[Fitted]]:
        """(n, 3) what is left of every row by a fit that has not seen its fold, and these fits."""
        found = np.zeros_like(self.evidence.nuisance[..., 0])
        without = []
        for fold in range(N_FOLDS):
            again = self.fit(fitted.theta, fold, 3) if len(fitted.theta) else self.at(fitted.theta, fold)
            out = self.evidence.fold == fold
            found[out] = self.left(again, fold)[out]
            without.append(again)
        return found, without

    def clocks(self, theta: Array) -> Array:
        """(parts, 2) how much later the readings are than the clocks as aligned, and by how much the rate is off."""
        found, at = np.zeros((len(self.evidence.parts), 2)), 0
        for i, part in enumerate(self.evidence.parts):
            if part.walk.shoe.clock == "own":
                found[i] = theta[at : at + 2]
                at += 2
            elif not self._delayed:
                found[i, 0] = theta[at]
                at += 1
        return found

    @cached_property
    def _starts(self) -> list[Array]:
        first = np.clip(np.zeros(len(self._low)), self._low, self._high)
        n_clock = len(first) - len(self._timed)
        for at, each in enumerate(self._timed, n_clock):
            first[at] = np.log(_STARTS_S[1]) if each.word == "viscoelasticity" else 0.015
        slow = [at for at, each in enumerate(self._timed, n_clock) if each.word == "viscoelasticity"]
        if not slow:
            return [first]
        starts = []
        for tau_s in _STARTS_S:
            starts.append(first.copy())
            starts[-1][slow] = np.log(tau_s)
        return starts

    def _searched(self, start: Array, without: int | None, most_calls: int) -> tuple[float, Array]:
        if not len(start):
            return 0.0, start
        inside = np.clip(start, self._low + 1e-9, self._high - 1e-9)
        found = least_squares(
            lambda x: self._solved(x * self._scale, without)[0], inside / self._scale,
            bounds=(self._low / self._scale, self._high / self._scale), diff_step=1e-3, max_nfev=most_calls,
            xtol=1e-4, ftol=1e-5,
        )  # fmt: skip
        return float(found.cost), found.x * self._scale

    def _solved(self, theta: Array, without: int | None) -> tuple[Array, Array]:
        """What is left, its price included, and the shares."""
        timed = [self._target(theta)[..., None], *self._late(theta)]
        rid = self.evidence.rid(np.concatenate(timed, axis=2), without)
        rest, moved = rid[:, 0], iter(rid[:, 1:].T)
        free = [
            self.evidence.rid_loops(self._boards(each), each.backwards, without)
            if each.word == "hysteresis" else next(moved)[:, None]
            for each in self.terms if each.word in _SHARED
        ]  # fmt: skip
        if not free:
            return rest, np.empty(0)
        columns = np.concatenate(free, axis=1)
        normal = columns.T @ columns
        triangle = np.linalg.cholesky(normal + 1e-9 * np.trace(normal) * np.eye(len(normal)))
        shares = nnls(triangle.T, np.linalg.solve(triangle, columns.T @ rest))[0]
        return rest - columns @ shares, shares

    def _target(self, theta: Array) -> Array:
        clocks = self.clocks(theta)
        times = dict(zip(self._timed, theta[len(theta) - len(self._timed) :].tolist(), strict=True))
        lag = {each.backwards: t for each, t in times.items() if each.word == "lag"}
        late = sum(t for each, t in times.items() if each.word == "delay")
        return np.concatenate([
            part.target(late + own[0], own[1], lag.get(False, 0.0), lag.get(True, 0.0))
            for part, own in zip(self.evidence.parts, clocks, strict=True)
        ])  # fmt: skip

    def _boards(self, term: Term) -> tuple[int, ...]:
        return term.boards or self.evidence.boards

    def _late(self, theta: Array) -> list[Array]:
        """(n, 3, 1) of each viscoelasticity."""
        times = dict(zip(self._timed, theta[len(theta) - len(self._timed) :].tolist(), strict=True))
        return [
            np.concatenate([p.late(self._boards(e), float(np.exp(t)), e.backwards) for p in self.evidence.parts])[
                ..., None
            ]
            for e, t in times.items()
            if e.word == "viscoelasticity"
        ]

    def _columns(self, theta: Array) -> Array:
        late = iter(self._late(theta))
        found = [np.empty((len(self.evidence.fold), 3, 0))]
        for each in self.terms:
            if each.word in _SHARED:
                slow = each.word == "viscoelasticity"
                found.append(next(late) if slow else self.evidence.loops(self._boards(each), each.backwards))
        return np.concatenate(found, axis=2)

    def _by_term(self, shares: Array) -> list[Array]:
        found, at = [], 0
        for each in self.terms:
            k = {"viscoelasticity": 1, "hysteresis": self.evidence.n_plays}.get(each.word, 0)
            found.append(shares[at : at + k])
            at += k
        return found
