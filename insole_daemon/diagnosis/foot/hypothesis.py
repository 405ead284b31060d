"""A set of effects fitted to walks: a few parameters searched for, everything else solved for at each step.

Shares of effects are no less than 0 and recalibration costs what it is unlikely to be, so a hypothesis is a small
problem of non-negative least squares (Lawson & Hanson 1974) within the search for its times (variable projection, Golub
& Pereyra 1973). Timing is a nuisance in every fold: offset and rate of a clock of the shoe's own, else what a bus may
take to bring a reading.

Undoing effects on noisy readings amplifies their noise, and a lag averages that of the shoe: plain least squares leaves
the one out where it is, and takes the other for more than it is. So what the same hypothesis makes of noise alone is
taken off (bias-compensated least squares: Stoica & Söderström, Int. J. Control 35 (1982) 449).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import least_squares, nnls

from ...physics.law import Array
from .evidence import Evidence, Sums
from .part import N_FOLDS

ORDER = ("hysteresis", "viscoelasticity", "lag", "delay")  # on the signal path
MOST_OFFSET_S, MOST_RATE = 0.15, 5e-4  # of a clock of its own, after the edges were aligned
MOST_ON_BUS_S = 0.003  # a reading may take on its way: no delay worth a word
MOST_S = {"delay": 0.3, "lag": 0.3}
TAU_S = (0.03, 4.0)  # of viscoelasticity: slower, and within a walk it is a rest that wanders
_STARTS_S = (0.1, 0.5, 2.0)
_SCALE = {"offset": 0.01, "rate": 1e-4, "delay": 0.01, "lag": 0.01, "viscoelasticity": 0.5}
_SHARED = ("hysteresis", "viscoelasticity")  # what has shares, for each play or one
_MOST_SHARES = {"viscoelasticity": 1.0}  # half of the answer late: what hardly bears a load would have any
_MOST_CALLS = 12
_ROOM = 16.0  # what noise may come to, as a mean square
MOST_NOISE = 0.5  # of the square of any mixture of columns: more of it taken off, and nearly nothing has a share


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
    radii_pa: tuple[float, ...]  # of these
    mean_square: float  # left of rows fitted to, less the noise added, and price of recalibration; 1 is the noise
    believed: float  # how much of the noise that shares add is taken off: all of it, where columns are not mostly noise

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
        most = [np.full(self._n_shares(each), _MOST_SHARES.get(each.word, np.inf)) for each in self.terms]
        self._most = np.concatenate([*most, np.empty(0)])

    def fit(self, start: Array | None = None, without: int | None = None, most_calls: int = _MOST_CALLS) -> Fitted:
        """The best values, from `start` on or from all starts there are; `without` one fold."""
        starts = self._starts if start is None else [start]
        best = min((self._searched(each, without, most_calls) for each in starts), key=lambda found: found[0])
        return self.at(best[1], without)

    def at(self, theta: Array, without: int | None = None) -> Fitted:
        """With these times, everything else solved for."""
        left, noise, shares, believed = self._solved(theta, without)
        square = float(left @ left - noise) / max(3 * int(self.evidence.rows(without).sum()), 1)
        return Fitted(self.terms, theta, tuple(self._by_term(shares)), self.evidence.radii_pa, square, believed)

    def left(self, fitted: Fitted, without: int | None = None) -> Array:
        """(n, 3) what is left of all rows, in units of the noise, with recalibration fitted `without` a fold."""
        rest = self.unexplained(fitted)
        return np.asarray(rest - self.evidence.nuisance @ self.evidence.recalibration(rest, without))

    def unexplained(self, fitted: Fitted) -> Array:
        """(n, 3) what the effects leave of all rows, before any recalibration."""
        target, undone = self._sides(fitted, self.evidence.said)
        return target - undone

    def added_noise(self, fitted: Fitted) -> Array:
        """(n,) mean square that noise has more in each row than by the static model; below 0: less."""
        lagged, undone = self._sides(fitted, self.evidence.noise)
        of_shares = (lagged - undone) ** 2 - lagged**2
        return np.asarray(np.mean(lagged**2 - self.evidence.static_noise**2 + fitted.believed * of_shares, axis=1))

    def without_each_fold(self, fitted: Fitted) -> list[Fitted]:
        """`fitted` again, from there on, without each fold."""
        return [
            self.fit(fitted.theta, fold, 3) if len(fitted.theta) else self.at(fitted.theta, fold)
            for fold in range(N_FOLDS)
        ]

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
        first = np.zeros(len(self._low))
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
        n = 3 * int(self.evidence.rows(without).sum())

        def left(x: Array) -> Array:
            # A sum of squares has nothing taken off: what noise adds is missing from one more square instead.
            rest, noise, *_ = self._solved(x * self._scale, without)
            return np.append(rest, np.sqrt(max(_ROOM * n - noise, 0.0)))

        found = least_squares(
            left, inside / self._scale, bounds=(self._low / self._scale, self._high / self._scale),
            diff_step=1e-3, max_nfev=most_calls, xtol=1e-4, ftol=1e-5,
        )  # fmt: skip
        return float(found.cost), found.x * self._scale

    def _solved(self, theta: Array, without: int | None) -> tuple[Array, float, Array, float]:
        """What is left, its price included; the square that noise adds to it; shares; how much of it is believed."""
        (rest, columns), (of_rest, of_columns) = self._rid(theta, without)
        noise, shares, believed = float(of_rest @ of_rest) - self.evidence.static_square(without), np.empty(0), 1.0
        if columns.shape[1]:
            normal, of_noise = columns.T @ columns, of_columns.T @ of_columns
            normal += 1e-9 * np.trace(normal) * np.eye(len(normal))
            most = float(eigh(of_noise, normal, eigvals_only=True)[-1])
            believed = min(1.0, MOST_NOISE / max(most, 1e-9))
            with_noise = of_columns.T @ of_rest
            triangle = np.linalg.cholesky(normal - believed * of_noise)
            shares = nnls(triangle.T, np.linalg.solve(triangle, columns.T @ rest - believed * with_noise))[0]
            shares = np.minimum(shares, self._most)
            noise += believed * float(shares @ of_noise @ shares - 2.0 * shares @ with_noise)
        return rest - columns @ shares, noise, shares, believed

    def _rid(self, theta: Array, without: int | None) -> list[tuple[Array, Array]]:
        """Target and columns, rid of recalibration: of what was said, and of noise alone."""
        both = (self.evidence.said, self.evidence.noise)
        timed = [each for sums in both for each in (self._target(theta, sums)[..., None], *self._late(theta, sums))]
        found = []
        rid_of_both = np.split(self.evidence.rid(np.concatenate(timed, axis=2), without), 2, axis=1)
        for sums, rid in zip(both, rid_of_both, strict=True):
            late = iter(rid[:, 1:].T)
            columns = [
                self.evidence.rid_loops(sums, self._boards(each), each.backwards, without)
                if each.word == "hysteresis" else next(late)[:, None]
                for each in self.terms if each.word in _SHARED
            ]  # fmt: skip
            found.append((rid[:, 0], np.concatenate([np.empty((len(rid), 0)), *columns], axis=1)))
        return found

    def _sides(self, fitted: Fitted, sums: Sums) -> tuple[Array, Array]:
        """(n, 3) the target, and what the shares undo of it."""
        shares = np.concatenate([*fitted.shares, np.empty(0)])
        return self._target(fitted.theta, sums), np.asarray(self._columns(fitted.theta, sums) @ shares)

    def _target(self, theta: Array, sums: Sums) -> Array:
        times = self._times(theta)
        lag = {each.backwards: t for each, t in times.items() if each.word == "lag"}
        late = sum(t for each, t in times.items() if each.word == "delay")
        return sums.target(self.clocks(theta), late, lag.get(False, 0.0), lag.get(True, 0.0))

    def _boards(self, term: Term) -> tuple[int, ...]:
        return term.boards or self.evidence.boards

    def _late(self, theta: Array, sums: Sums) -> list[Array]:
        """(n, 3, 1) of each viscoelasticity."""
        return [
            sums.late(self._boards(each), tau_s, each.backwards)[..., None]
            for each, tau_s in self._times(theta).items()
            if each.word == "viscoelasticity"
        ]

    def _columns(self, theta: Array, sums: Sums) -> Array:
        late = iter(self._late(theta, sums))
        found = [np.empty((len(self.evidence.fold), 3, 0))]
        for each in self.terms:
            if each.word in _SHARED:
                slow = each.word == "viscoelasticity"
                found.append(next(late) if slow else sums.loops(self._boards(each), each.backwards))
        return np.concatenate(found, axis=2)

    def _times(self, theta: Array) -> dict[Term, float]:
        """Of the terms that have one, s."""
        values = theta[len(theta) - len(self._timed) :].tolist()
        return {
            each: float(np.exp(value)) if each.word == "viscoelasticity" else value
            for each, value in zip(self._timed, values, strict=True)
        }

    def _by_term(self, shares: Array) -> list[Array]:
        found, at = [], 0
        for each in self.terms:
            found.append(shares[at : at + self._n_shares(each)])
            at += self._n_shares(each)
        return found

    def _n_shares(self, term: Term) -> int:
        return {"viscoelasticity": 1, "hysteresis": len(self.evidence.radii_pa)}.get(term.word, 0)
