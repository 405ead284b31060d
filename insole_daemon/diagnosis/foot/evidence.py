"""Walks as evidence: what their rows say, what recalibration may change, and blocks of steps to hold out."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ...physics.law import Array
from .part import N_FOLDS, Part

DRIFT_COUNT = 2.0  # of a board, between two knots: by one standard deviation it is free
RADII_PA = tuple(np.geomspace(4e3, 64e3, 8).tolist())  # of plays, as a material may have them
UNDONE_PA = tuple(np.geomspace(8e3, 64e3, 6).tolist())  # and as they are undone: noise drags smaller ones about


@dataclass(frozen=True, slots=True)
class Freedom:
    """How far recalibration, a nuisance in every hypothesis, may bend the curves of each triangle."""

    powers: tuple[int, ...]  # of the pressure, P^k / CURVED_PA^(k − 1)
    gain: float  # of each, by one standard deviation


USUAL = Freedom((1, 2), 0.05)
# The curves of a chamber go on beyond its pressures as polynomials, which a walk may have to bend back. For naming, and
# for undoing loops of hysteresis on noisy readings, that would be too much: it takes the place of part of the loops.
FREE = Freedom((1, 2, 3), 0.3)


class Sums:
    """Parts one after the other."""

    def __init__(self, parts: Sequence[Part], radii_pa: tuple[float, ...]) -> None:
        self._parts, self._radii_pa = tuple(parts), radii_pa

    def target(self, clocks: Array, late_s: float, lag_s: float, swing_s: float = 0.0) -> Array:
        """(n, 3) `Part.target`; `clocks` (parts, 2) how much later each is, and its rate."""
        return np.concatenate([
            part.target(late_s + own_s, rate, lag_s, swing_s)
            for part, (own_s, rate) in zip(self._parts, clocks.tolist(), strict=True)
        ])  # fmt: skip

    def late(self, boards: Sequence[int], tau_s: float, backwards: bool = False) -> Array:
        """(n, 3) `Part.late`."""
        return np.concatenate([part.late(boards, tau_s, backwards) for part in self._parts])

    def loops(self, boards: Sequence[int], backwards: bool = False) -> Array:
        """(n, 3, k) the loops of plays on `boards`, which depend on nothing that is searched for."""
        loops = [part.loops(self._radii_pa, backwards) for part in self._parts]
        return np.concatenate([np.sum([own[b] for b in boards], axis=0) for own in loops])


class Evidence:
    """Walks of one insole; gains and curvatures are common to all, constants and drifts each walk's own."""

    def __init__(self, parts: Sequence[Part], freedom: Freedom = USUAL) -> None:
        self.parts, self.freedom = tuple(parts), freedom
        self.boards = tuple(int(b) for b in np.unique(np.concatenate([p.walk.boards for p in parts])))
        self.fold = np.concatenate([p.folds for p in parts])
        self.asked = np.concatenate([p.asked for p in parts])
        self.judged = self.asked & (self.fold >= 0)  # (n,) rows that are held out once
        self.of_part = np.repeat(np.arange(len(parts)), [len(p.rows_s) for p in parts])
        common = np.concatenate([p.stretched(freedom.powers) for p in parts])
        own = [p.drifting for p in parts]
        n, k = len(common), sum(each.shape[2] for each in own)
        apart = block_diag(*(each.reshape(-1, each.shape[2]) for each in own)).reshape(n, 3, k)
        self.nuisance = np.concatenate([common, apart], axis=2)
        self.n_common = common.shape[2]
        free = [np.concatenate([np.zeros(3), np.full(each.shape[2] - 3, 1 / DRIFT_COUNT)]) for each in own]
        self._stiff = np.concatenate([np.full(self.n_common, 1 / freedom.gain), *free])
        self._projections = {fold: self._projection(fold) for fold in (None, *range(N_FOLDS))}
        self._play(RADII_PA)
        clocks = np.zeros((len(parts), 2))
        self.static_noise = self.noise.target(clocks, 0.0, 0.0)  # (n, 3) noise alone by the static model
        self._static_squares: dict[int | None, float] = {}

    def _play(self, radii_pa: tuple[float, ...]) -> None:
        self.radii_pa = radii_pa
        self.said, self.noise = Sums(self.parts, radii_pa), Sums([p.twin for p in self.parts], radii_pa)
        self._rid: dict[Any, Array] = {}

    def with_plays(self, radii_pa: tuple[float, ...]) -> Evidence:
        """The same with plays of other radii; what recalibration may do, the most of the memory, is shared."""
        found = copy(self)
        found._play(radii_pa)
        return found

    def rests(self, of_recalibration: Array, i: int) -> Array:
        """(boards, knots) counts of walk `i` since its first knot; `of_recalibration` (j,) or its deviations."""
        begin = self.n_common + sum(each.drifting.shape[2] for each in self.parts[:i])
        own = of_recalibration[begin + 3 : begin + self.parts[i].drifting.shape[2]]
        return np.pad(own.reshape(len(self.boards), -1), ((0, 0), (1, 0)))

    @cached_property
    def covariance(self) -> Array:
        """(j, j) of the recalibration, of rows whose noise the kernel has made alike."""
        triangle = np.linalg.inv(self._projections[None][1])
        return np.asarray(triangle @ triangle.T)

    def rows(self, without: int | None) -> NDArray[np.bool_]:
        """(n,) rows that are fitted to, `without` one fold."""
        return self.asked if without is None else self.asked & (self.fold != without)

    def rid_loops(self, sums: Sums, boards: Sequence[int], backwards: bool, without: int | None) -> Array:
        """The loops of `said` or `noise`, rid of recalibration."""
        key = (sums is self.noise, tuple(boards), backwards, without)
        if key not in self._rid:
            self._rid[key] = self.rid(sums.loops(boards, backwards), without)
        return self._rid[key]

    def rid(self, x: Array, without: int | None) -> Array:
        """(rows, k) `x` (n, 3, k) without what recalibration could make of it, the price of that included."""
        basis, _ = self._projections[without]
        stacked = self._stacked(x, without)
        return np.asarray(stacked - basis @ (basis.T @ stacked))

    def static_square(self, without: int | None) -> float:
        """The square of `static_noise`, rid of recalibration."""
        if without not in self._static_squares:
            self._static_squares[without] = float(np.sum(self.rid(self.static_noise[..., None], without) ** 2))
        return self._static_squares[without]

    def recalibration(self, x: Array, without: int | None) -> Array:
        """(j,) what recalibration makes of `x` (n, 3)."""
        basis, triangle = self._projections[without]
        return np.asarray(np.linalg.solve(triangle, basis.T @ self._stacked(x[..., None], without)[:, 0]))

    def _stacked(self, x: Array, without: int | None) -> Array:
        rows = x[self.rows(without)].reshape(-1, x.shape[2])
        return np.concatenate([rows, np.zeros((len(self._stiff), x.shape[2]))])

    def _projection(self, without: int | None) -> tuple[Array, Array]:
        rows = self.nuisance[self.rows(without)].reshape(-1, self.nuisance.shape[2])
        basis, triangle = np.linalg.qr(np.concatenate([rows, np.diag(self._stiff)]))
        return basis, triangle
