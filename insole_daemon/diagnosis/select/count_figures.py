"""Errors of all taxels in counts before and after, on blocks of rows that no share was fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..load_estimate import TaxelLoad
from ..model.blocks import BlockDesign, residual
from ..model.curves import CurveSplines, curve_splines, fit_curves, heldout_rest
from ..model.refine import Refined
from ..model.regression import Timing
from ..model.signal_path import pressure_removed
from ..model.solve import absorbed_std, bounded
from .residual_tests import lack_of_fit
from .wrench_figures import FOLD_S, N_FOLDS, Figures

REFITTED_COUNT = 5.0  # standard deviation of what a memory leaves in the curve of a taxel, at the most
LEAST_REFITTED_COUNT = 1e-3  # where no memory is: as good as nothing
OUTER = 0.998  # quantile that stands for the largest
ALIGNING = ("offset_s", "rate")
EXPECTED = 1.0  # mean square of weighted rows: the reference's noise and the stamps' jitter are a slow part of it
N_CLASSES, LEAST_READINGS = 24, 50  # of the load; in one, for a mean


def count_figures(refined: Refined[BlockDesign], order: Sequence[int]) -> Figures:
    """Of a refined set whose candidates enter in `order`: RMS over usable taxels and known rows, counts.

    `before` has the model as handed in, after the alignment that a clock of its own allows; `after` the laws alone. The
    floor is the noise of the readings and the error of a simulated load, which no model of the sensor takes away.
    """
    design = refined.design
    seen, nuisance = design.seen, design.nuisance
    n = len(design.weights)
    known = design.weights > 0
    law = refined.of_laws
    active, none = _columns(law), _Columns.none(design)
    aligning = np.array([name in ALIGNING for name in nuisance.shared_names])
    as_read = residual(design, Timing())
    # A clock of its own is aligned, whatever is found.
    aligned = residual(design, Timing(design.timing.delay_s if seen.offset_is_free else 0.0))
    x, y = active.rows, design.y - active.fixed_sum
    fold = (np.arange(n) * seen.step_s // FOLD_S).astype(int) % N_FOLDS
    left = np.empty_like(y)
    for k in range(N_FOLDS):
        held = fold == k
        theta, shift, _ = _fit(active, y, design, ~held)
        # Recalibration within its prior is a nuisance: it is no part of the model that is handed out.
        rest = y - nuisance.shared_sum(shift * aligning)
        for t, columns in enumerate(x):
            left[t, held] = rest[t, held] - theta @ columns[:, held]
    every_row = np.ones(n, bool)
    every, shared, own = _fit(active, y, design, every_row)
    _, unmoved, _ = _fit(none, aligned, design, every_row)
    moved = nuisance.shared_sum(unmoved * aligning)
    before = aligned - moved
    apart = [_apart_pa(law, i) for i in order]
    off = _off(design, as_read, left, sum(apart))
    recalibrated = None
    is_loose = design.priors.has_loose_curves
    every_curve = np.full(len(known.T), max(design.priors.curve_count, REFITTED_COUNT))
    std_count = every_curve if is_loose else _absorbed_count(law)
    if is_loose or any(each.term.is_memory for each in design.candidates):
        # The calibration may have been made with the memory at work.
        splines = curve_splines(seen.expected_count, seen.usable)
        recalibrated = fit_curves(splines, off, off + seen.activation_count, known, std_count, seen.noise_count)
        off = _heldout(design, off, splines, fold, std_count)
    static = _off(design, as_read, before)
    if seen.has_own_curves:  # nothing was handed in: it is compared with the static curves that fit best
        splines = curve_splines(seen.expected_count, seen.usable)
        static = _heldout(design, static, splines, fold, every_curve)
    squares = [_square(design, static), _square(design, off)]
    gains: list[float] = []
    previous = _square(design, _off(design, as_read, design.y - moved))
    timing_gain = max(squares[0] - previous, 0.0)
    explained = np.zeros_like(y)
    for m, i in enumerate(order, start=1):
        explained += design.moved_by(law.design.candidates[i], law.shares[i])
        _, shift, _ = _fit(none, design.y - explained, design, every_row)
        rest = design.y - explained - nuisance.shared_sum(shift * aligning)
        off = _off(design, as_read, rest, sum(apart[:m]))
        if recalibrated is not None and is_loose:
            at_count = off + seen.activation_count
            off -= fit_curves(splines, off, at_count, known, std_count, seen.noise_count).off_at(at_count)
        square = _square(design, off)
        gains.append(max(previous - square, 0.0))
        previous = min(previous, square)
    floor = np.hypot(_noise(design), _load_error_count(design, as_read, nuisance.load_error(shared, own)))
    rms = np.sqrt(np.array(squares))
    slope = np.sum(seen.slope_pa * seen.usable, axis=(0, 2)) / (len(seen.t_s) * np.maximum(seen.usable.sum(axis=1), 1))
    counts = [
        np.mean(each.T / np.where(known, design.weights, np.inf) / np.maximum(slope, 1e-9), axis=1, keepdims=True)
        for each in (before, left)
    ]
    beside = {
        int(k): float(share) for k, share in zip(active.beside, every[len(every) - len(active.beside) :], strict=True)
    }
    return Figures(
        rms[:1], rms[1:], np.minimum(floor, rms[1:]), counts[0], counts[1], np.asarray(known.any(axis=1)),
        lack_of_fit(_settled(refined).T, seen.step_s, EXPECTED), tuple(gains), timing_gain, shared, beside,
        recalibrated,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class OffByLoad:
    """What readings of all taxels are off by on average, in k classes of the load."""

    rows: Array  # (k,) readings in each class
    load_pa: Array  # (k,)
    activation_count: Array  # (k,) that the static curves expect
    after: Array  # (k,) counts that the laws of a set leave, with the curves as handed in
    moved: Array  # (k,) counts that the memories of it move readings by
    noise_count: float  # of a reading


def off_by_load(refined: Refined[BlockDesign]) -> OffByLoad:
    """Of a refined set, under a load that is known."""
    design, law = refined.design, refined.of_laws
    seen, as_read = design.unmoved, residual(design, Timing())
    moved = np.zeros_like(design.y)
    after = design.y
    for candidate, shares in zip(law.design.candidates, law.shares, strict=True):
        column = law.design.moved_by(candidate, shares)
        after = after - column
        moved = moved + column * candidate.term.is_memory
    as_handed_in, of_memories, of_all = (_off(design, as_read, rest) for rest in (design.y, design.y - moved, after))
    load = np.broadcast_to(seen.load_pa(seen.reference_s), of_all.shape)
    known = np.broadcast_to((design.weights > 0)[..., None], of_all.shape) & seen.usable
    edges = np.linspace(float(load[known].min()), float(load[known].max()), N_CLASSES + 1)
    of = np.clip(np.digitize(load[known], edges) - 1, 0, N_CLASSES - 1)
    rows = np.bincount(of, minlength=N_CLASSES).astype(float)
    # Unloaded readings have a range of their own, which curves that tell a load by its reading do not describe.
    kept = (rows > LEAST_READINGS) & (np.arange(N_CLASSES) > 0)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(of, values[known], N_CLASSES)[kept] / rows[kept])

    return OffByLoad(
        rows[kept], mean(load), mean(seen.expected_count), mean(of_all), mean(of_memories - as_handed_in),
        _noise(design),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Columns:
    """The k columns of a refined set that have shares: those of its candidates that are not 0, and their companions."""

    rows: NDArray[np.float32]  # (T, k, N)
    prior: Array  # (k,) standard deviations of the shares
    positive: NDArray[np.bool_]  # (k,) shares that have a sign
    sums: list[tuple[slice, float]]  # of shares whose sum has a bound, and the bound
    fixed_sum: Array  # (T, N) of the columns without a share
    beside: NDArray[np.intp]  # the companions' numbers in the design, which are the last columns

    @classmethod
    def none(cls, design: BlockDesign) -> _Columns:
        """No columns of `design`."""
        empty = np.empty(0)
        return cls(
            design.rows_of(empty.astype(np.intp)), empty, empty.astype(bool), [], np.zeros_like(design.y),
            empty.astype(np.intp),
        )  # fmt: skip


def _columns(refined: Refined[BlockDesign]) -> _Columns:
    design = refined.design
    own, fixed, positive, sums = [], [], [], []
    n = 0
    for candidate, shares in zip(design.candidates, refined.shares, strict=True):
        at = candidate.columns[shares != 0]
        if candidate.term.share == "whole":
            fixed.append(at)
            continue
        own.append(at)
        positive.append(np.full(len(at), candidate.term.share == "positive"))
        if np.isfinite(most := candidate.term.most(design.load.is_known)) and len(at):
            sums.append((slice(n, n + len(at)), most))
        n += len(at)
    every = np.concatenate([each.columns for each in design.candidates] or [np.empty(0, np.intp)])
    beside = np.setdiff1d(np.arange(len(design.atom)), every)
    strengths = [float(np.abs(each).sum()) for each in refined.shares]
    active = np.concatenate([*own, beside]).astype(np.intp)
    return _Columns(
        design.rows_of(active),
        np.concatenate([np.full(n, np.inf), absorbed_std(design.candidates, strengths, beside)]),
        np.concatenate([*positive, np.zeros(len(beside), bool)]).astype(bool),
        sums,
        design.rows_of(np.concatenate([*fixed, np.empty(0, np.intp)]).astype(np.intp)).sum(axis=1, dtype=float),
        beside,
    )


def square_by_triangle(refined: Refined[BlockDesign]) -> Array:
    """Return the squared residual (T,) of a refined set with what laws leave out, in variances of the noise."""
    return np.asarray(np.sum(_settled(refined) ** 2, axis=1))


def _settled(refined: Refined[BlockDesign]) -> Array:
    """(T, N) of all rows, what laws, what they leave out and nuisances leave."""
    design, nuisance = refined.design, refined.design.nuisance
    active = _columns(refined)
    y = design.y - active.fixed_sum
    theta, shift, own = _fit(active, y, design, np.ones(y.shape[1], bool))
    y -= nuisance.shared_sum(shift) + np.matmul(own[:, None], nuisance.own)[:, 0]
    for rest, columns in zip(y, active.rows, strict=True):
        rest -= theta @ columns
    return y


def _fit(active: _Columns, y: Array, design: BlockDesign, rows: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Shares (k,) of `active`, of the reference's (s,) and of each triangle's own (T, b) nuisances, on `rows` (N,)."""
    nuisance, own_prior = design.nuisance, np.diag(design.nuisance.own_std**-2.0)
    gram = np.diag(np.concatenate([active.prior, nuisance.shared_std]) ** -2.0)
    right = np.zeros(len(gram))
    solved = []  # of each triangle's own columns: with y, and with all others
    for t, left in enumerate(y[:, rows]):
        own = nuisance.own[t][:, rows]
        both = np.concatenate([active.rows[t][:, rows], nuisance.shared_of(t)[:, rows]])
        with_own = own @ np.column_stack([left, both.T])
        through = np.linalg.solve(own @ own.T + own_prior, with_own)
        gram += both @ both.T - with_own[:, 1:].T @ through[:, 1:]
        right += both @ left - with_own[:, 1:].T @ through[:, 0]
        solved.append(through)
    gram += np.diag(1e-12 * np.diag(gram) + 1e-300)
    positive = np.concatenate([active.positive, np.zeros(len(nuisance.shared_std), bool)])
    found = bounded(gram, right, positive, active.sums)
    per_triangle = np.stack([through[:, 0] - through[:, 1:] @ found for through in solved])
    return found[: len(active.prior)], found[len(active.prior) :], per_triangle


