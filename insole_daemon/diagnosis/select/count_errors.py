"""Cross-validated errors of all taxels in counts, with the model as handed in and with the selected set of terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..load_estimate import TaxelLoad
from ..model.blocks import BlockDesign, residual
from ..model.curves import CurveShares, CurveSplines, curve_splines, fit_curves, heldout_rest
from ..model.refine import Refined
from ..model.regression import Timing
from ..model.signal_path import pressure_removed
from ..model.solve import absorbed_std, bounded
from ..observations.chamber import ChamberObservation
from .residual_tests import lack_of_fit
from .wrench_errors import FOLD_S, N_FOLDS, HeldoutErrors

REFITTED_COUNT = 5.0  # upper bound of the prior standard deviation of a curve's error that a memory or snap caused
LEAST_REFITTED_COUNT = 1e-3  # the same without either
OUTER = 0.998  # quantile that stands for the maximum
ALIGNING = ("offset_s", "rate", "burst")  # shared nuisances that only align times
EXPECTED = 1.0  # mean square of weighted rows; noise of the reference and jitter of time stamps are its slow part
N_CLASSES, LEAST_READINGS = 24, 50  # number of load classes, and of readings in a class for a mean


def count_errors(refined: Refined[BlockDesign], order: Sequence[int]) -> HeldoutErrors:
    """Return the errors of a refined set over usable taxels, in counts; its candidates are added in `order`.

    `before` has the model as handed in, after the alignment of a free clock. `after` has the laws alone, without
    companions for their misfit, on held-out blocks with coefficients from the other blocks. The floor is the noise of
    the readings and the error of a simulated load, which no model of the sensor takes away.
    """
    design = refined.design
    seen, nuisance = design.seen, design.nuisance
    n = len(design.weights)
    known = design.weights > 0
    law = refined.of_laws
    active, none = _columns(law), _Columns.none(design)
    aligning = np.array([name in ALIGNING for name in nuisance.shared_names])
    as_read = residual(design, Timing())
    # A free clock is aligned in the model as handed in, too: its offset is no effect.
    alignment = Timing(design.timing.delay_s if seen.offset_is_free else 0.0)
    aligned = residual(design, alignment)
    x, y = active.rows, design.y - active.fixed_sum
    fold = (np.arange(n) * seen.step_s // FOLD_S).astype(int) % N_FOLDS
    residual_rows = np.empty_like(y)
    for k in range(N_FOLDS):
        held = fold == k
        theta, shift, _ = _fit(active, y, design, ~held)
        # Recalibration within its prior is a nuisance and is not in the exported model.
        rest = y - nuisance.shared_sum(shift * aligning)
        for t, columns in enumerate(x):
            residual_rows[t, held] = rest[t, held] - theta @ columns[:, held]
    every_row = np.ones(n, bool)
    _, shared, own = _fit(active, y, design, every_row)
    _, unmoved, _ = _fit(none, aligned, design, every_row)
    moved = nuisance.shared_sum(unmoved * aligning)
    before = aligned - moved
    of_alignment, of_timing = (_deviation_by_timing(design, timing) for timing in (alignment, design.timing))
    deviations = [_deviation_from_mean(law, i) for i in order]
    apart = sum(deviations, start=of_timing)
    off = _error_count(design, as_read, residual_rows, design.unmoved, apart)
    recalibrated = None
    is_loose = design.priors.has_loose_curves
    every_curve = np.full(len(known.T), max(design.priors.curve_count, REFITTED_COUNT))
    std_count = every_curve if is_loose else _absorbed_count(law)
    if is_loose or any(each.term.is_loop for each in design.candidates):
        # The calibration may have been made while the memory or snap acted.
        at_count = off + seen.activation_count
        splines = curve_splines(at_count, seen.usable)
        by_laws = design.y - nuisance.shared_sum(shared * aligning)
        for candidate, shares in zip(law.design.candidates, law.shares, strict=True):
            by_laws -= design.contribution(candidate, shares)
        recalibrated = _corrections(design, _error_count(design, as_read, by_laws, design.unmoved, apart))
        off = _heldout(design, off, splines, fold, std_count)
    static = _error_count(design, as_read, before, design.unmoved.as_handed_in, of_alignment)
    if seen.has_own_curves:  # no calibration was handed in: `before` has the best static curves
        static = _heldout(design, static, curve_splines(seen.expected_count, seen.usable), fold, every_curve)
    squares = [_square(design, static), _square(design, off)]
    gains: list[float] = []
    previous = _square(design, _error_count(design, as_read, design.y - moved, design.unmoved.as_handed_in, of_timing))
    timing_gain = max(squares[0] - previous, 0.0)
    explained = np.zeros_like(y)
    for m, i in enumerate(order, start=1):
        explained += design.contribution(law.design.candidates[i], law.shares[i])
        _, shift, _ = _fit(none, design.y - explained, design, every_row)
        rest = design.y - explained - nuisance.shared_sum(shift * aligning)
        off = _error_count(design, as_read, rest, design.unmoved, sum(deviations[:m], start=of_timing))
        if is_loose or any(law.design.candidates[j].term.is_loop for j in order[:m]):
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
        for each in (before, residual_rows)
    ]
    return HeldoutErrors(
        rms[:1], rms[1:], np.minimum(floor, rms[1:]), counts[0], counts[1], np.asarray(known.any(axis=1)),
        lack_of_fit(residual_with_companions(refined).T, seen.step_s, EXPECTED), tuple(gains), timing_gain, shared,
        recalibrated,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class ErrorByLoad:
    """Mean errors of the readings of all taxels in k classes of the load."""

    rows: Array  # (k,) number of readings
    load_pa: Array  # (k,)
    activation_count: Array  # (k,) by the static curves
    after: Array  # (k,) error with the laws of a set and the curves handed in, counts
    memory: Array  # (k,) change of the readings by the memories and snaps of the set, counts
    noise_count: float  # of a reading


def errors_by_load(refined: Refined[BlockDesign], places: Sequence[NDArray[np.bool_]]) -> list[ErrorByLoad]:
    """Return the mean errors by load class of a refined set at each of the `places`, triangles (T,).

    Classes have equal widths of load and are the same at all places.
    """
    design, law = refined.design, refined.of_laws
    corrected, as_read = design.unmoved, residual(design, Timing())
    seen = corrected.as_handed_in
    moved = np.zeros_like(design.y)
    after = design.y
    for candidate, shares in zip(law.design.candidates, law.shares, strict=True):
        column = law.design.contribution(candidate, shares)
        after = after - column
        moved = moved + column * candidate.term.is_loop
    of_static, of_memories, of_all = (
        _error_count(design, as_read, rest, corrected) for rest in (design.y, design.y - moved, after)
    )
    of_memory = of_memories - of_static
    if seen is not corrected:
        of_all += _error_count(design, as_read, design.y - moved, seen) - of_memories
    load = np.broadcast_to(seen.load_pa(seen.reference_s), of_all.shape)
    known = np.broadcast_to((design.weights > 0)[..., None], of_all.shape) & seen.usable
    edges = np.linspace(float(load[known].min()), float(load[known].max()), N_CLASSES + 1)
    at_place = [known & place[:, None] for place in places]
    class_of = [np.clip(np.digitize(load[at], edges) - 1, 0, N_CLASSES - 1) for at in at_place]
    rows = [np.bincount(of, minlength=N_CLASSES).astype(float) for of in class_of]
    # Without the class of unloaded readings: a curve from reading to load has no range of readings at load 0.
    kept = (np.min(rows, axis=0) > LEAST_READINGS) & (np.arange(N_CLASSES) > 0)

    def mean(values: Array, i: int) -> Array:
        return np.asarray(np.bincount(class_of[i], values[at_place[i]], N_CLASSES)[kept] / rows[i][kept])

    return [
        ErrorByLoad(
            rows[i][kept], mean(load, i), mean(seen.expected_count, i), mean(of_all, i), mean(of_memory, i),
            _noise(design),
        ) for i in range(len(places))
    ]  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Columns:
    """The k columns of a refined set with coefficients: of candidates if not 0, and of companions."""

    rows: NDArray[np.float32]  # (T, k, N) weighted
    prior: Array  # (k,) prior standard deviations of the coefficients
    positive: NDArray[np.bool_]  # (k,) coefficients that are at least 0
    sums: list[tuple[slice, float]]  # coefficients whose sum is bounded, and the bound
    fixed_sum: Array  # (T, N) sum of the columns with a fixed share of 1
    companions: NDArray[np.intp]  # numbers in the design of the companions, which are the last columns

    @classmethod
    def none(cls, design: BlockDesign) -> _Columns:
        """Return an empty set of columns of `design`."""
        empty = np.empty(0)
        return cls(
            design.rows_of(empty.astype(np.intp)), empty, empty.astype(bool), [], np.zeros_like(design.y),
            empty.astype(np.intp),
        )  # fmt: skip


def _columns(refined: Refined[BlockDesign]) -> _Columns:
    """Return the columns of a refined set, with the bounds and priors that its search had."""
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
        if np.isfinite(most := candidate.term.sum_bound(design.load.is_known)) and len(at):
            sums.append((slice(n, n + len(at)), most))
        n += len(at)
    every = np.concatenate([each.columns for each in design.candidates] or [np.empty(0, np.intp)])
    companions = np.setdiff1d(np.arange(len(design.atom)), every)
    strengths = [float(np.abs(each).sum()) for each in refined.shares]
    active = np.concatenate([*own, companions]).astype(np.intp)
    return _Columns(
        design.rows_of(active),
        np.concatenate([np.full(n, np.inf), absorbed_std(design.candidates, strengths, companions)]),
        np.concatenate([*positive, np.zeros(len(companions), bool)]).astype(bool),
        sums,
        design.rows_of(np.concatenate([*fixed, np.empty(0, np.intp)]).astype(np.intp)).sum(axis=1, dtype=float),
        companions,
    )


def residual_squares(refined: Refined[BlockDesign]) -> Array:
    """Return the squared residual (T,) of a refined set with its companions, in variances of the noise."""
    return np.asarray(np.sum(residual_with_companions(refined) ** 2, axis=1))


def residual_with_companions(refined: Refined[BlockDesign]) -> Array:
    """Return the weighted residual (T, N) of laws, companions and nuisances fitted to all rows."""
    design, nuisance = refined.design, refined.design.nuisance
    active = _columns(refined)
    y = design.y - active.fixed_sum
    theta, shift, own = _fit(active, y, design, np.ones(y.shape[1], bool))
    y -= nuisance.shared_sum(shift) + np.matmul(own[:, None], nuisance.own)[:, 0]
    for rest, columns in zip(y, active.rows, strict=True):
        rest -= theta @ columns
    return y


def _fit(active: _Columns, y: Array, design: BlockDesign, rows: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Return the coefficients (k,) of `active`, (s,) of shared and (T, b) of own nuisances, fitted to `rows` (N,).

    `y`: (T, N). A triangle's own nuisances are eliminated block by block (Schur complement).
    """
    nuisance, own_prior = design.nuisance, np.diag(design.nuisance.own_std**-2.0)
    gram = np.diag(np.concatenate([active.prior, nuisance.shared_std]) ** -2.0)
    right = np.zeros(len(gram))
    solved = []  # for each triangle: regression of y and of all other columns on its own nuisances
    for t, left in enumerate(y[:, rows]):
        own = nuisance.own[t][:, rows]
        other_columns = np.concatenate([active.rows[t][:, rows], nuisance.shared_of(t)[:, rows]])
        with_own = own @ np.column_stack([left, other_columns.T])
        through = np.linalg.solve(own @ own.T + own_prior, with_own)
        gram += other_columns @ other_columns.T - with_own[:, 1:].T @ through[:, 1:]
        right += other_columns @ left - with_own[:, 1:].T @ through[:, 0]
        solved.append(through)
    gram += np.diag(1e-12 * np.diag(gram) + 1e-300)
    positive = np.concatenate([active.positive, np.zeros(len(nuisance.shared_std), bool)])
    theta = bounded(gram, right, positive, active.sums)
    per_triangle = np.stack([through[:, 0] - through[:, 1:] @ theta for through in solved])
    return theta[: len(active.prior)], theta[len(active.prior) :], per_triangle


