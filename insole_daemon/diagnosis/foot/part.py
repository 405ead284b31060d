"""One walk as rows of three sums: what its taxels say, what would be undone on them, and noise alone in their place.

    L_τ[R](t − d) = Σ_i arm_i · (v_i + effects undone on v_i) + recalibration + noise

v is the static model's pressure and R the wrench of the shoe. The load of a single taxel is not known, so effects are
undone on the taxels' side, summed over the taxels, and lag and delay are put on the reference's side: 280 taxels become
three channels, and a hypothesis costs a few milliseconds.

Undoing physics on noisy readings is where denoising masquerades as physics: a filter that averages noise improves the
error and explains nothing. So both sides are smoothed by one symmetric kernel before anything is asked, which commutes
with everything that is linear, and every walk has a twin of noise alone, whose share can be taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter1d

from ...physics.law import Array
from ...skin.geometry import N_TAXELS
from ..operators import low_pass, plays, standing_out
from .walk import FINE_S, Walk

SMOOTH_S = 0.015  # standard deviation of the kernel on both sides
EVERY = 4  # moments of the grid a row: what the kernel leaves has no more to say
EDGE_S = 0.5  # left out at both ends
FOLD_S = 4.0  # rows that are held out together: three whole steps
N_FOLDS = 5
LOADED = (0.05, 0.2)  # of the largest force: below the one a foot swings, above the other it stands
CURVED_PA = 2e5
KNOT_S = 15.0


@dataclass(frozen=True, eq=False)
class Part:
    """One walk as n rows of three channels, in units of the noise that is left in them."""

    walk: Walk
    shoe: Array  # (M, 3) smoothed wrench on its fine grid, N and N·m
    noise: Array  # (3,) what the smoothed sums have
    pressure_pa: Array  # (N, m) smoothed

    @cached_property
    def twin(self) -> Twin:
        """Noise alone, white before the kernel, as large as that of this walk."""
        rng, walk = np.random.default_rng(0), self.walk
        size_pa = (_kept(walk.period_s) * walk.noise_count * walk.slope_pa).astype(np.float32)  # walks are long
        one, two = (white(rng, self.pressure_pa.shape, walk.step_s) * size_pa for _ in range(2))
        shoe = white(rng, self.shoe.shape, FINE_S) * _kept(walk.shoe.period_s) * walk.shoe.noise
        noisier = (self.courses_pa + self.standing(one), self.courses_pa + self.standing(two))
        return Twin(walk, shoe, self.noise, (one - two) * np.float32(np.sqrt(0.5)), noisier)

    @cached_property
    def courses_pa(self) -> Array:
        """(N, m) `pressure_pa` as the few courses that stand out of the noise, each with a shape: for what turns at a
        taxel's own turning points, which noise would drag about.
        """
        return self.standing(self.pressure_pa)

    def standing(self, pressure_pa: Array) -> Array:
        """(N, m) what `pressure_pa` has of those courses."""
        own, noise_pa = self._shapes
        return np.asarray((pressure_pa / noise_pa @ own) @ own.T * noise_pa)

    @cached_property
    def _shapes(self) -> tuple[Array, Array]:
        """(m, r) of the courses in units of the noise of readings, and that, (m,) Pa."""
        walk = self.walk
        noise_pa = np.sqrt(np.mean(walk.slope_pa**2, axis=0)) * walk.noise_count
        return standing_out(self.pressure_pa[::EVERY] / noise_pa / _kept(walk.period_s)), noise_pa

    @cached_property
    def rows_s(self) -> Array:
        """(n,) moments of the rows."""
        return self.walk.t_s[::EVERY]

    @cached_property
    def sums(self) -> dict[int, Array]:
        """By board, (N, 3) the static model's wrench of its taxels."""
        boards, arms = self.walk.boards, self.walk.arms
        return {int(b): self.pressure_pa[:, boards == b] @ arms[boards == b] for b in np.unique(boards)}

    def loops(self, radii_pa: tuple[float, ...], backwards: bool) -> dict[int, Array]:
        """By board, (n, 3, k) the sum of x − play_r[x] for each radius r.

        Backwards, of time reversed: as good at averaging, and no physics.
        """
        if (radii_pa, backwards) not in self._loops:
            self._loops[radii_pa, backwards] = self._looped(radii_pa, -1 if backwards else 1)
        return self._loops[radii_pa, backwards]

    @cached_property
    def _loops(self) -> dict[tuple[tuple[float, ...], bool], dict[int, Array]]:
        return {}

    def _looped(self, radii_pa: tuple[float, ...], way: int) -> dict[int, Array]:
        return self._loops_of(self.courses_pa, radii_pa, way)

    def _loops_of(self, x: Array, radii_pa: tuple[float, ...], way: int) -> dict[int, Array]:
        boards, arms = self.walk.boards, self.walk.arms
        found: dict[int, list[Array]] = {int(b): [] for b in np.unique(boards)}
        for radius_pa in radii_pa:  # one at a time: all of them, of ten minutes, are gigabytes
            rows = -plays(x[::way], np.array([radius_pa]))[0, ::way][::EVERY]
            for board, sums in found.items():
                sums.append(rows[:, boards == board] @ arms[boards == board] / self.noise)
        return {board: np.stack(sums, axis=-1) for board, sums in found.items()}

    def late(self, boards: Sequence[int], tau_s: float, backwards: bool = False) -> Array:
        """(n, 3) the sum of x − z with τ·dz/dt = x − z over the taxels of `boards`."""
        x = np.sum([self.sums[board] for board in boards], axis=0)
        way = -1 if backwards else 1
        z = low_pass(x[::way], self.walk.step_s, tau_s)[::way]
        return np.asarray((x - z)[::EVERY] / self.noise)

    def target(self, late_s: float, rate: float, lag_s: float, swing_s: float = 0.0) -> Array:
        """(n, 3) what the taxels of this walk have to explain beyond their static model.

        The reference after a lag, as it was `late_s` before; `rate` of its clock beside the one that the edges agree
        on. `swing_s`: a lag that runs backwards, and explains nothing real.
        """
        x = self.shoe
        if lag_s > FINE_S / 20:
            x = low_pass(x, FINE_S, lag_s)
        if swing_s > FINE_S / 20:
            x = low_pass(x[::-1], FINE_S, swing_s)[::-1]
        at = self.walk.offset_s - late_s + (1.0 + self.walk.rate + rate) * self.rows_s
        said = np.stack([np.interp(at, self.walk.shoe.t_s, column) for column in x.T], axis=1)
        return np.asarray((said - np.sum(list(self.sums.values()), axis=0)[::EVERY]) / self.noise)

    @cached_property
    def asked(self) -> NDArray[np.bool_]:
        """(n,) rows at which both sides are known, and their neighbours too.

        Not what a foot bears that stands on it when the recording begins: nobody knows what went before.
        """
        walk, n_kernel = self.walk, round(3 * SMOOTH_S / self.walk.step_s)
        known = ~binary_dilation(~walk.told, iterations=n_kernel)[::EVERY]
        at = walk.offset_s + (1.0 + walk.rate) * self.rows_s
        end_s = walk.shoe.t_s[-1]
        gap = binary_dilation(~walk.shoe.told, iterations=round(3 * SMOOTH_S / FINE_S))
        known &= np.interp(at, walk.shoe.t_s, gap.astype(float)) == 0
        for t, first, last in ((self.rows_s, self.rows_s[0], self.rows_s[-1]), (at, 0.0, end_s)):
            known &= (t > first + EDGE_S) & (t < last - EDGE_S)
        in_the_air = self.force_n < LOADED[0] * float(self.force_n.max())
        return np.asarray(known & (np.maximum.accumulate(in_the_air) | ~in_the_air.any()))

    @cached_property
    def force_n(self) -> Array:
        """(n,) the shoe's f_z at the rows."""
        at = self.walk.offset_s + (1.0 + self.walk.rate) * self.rows_s
        return np.interp(at, self.walk.shoe.t_s, self.shoe[:, 0])

    @cached_property
    def contacts(self) -> NDArray[np.intp]:
        """(k,) rows at which the foot begins to bear a load."""
        low, high = np.array(LOADED) * float(self.force_n.max())
        state = np.where(self.force_n > high, 1, np.where(self.force_n < low, 0, -1))
        row = np.maximum.accumulate(np.where(state >= 0, np.arange(len(state)), 0))
        return np.flatnonzero(np.diff(state[row]) == 1) + 1

    @cached_property
    def folds(self) -> NDArray[np.intp]:
        """(n,) which of N_FOLDS a row is held out with: blocks of whole steps; −1: always fitted to.

        What comes before the first load and after the last is like nothing else: no other block could predict it.
        """
        found = np.full(len(self.rows_s), -1)
        loaded = np.flatnonzero(self.asked & (self.force_n > LOADED[1] * self.force_n.max()))
        if not loaded.size:  # it stands there from the beginning
            return found
        t, near = self.rows_s, round(FOLD_S / 3 / float(np.diff(self.rows_s[:2])[0]))
        edges = [int(loaded[0])]
        while t[edges[-1]] + 1.5 * FOLD_S < t[loaded[-1]]:
            at = int(np.searchsorted(t, t[edges[-1]] + FOLD_S))
            edges.append(
                at - near + int(np.argmin(self.force_n[at - near : at + near]))
            )  # in a swing, where there is one
        for i, (a, b) in enumerate(pairwise([*edges, int(loaded[-1])])):
            found[a:b] = i % N_FOLDS
        return found

    def stretched(self, powers: tuple[int, ...]) -> Array:
        """(n, 3, triangles · powers) what the powers of its triangles' pressures would add."""
        x = self.pressure_pa[::EVERY]
        triangles = self.walk.slots // N_TAXELS
        found = [
            x[:, triangles == triangle] ** power @ self.walk.arms[triangles == triangle] / CURVED_PA ** (power - 1)
            for triangle in np.unique(triangles)
            for power in powers
        ]
        return np.stack(found, axis=-1) / self.noise[:, None]

    @cached_property
    def knots_s(self) -> Array:
        """(knots,) between which rests wander in a straight line."""
        t = self.rows_s
        return np.linspace(t[0], t[-1], max(round((t[-1] - t[0]) / KNOT_S), 2) + 1)

    @cached_property
    def drifting(self) -> Array:
        """(n, 3, 3 + boards·knots) constants of the three channels, and what rests that wander would add.

        They wander about their middle in time, which is the constants' affair: the two could make up for each other.
        """
        t, walk = self.rows_s, self.walk
        hats = np.stack([np.interp(t, self.knots_s, hat) for hat in np.eye(len(self.knots_s))[1:]], axis=-1)
        hats -= hats.mean(axis=0)
        slope = gaussian_filter1d(walk.slope_pa, SMOOTH_S / walk.step_s, axis=0)[::EVERY]
        rests = [
            (slope[:, walk.boards == b] @ walk.arms[walk.boards == b])[..., None] * hats[:, None]
            for b in np.unique(walk.boards)
        ]
        constant = np.broadcast_to(np.eye(3), (len(t), 3, 3))
        return np.concatenate([constant, *rests], axis=-1) / self.noise[:, None]