def _apart_pa(refined: Refined[BlockDesign], i: int) -> Array | float:
    """(N, T, 12) by which candidate `i` moves taxels more than their triangle; 0 where all bear the same load."""
    design, candidate = refined.design, refined.design.candidates[i]
    if design.seen.is_uniform:
        return 0.0
    load = TaxelLoad(design.seen, design.known_load.changes)
    moved = pressure_removed(design, load, candidate, refined.shares[i])
    mean = np.einsum("ntk,tkc->nt", np.broadcast_to(moved, design.seen.activation_count.shape), design.seen.arms)
    return np.asarray(np.where(design.seen.usable, moved - mean[:, :, None], 0.0))


def _off(design: BlockDesign, as_read: Array, left: Array, apart_pa: Array | float = 0.0) -> Array:
    """(N, T, 12) counts that the model is off by: each taxel keeps what makes it differ from its triangle."""
    seen = design.unmoved
    size = np.where(design.weights > 0, 1.0 / np.maximum(design.weights, 1e-300), 0.0)
    moved = (as_read - left).T * size  # Pa, that the model says otherwise
    return np.asarray(seen.activation_at(seen.load_less(moved, apart_pa)) - seen.activation_count)


def _absorbed_count(law: Refined[BlockDesign]) -> Array:
    """(T,) counts that the curves of a calibration may contain of the memories: no more than these move readings."""
    design, found = law.design, np.zeros(len(law.design.seen.layout))
    usable = design.seen.usable
    slope = np.sum(design.seen.slope_pa * usable, axis=2) / np.maximum(usable.sum(axis=1), 1)  # (N, T) Pa a count
    for candidate, shares in zip(design.candidates, law.shares, strict=True):
        if candidate.term.is_memory:
            columns = design.moved_by(candidate, shares)
            size = np.where(design.weights > 0, 1.0 / np.maximum(design.weights * slope, 1e-12), 0.0)
            moved = np.abs(columns.T * size)
            found += np.quantile(moved, OUTER, axis=0)
    return np.asarray(np.clip(found, LEAST_REFITTED_COUNT, REFITTED_COUNT))