def _deviation_from_mean(refined: Refined[BlockDesign], i: int) -> Array | float:
    """Return the effect of candidate `i` on each taxel minus that on its triangle's mean (N, T, 12), Pa.

    0 if the load is uniform.
    """
    design, candidate = refined.design, refined.design.candidates[i]
    if design.seen.is_uniform:
        return 0.0
    load = TaxelLoad(design.seen, design.known_load.changes)
    return _from_mean(design, pressure_removed(design, load, candidate, refined.shares[i]))


def _deviation_by_timing(design: BlockDesign, timing: Timing) -> Array | float:
    """Return by how much a timing reduces the load of each taxel beyond that of its triangle's mean (N, T, 12), Pa.

    0 if the load is uniform.
    """
    as_read = design.unmoved
    if as_read.is_uniform or timing == Timing():
        return 0.0
    timed = as_read.timed(offset_s=as_read.offset_s - timing.delay_s, lag_s=timing.lag_s)
    return _from_mean(design, as_read.load_pa(as_read.reference_s) - timed.load_pa(timed.reference_s))


def _from_mean(design: BlockDesign, pressure_pa: Array) -> Array:
    """Return pressures that broadcast to (N, T, 12) minus the mean of their triangle; 0 for unused taxels."""
    usable = design.seen.usable
    mean_pa = np.einsum(
        "ntk,tkc->nt", np.broadcast_to(pressure_pa, (len(design.weights), *usable.shape)), design.seen.arms
    )
    return np.asarray(np.where(usable, pressure_pa - mean_pa[:, :, None], 0.0))