@dataclass(frozen=True, eq=False)
class Twin(Part):
    """Noise in the place of what both sides of a walk say: what a hypothesis makes of it.

    Plays need the walk to turn in. What noise does to them is how two draws of it differ there: of what it does in
    both, which drags plays along, it is no noise.
    """

    noisier_pa: tuple[Array, Array]  # (N, m) the courses of the walk with one draw and with another

    def _looped(self, radii_pa: tuple[float, ...], way: int) -> dict[int, Array]:
        one, two = (self._loops_of(x, radii_pa, way) for x in self.noisier_pa)
        return {board: (one[board] - two[board]) / np.sqrt(2.0) for board in one}


def part(walk: Walk) -> Part:
    """`walk`, both sides smoothed."""
    noise = np.hypot(_kept(walk.period_s) * walk.noise, _kept(walk.shoe.period_s) * walk.shoe.noise)
    shoe = gaussian_filter1d(walk.shoe.wrench, SMOOTH_S / FINE_S, axis=0, mode="nearest")
    pressure = gaussian_filter1d(walk.pressure_pa, SMOOTH_S / walk.step_s, axis=0, mode="nearest")
    return Part(walk, shoe, noise, pressure)


def white(rng: np.random.Generator, shape: tuple[int, ...], step_s: float) -> Array:
    """Noise of mean square 1 that went through the kernel, along the first axis."""
    smooth = gaussian_filter1d(rng.standard_normal(shape, np.float32), SMOOTH_S / step_s, axis=0)
    return np.asarray(smooth / smooth.std())


def _kept(period_s: float) -> float:
    """Of the standard deviation of white noise sampled every `period_s`, by the kernel."""
    return float(np.sqrt(min(1.0, period_s / (2 * np.sqrt(np.pi) * SMOOTH_S))))
