"""Fit static curves to the recordings of an uncalibrated insole in a chamber."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.polynomial.chebyshev import chebder, chebval, chebvander
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ...physics.calibration import Calibration
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..operators import relay
from .chamber import ChamberObservation, observe_chamber
from .grid_readings import LEAST_ROWS

PA_PER_COUNT = 8000.0  # of the provisional straight curves
DEGREE = 5  # of a taxel's reading as a polynomial of the load
LEAST_FIT_SHARE = 0.5  # of the variance of a taxel's readings that its curve explains, for a usable taxel
LEAST_STD_COUNT = 1.0  # of the readings of a usable taxel
MOST_DEGREE = 15  # of the curve from activation to pressure
CLOSE_FIT_COUNT = 0.02  # RMS error at which no higher degree is tried
LEAST_SLOPE = 0.02  # of the mean slope: flatter parts of a curve carry hardly any information on the load
MOST_SLOPE = 4.0  # of the mean slope
BELOW = 0.1  # of the range: a curve is continued straight so far below its lowest activation and no load
ABOVE = 1.5  # and up to this multiple of its highest activation
N_BEYOND = 40  # points of a straight continuation
BEYOND = 0.3  # their weight, relative to that of their slope
LEAST_END_SLOPE = 0.25  # of the mean slope, of a continuation
N_LOADS = 200
# Slopes (N_LOADS, MOST_DEGREE + 1) of Chebyshev polynomials over their range.
SLOPES = chebval(np.linspace(-1.0, 1.0, N_LOADS), chebder(np.eye(MOST_DEGREE + 1))).T
SWITCH_ON = np.arange(0.03, 0.95, 0.02)  # shares of the load's range at which a board may switch on
SWITCH_OFF = (0.2, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9)  # shares of that load at which it switches off
LEAST_STEP = 5.0  # in standard deviations of the residual


def observe_uncalibrated(
    recordings: Sequence[Recording], feet: Sequence[FootRecording], progress: Callable[[str], None]
) -> list[ChamberObservation]:
    """Return observations of recordings of one insole, by the static curves that fit all of them best.

    Raises as `observe_chamber`.
    """
    provisional = []
    lines = straight_lines(feet[0])
    for recording, foot in zip(recordings, feet, strict=True):
        progress(f"reading {recording.folder.name}")
        provisional.append(observe_chamber(recording, foot, lines))
    curves = fitted_curves(feet[0], provisional)
    baseline_change_count = np.where(curves.usable, curves.baseline_count - lines.baseline_count, 0.0)
    observations = []
    for seen in provisional:
        usable = seen.usable & curves.usable
        activation = np.where(usable, seen.activation_count + baseline_change_count, 0.0)
        observations.append(
            replace(seen, calibration=curves, usable=usable, activation_count=activation, has_own_curves=True)
        )
    return observations


def straight_lines(foot: FootRecording) -> Calibration:
    """Return the same straight curve for every taxel, from its highest count: sufficient to align clocks."""
    usable = np.tile(PRESSURE_TAXELS, (len(foot.layout), 1))
    highest = np.quantile(foot.counts.reshape(len(foot.counts), -1, N_TAXELS), 0.99, axis=0)
    return _calibration(
        foot, np.where(usable, highest, np.nan), np.where(usable[..., None], (0.0, PA_PER_COUNT), np.nan)
    )


def fitted_curves(foot: FootRecording, observed: Sequence[ChamberObservation]) -> Calibration:
    """Return the curve of every taxel by least squares over the rows of all recordings, observed with `straight_lines`.

    The reading is fitted as a polynomial of the load, whose errors are smaller, and the polynomial is inverted. Where a
    board switches with the load (`_find_relay`), the curve is that of its lower state.
    """
    provisional = observed[0].calibration
    load_pa = np.concatenate([seen.reference.at(seen.reference_s)[:, 0] for seen in observed])
    known = np.concatenate([np.isfinite(seen.weight_variance) for seen in observed])
    activation = np.concatenate([seen.activation_count for seen in observed])
    usable = np.all([seen.usable for seen in observed], axis=0)
    grid_pa = np.linspace(float(load_pa.min()), float(load_pa.max()), N_LOADS)
    baseline = np.full(provisional.baseline_count.shape, np.nan)
    highest = np.full(baseline.shape, np.inf)
    coefficients = np.full((*baseline.shape, MOST_DEGREE + 1), np.nan)
    boards = observed[0].layout.identities[:, 0]
    relays = {
        board: _find_relay(load_pa, activation[:, of_board], known[:, of_board], usable[of_board])
        for board in np.unique(boards).tolist()
        for of_board in (boards == board,)
    }
    for row in np.flatnonzero(usable.any(axis=1)).tolist():
        row_known = known[:, row]
        if row_known.sum() < LEAST_ROWS:
            continue
        load, taxels = load_pa[row_known], np.flatnonzero(usable[row])
        activation_of_row = activation[row_known][:, row, taxels]
        basis = chebvander(_normalised(load, grid_pa), DEGREE)
        relay_state = relays[int(boards[row])]
        if relay_state is not None:
            columns = np.concatenate([basis, relay_state[row_known, None]], axis=1)
            steps = np.linalg.lstsq(columns, activation_of_row, rcond=None)[0][-1]
            activation_of_row = activation_of_row - relay_state[row_known, None] * steps
        coefficients_of_load = np.linalg.lstsq(basis, activation_of_row, rcond=None)[0]
        variance = np.maximum(np.var(activation_of_row, axis=0), LEAST_STD_COUNT**2)
        responds = np.var(basis @ coefficients_of_load, axis=0) > LEAST_FIT_SHARE * variance
        curves = chebvander(_normalised(grid_pa, grid_pa), DEGREE) @ coefficients_of_load
        for taxel, curve, is_good in zip(taxels.tolist(), curves.T, responds.tolist(), strict=True):
            rising = np.maximum.accumulate(curve)
            if not is_good or rising[-1] == rising[0]:
                continue
            at_rest = float(np.interp(0.0, grid_pa, curve))
            baseline[row, taxel] = provisional.baseline_count[row, taxel] - at_rest
            inverse = invert_curve(rising - at_rest, grid_pa)
            coefficients[row, taxel] = np.pad(inverse, (0, MOST_DEGREE + 1 - len(inverse)))
            highest[row, taxel] = float(curve.max()) - at_rest
    return replace(_calibration(foot, baseline, coefficients), highest_count=highest)


def _find_relay(
    load_pa: Array, activation_count: Array, known: NDArray[np.bool_], usable: NDArray[np.bool_]
) -> Array | None:
    """Return 1 while a board whose readings switch up above one load and down below another is up (N,), or None.

    The thresholds are searched on a grid; the step has to be LEAST_STEP times the residual's standard deviation.
    """
    row_known = known.any(axis=1)
    if not usable.any() or row_known.sum() < LEAST_ROWS:
        return None
    median_count = np.median(activation_count[:, usable], axis=1)
    low, high = float(load_pa[row_known].min()), float(load_pa[row_known].max())
    polynomials = chebvander(_normalised(load_pa, np.array([low, high])), DEGREE)
    basis = np.linalg.qr(polynomials[row_known])[0]
    residual = median_count[row_known] - basis @ (basis.T @ median_count[row_known])
    best_gain, best_state = 0.0, None
    for up in SWITCH_ON:
        for down in SWITCH_OFF:
            state = relay(load_pa[:, None], low + up * (high - low), low + down * up * (high - low))[:, 0]
            column = state[row_known] - basis @ (basis.T @ state[row_known])
            square_sum = float(column @ column)
            step = float(column @ residual) / square_sum if square_sum > 1.0 else 0.0
            residual_std = float(np.std(residual - step * column))
            if step > LEAST_STEP * residual_std and step**2 * square_sum > best_gain:
                best_gain, best_state = step**2 * square_sum, state
    return best_state


def invert_curve(activation_count: Array, load_pa: Array) -> Array:
    """Return coefficients (k,) of the load as a rising polynomial of the activation, from no load to beyond the end.

    The curve is given by its rising activation (g,), counts, at loads (g,), Pa. Errors are weighted by its slope, so
    they are in counts: where the curve is flat, as beyond a knee, an error in pascals matters little. Where the load
    hardly rises with the activation, as near an extremum of a polynomial that was handed in, the slope is limited, too.
    Where it does not rise at all, only the last point is used. Beyond its ends the curve is continued straight: a foot
    loads taxels less and more than a chamber did, and a polynomial may have any value where it was fitted to nothing.
    """
    rises = np.diff(load_pa, append=np.inf) > 0.0
    activation_count, load_pa = activation_count[rises], load_pa[rises]
    activation, load, weight = _continued(activation_count, load_pa)
    given = slice(N_BEYOND, -N_BEYOND)
    domain = activation[[0, -1]]
    columns = chebvander(_normalised(activation, domain), MOST_DEGREE) * weight[:, None]
    orthogonal, triangular = np.linalg.qr(columns)
    right = orthogonal.T @ (load * weight)
    best, least_error = np.zeros(1), np.inf
    for degree in range(1, MOST_DEGREE + 1):
        fitted = solve_triangular(triangular[: degree + 1, : degree + 1], right[: degree + 1])
        rms_error = float(np.sqrt(np.mean((columns[given, : degree + 1] @ fitted - (load * weight)[given]) ** 2)))
        if rms_error < least_error and (SLOPES[:, : degree + 1] @ fitted > 0.0).all():
            best, least_error = fitted, rms_error
        if least_error < CLOSE_FIT_COUNT:
            break
    return np.asarray(Chebyshev(best, domain=domain).convert(kind=Polynomial).coef)


def _continued(activation_count: Array, load_pa: Array) -> tuple[Array, Array, Array]:
    """Return a curve with N_BEYOND points of a straight line before and after it, and the weights of all points.

    Activations (g,), counts, and loads (g,), Pa, become (g + 2 N_BEYOND,); a weight is a slope, counts per Pa.
    """
    mean_slope = float(np.ptp(activation_count)) / float(np.ptp(load_pa))
    slope = np.clip(np.gradient(activation_count, load_pa), LEAST_SLOPE * mean_slope, MOST_SLOPE * mean_slope)
    first, last = float(activation_count[0]), float(activation_count[-1])
    below = np.linspace(min(first, 0.0) - BELOW * (last - first), first, N_BEYOND, endpoint=False)
    above = np.linspace(max(ABOVE * last, last + BELOW * (last - first)), last, N_BEYOND, endpoint=False)[::-1]
    low, high = np.maximum(slope[[0, -1]], LEAST_END_SLOPE * mean_slope).tolist()
    activation = np.concatenate([below, activation_count, above])
    load = np.concatenate([load_pa[0] + (below - first) / low, load_pa, load_pa[-1] + (above - last) / high])
    weight = np.concatenate([np.full(N_BEYOND, BEYOND * low), slope, np.full(N_BEYOND, BEYOND * high)])
    return activation, load, weight


def _normalised(load_pa: Array, grid_pa: Array) -> Array:
    """Return the load relative to the range of the grid: −1 at its lowest load, 1 at its highest."""
    return np.asarray(2.0 * (load_pa - grid_pa[0]) / (grid_pa[-1] - grid_pa[0]) - 1.0)


def _calibration(foot: FootRecording, baseline_count: Array, coefficients_pa: Array) -> Calibration:
    made_by = {"source": "fitted to the recordings that are diagnosed"}
    return Calibration(foot.foot, baseline_count, coefficients_pa, None, ~np.isnan(baseline_count), made_by)