def _error_count(
    design: BlockDesign,
    as_read: Array,
    residual_rows: Array,
    by: ChamberObservation,
    deviation_pa: Array | float = 0.0,
) -> Array:
    """Return the error (N, T, 12) of the model in counts, by the curves of the observation `by`.

    `as_read`, `residual_rows`: (T, N) weighted residuals of the static model without a timing, and of the model. The
    deviation of a taxel from its triangle's mean `deviation_pa` is kept.
    """
    size = np.where(design.weights > 0, 1.0 / np.maximum(design.weights, 1e-300), 0.0)
    change_pa = (as_read - residual_rows).T * size  # of the load by the model, against the static model
    return np.asarray(by.activation_at(by.load_less(change_pa, deviation_pa)) - by.activation_count)


def _absorbed_count(law: Refined[BlockDesign]) -> Array:
    """Return the prior standard deviation (T,) of curve errors, counts: the largest effect of memories and snaps."""
    design, largest = law.design, np.zeros(len(law.design.seen.layout))
    usable = design.seen.usable
    slope = np.sum(design.seen.slope_pa * usable, axis=2) / np.maximum(usable.sum(axis=1), 1)  # (N, T) Pa a count
    for candidate, shares in zip(design.candidates, law.shares, strict=True):
        if candidate.term.is_loop:
            columns = design.contribution(candidate, shares)
            size = np.where(design.weights > 0, 1.0 / np.maximum(design.weights * slope, 1e-12), 0.0)
            moved = np.abs(columns.T * size)
            largest += np.quantile(moved, OUTER, axis=0)
    return np.asarray(np.clip(largest, LEAST_REFITTED_COUNT, REFITTED_COUNT))


