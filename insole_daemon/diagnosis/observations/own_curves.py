"""Static curves of an insole that was never calibrated: those that its own recordings in a chamber fit best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.calibration import Calibration
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..operators import relay
from .chamber import ChamberObservation, observe_chamber
from .wrench import LEAST_ROWS

PA_PER_COUNT = 8000.0  # until curves are fitted, to align clocks by
DEGREE = 5  # of what a taxel reads in the load
LEAST_ANSWER = 0.5  # of the variance of a taxel's readings, that is its curve's: less, and it tells little of the load
LEAST_STD_COUNT = 1.0  # of readings that answer
MOST_DEGREE = 11  # of the curve back from activation to pressure
NEAR_COUNT = 0.05  # RMS: a polynomial that says so nearly what the curve says is enough
BEYOND = np.linspace(0.01, 0.1, 10)  # of the range: over so much it goes on straight at either end
FLAT = 0.02  # of the usual slope: flatter, and a reading tells next to nothing of the load
N_LOADS = 200
UPS = np.arange(0.03, 0.95, 0.02)  # of the load's range: where a board may switch
DOWNS = (0.2, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9)  # of that, where it switches back
STEP_TIMES = 5.0  # what is left beside it, that a switch is at the least


def observe_uncalibrated(
    recordings: Sequence[Recording], feet: Sequence[FootRecording], progress: Callable[[str], None]
) -> list[ChamberObservation]:
    """Recordings of one insole by the static curves that fit all of them best; errors as `observe_chamber` has them."""
    rough = []
    lines = straight_lines(feet[0])
    for recording, foot in zip(recordings, feet, strict=True):
        progress(f"reading {recording.folder.name}")
        rough.append(observe_chamber(recording, foot, lines))
    curves = fitted_curves(feet[0], rough)
    moved_count = np.where(curves.usable, curves.baseline_count - lines.baseline_count, 0.0)
    found = []
    for each in rough:
        usable = each.usable & curves.usable
        activation = np.where(usable, each.activation_count + moved_count, 0.0)
        found.append(replace(each, calibration=curves, usable=usable, activation_count=activation, has_own_curves=True))
    return found


def straight_lines(foot: FootRecording) -> Calibration:
    """The same straight line for every taxel, from its highest count: enough to align clocks by."""
    usable = np.tile(PRESSURE_TAXELS, (len(foot.layout), 1))
    highest = np.quantile(foot.counts.reshape(len(foot.counts), -1, N_TAXELS), 0.99, axis=0)
    return _calibration(
        foot, np.where(usable, highest, np.nan), np.where(usable[..., None], (0.0, PA_PER_COUNT), np.nan)
    )


def fitted_curves(foot: FootRecording, observed: Sequence[ChamberObservation]) -> Calibration:
    """A curve for every taxel through the rows of all recordings, seen with `straight_lines`.

    What a taxel reads is fitted as a polynomial of the load, which is known better, and that is turned round. Where a
    board switches with the load, the curve is that of its lower state.
    """
    lines = observed[0].calibration
    load_pa = np.concatenate([each.reference.at(each.reference_s)[:, 0] for each in observed])
    known = np.concatenate([np.isfinite(each.weight_variance) for each in observed])
    activation = np.concatenate([each.activation_count for each in observed])
    usable = np.all([each.usable for each in observed], axis=0)
    grid_pa = np.linspace(float(load_pa.min()), float(load_pa.max()), N_LOADS)
    baseline = np.full(lines.baseline_count.shape, np.nan)
    highest = np.full(baseline.shape, np.inf)
    coefficients = np.full((*baseline.shape, MOST_DEGREE + 1), np.nan)
    boards = observed[0].layout.identities[:, 0]
    relays = {
        board: _switching(load_pa, activation[:, own], known[:, own], usable[own])
        for board in np.unique(boards).tolist()
        for own in (boards == board,)
    }
    for row in np.flatnonzero(usable.any(axis=1)).tolist():
        there = known[:, row]
        if there.sum() < LEAST_ROWS:
            continue
        load, taxels = load_pa[there], np.flatnonzero(usable[row])
        read = activation[there][:, row, taxels]
        powers = np.polynomial.chebyshev.chebvander(_within(load, grid_pa), DEGREE)
        switched = relays[int(boards[row])]
        if switched is not None:
            columns = np.concatenate([powers, switched[there, None]], axis=1)
            steps = np.linalg.lstsq(columns, read, rcond=None)[0][-1]
            read = read - switched[there, None] * steps
        shares = np.linalg.lstsq(powers, read, rcond=None)[0]
        level = np.maximum(np.var(read, axis=0), LEAST_STD_COUNT**2)
        answers = np.var(powers @ shares, axis=0) > LEAST_ANSWER * level
        curves = np.polynomial.chebyshev.chebvander(_within(grid_pa, grid_pa), DEGREE) @ shares
        for taxel, curve, is_good in zip(taxels.tolist(), curves.T, answers.tolist(), strict=True):
            if not is_good:
                continue
            rest = float(np.interp(0.0, grid_pa, curve))
            baseline[row, taxel] = lines.baseline_count[row, taxel] - rest
            back = turned_round(np.maximum.accumulate(curve - rest), grid_pa)
            coefficients[row, taxel] = np.pad(back, (0, MOST_DEGREE + 1 - len(back)))
            highest[row, taxel] = float(curve.max()) - rest
    return replace(_calibration(foot, baseline, coefficients), highest_count=highest)


def _switching(
    load_pa: Array, activation_count: Array, known: NDArray[np.bool_], usable: NDArray[np.bool_]
) -> Array | None:
    """(N,) 1 while a board whose taxels read more by a step above one load, until it falls below another; or None."""
    there = known.any(axis=1)
    if not usable.any() or there.sum() < LEAST_ROWS:
        return None
    mean = np.median(activation_count[:, usable], axis=1)
    low, high = float(load_pa[there].min()), float(load_pa[there].max())
    powers = np.polynomial.chebyshev.chebvander(_within(load_pa, np.array([low, high])), DEGREE)
    basis = np.linalg.qr(powers[there])[0]
    left = mean[there] - basis @ (basis.T @ mean[there])
    best, found = 0.0, None
    for up in UPS:
        for down in DOWNS:
            on = relay(load_pa[:, None], low + up * (high - low), low + down * up * (high - low))[:, 0]
            column = on[there] - basis @ (basis.T @ on[there])
            square = float(column @ column)
            step = float(column @ left) / square if square > 1.0 else 0.0
            rest = float(np.std(left - step * column))
            if step > STEP_TIMES * rest and step**2 * square > best:
                best, found = step**2 * square, on
    return found


def turned_round(activation_count: Array, load_pa: Array) -> Array:
    """(k,) coefficients of the load as a rising polynomial of the activation, for a rising curve on g loads.

    What it is off counts as it would be read: where the curve is flat, as beyond a knee, a pascal is little.
    """
    slope = np.gradient(activation_count, load_pa)
    slope = np.maximum(slope, FLAT * max(float(np.ptp(activation_count)), 1e-9) / float(np.ptp(load_pa)))
    more = BEYOND * float(np.ptp(load_pa))
    ends = [(load_pa[0] - more[::-1], activation_count[0] - more[::-1] * slope[0]),
            (load_pa, activation_count),
            (load_pa[-1] + more, activation_count[-1] + more * slope[-1])]  # fmt: skip
    load, read = (np.concatenate(each) for each in zip(*ends, strict=True))
    weight = np.concatenate([np.full(len(more), slope[0]), slope, np.full(len(more), slope[-1])])
    scale = max(float(np.abs(read).max()), 1e-9)
    grid = np.linspace(float(read.min()), float(read.max()), N_LOADS) / scale
    best, nearest = np.array([0.0, max(float(load_pa[-1]), 1.0) / scale]), np.inf
    for degree in range(1, MOST_DEGREE + 1):
        powers = np.vander(read / scale, degree + 1, increasing=True)
        found = np.linalg.lstsq(powers * weight[:, None], load * weight, rcond=None)[0]
        rises = np.polynomial.polynomial.polyval(grid, found[1:] * np.arange(1, degree + 1)) > 0
        off = float(np.sqrt(np.mean(((powers @ found - load) * weight) ** 2)))
        if rises.all() and off < nearest:
            best, nearest = found / scale ** np.arange(degree + 1), off
        if nearest < NEAR_COUNT:
            break
    return best


def _within(load_pa: Array, grid_pa: Array) -> Array:
    """-1 at the least load of the grid, 1 at the highest."""
    return np.asarray(2.0 * (load_pa - grid_pa[0]) / (grid_pa[-1] - grid_pa[0]) - 1.0)


def _calibration(foot: FootRecording, baseline_count: Array, coefficients_pa: Array) -> Calibration:
    made_by = {"source": "fitted to the recordings that are diagnosed"}
    return Calibration(foot.foot, baseline_count, coefficients_pa, None, ~np.isnan(baseline_count), made_by)