def _heldout(design: BlockDesign, off: Array, splines: CurveSplines, fold: NDArray[np.intp], std_count: Array) -> Array:
    """`off` less what each taxel's own curve is off by, fitted to the other folds of rows.

    Curves are functions of what the model says is read: of readings, they would follow their noise.
    """
    seen = design.seen
    return heldout_rest(
        splines, off, off + seen.activation_count, design.weights > 0, std_count, seen.noise_count, fold
    )


def _noise(design: BlockDesign) -> float:
    """RMS noise of the readings, bursts included, counts."""
    seen = design.seen
    noise = np.broadcast_to(seen.noise_count, seen.activation_count.shape)
    if seen.noise_ratio is not None:
        noise = noise * seen.noise_ratio[..., None]
    return float(np.sqrt(_square(design, noise)))


def _load_error_count(design: BlockDesign, as_read: Array, load_error: Array) -> float:
    """RMS by which the weighted rows `load_error` (T, N) of a simulated load move readings, counts."""
    if not load_error.any():
        return 0.0
    moved = _off(design, as_read, design.y) - _off(design, as_read, design.y - load_error)
    return float(np.sqrt(_square(design, moved)))


def _square(design: BlockDesign, off: Array) -> float:
    """Mean square of `off` over taxels and rows, counts²."""
    return float(np.mean(np.square(off), where=(design.weights > 0)[..., None] & design.seen.usable))