def _heldout(design: BlockDesign, off: Array, splines: CurveSplines, fold: NDArray[np.intp], std_count: Array) -> Array:
    """Return the error `off` (N, T, 12) minus the curve error of each taxel, fitted to the other folds of rows.

    Curve errors are functions of the modelled reading: as functions of the reading they would follow its noise.
    """
    seen = design.seen
    return heldout_rest(
        splines, off, off + seen.activation_count, design.weights > 0, std_count, seen.noise_count, fold
    )


def _corrections(design: BlockDesign, off: Array) -> CurveShares:
    """Return the corrections of the curves by the error `off` (N, T, 12) of the laws with the curves handed in, counts.

    Companions are linear about these curves and describe what a memory changes in them only if that is little.
    """
    seen, known = design.seen, design.weights > 0
    at_count, is_used = off + seen.activation_count, known[..., None] & seen.usable
    size_count = np.sqrt(np.mean(off**2, axis=(0, 2), where=is_used | ~is_used.any(axis=(0, 2), keepdims=True)))
    return fit_curves(
        curve_splines(at_count, seen.usable), off, at_count, known, np.maximum(size_count, LEAST_REFITTED_COUNT),
        seen.noise_count,
    )  # fmt: skip


def _noise(design: BlockDesign) -> float:
    """Return the RMS noise of the readings with noise bursts, counts."""
    seen = design.seen
    noise = np.broadcast_to(seen.noise_count, seen.activation_count.shape)
    if seen.noise_ratio is not None:
        noise = noise * seen.noise_ratio[..., None]
    return float(np.sqrt(_square(design, noise)))


def _load_error_count(design: BlockDesign, as_read: Array, load_error: Array) -> float:
    """Return the RMS by which the weighted rows `load_error` (T, N) of a simulated load change readings, counts."""
    if not load_error.any():
        return 0.0
    seen = design.unmoved
    moved = _error_count(design, as_read, design.y, seen) - _error_count(design, as_read, design.y - load_error, seen)
    return float(np.sqrt(_square(design, moved)))


def _square(design: BlockDesign, off: Array) -> float:
    """Return the mean square of `off` (N, T, 12) over usable taxels and known rows, counts²."""
    return float(np.mean(np.square(off), where=(design.weights > 0)[..., None] & design.seen.usable))
