"""Fit offset and rate between the clocks of the taxels and of a reference, together with the relation of the two.

    t_reference = offset_s + (1 + rate)·t_can                                         (the law `clock`)

With the right clocks the reference is a linear combination of the taxels' features:

    r(offset + (1 + rate)·t_n) = Σ_k β_k·x_kn + e_n

The features x are powers of the taxels' mean activation for a chamber, the wrench of a calibration for a shoe. Only the
edges of both are compared: the deviation from the mean of the surrounding seconds. Creep, hysteresis, drift and a wrong
curve would otherwise look like a late clock, by half a second in the published chamber. A delay of all taxels, and a
memory shorter than the edges, cannot be distinguished from an offset.

For given clocks β is a linear problem, which leaves two unknowns. They are searched on a grid, all offsets of one rate
at once by a Fourier transform, and refined by Gauss–Newton steps, each a linear problem in β and both unknowns. The
last steps use Tukey's weights, so that spikes have no influence.

Sources: separable least squares, Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973) 413–432; weights, Beaton & Tukey,
Technometrics 16 (1974) 147–185; standard deviations by sums over blocks, because the residual is not white, Liang &
Zeger, Biometrika 73 (1986) 13–22.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from ..errors import CalibrationError

Array: TypeAlias = NDArray[np.float64]

_MAX_GRID = 1 << 14  # samples of the grid search
_RATE_STEP_S = 0.25  # time between two rates of the grid at the trial's ends
_SLOW_S = 8.0  # slower changes are no edges
_SLOPE_S = 0.2  # span of a slope; the difference of two successive readings is mostly noise
_FLAT = 0.01  # fraction of the reference's variance that is added, since a constant stretch fits anything
_SMOOTHED_S = 0.5
_BETTER_BY = 0.5  # the unexplained fraction must be smaller by this factor to prefer the other start
_MAX_STEPS = 20  # Gauss–Newton usually converges in three to six
_SMALL_STEP_S = 1e-5
TUKEY = 4.685  # robust standard deviations beyond which a weight is 0; 95 % efficient for normal errors
_BLOCK_S, _BLOCKS = 20.0, (6, 30)  # longer than the residual's correlation; least and most blocks
_MIN_OVERLAP = 0.5  # fraction of the taxels' samples; less may agree by chance
_MIN_EXPLAINED = 0.25  # fraction of the variance of the reference's edges; unrelated signals explain up to 0.2


@dataclass(frozen=True, slots=True)
class Clock:
    """The reference's clock relative to the taxels' clock."""

    offset_s: float  # the reference's time at time 0 of the taxels
    rate: float
    offset_std_s: float  # from the residual; excludes a delay common to all taxels
    rate_std: float
    explained: float  # fraction of the variance of the reference's edges that the taxels explain

    def reference_s(self, t_s: Array) -> Array:
        """Return (n,) the reference's times at the taxels' times `t_s`."""
        return self.offset_s + (1.0 + self.rate) * t_s


def row_times_s(t_s: Array, rows: int) -> Array:
    """Return (rows,) times for a reference without times, as if each row were read with the cycle of the same number.

    Beyond the last cycle the mean period continues. Offset and rate fitted with these times are relative to pairing row
    by row.
    """
    return float(t_s[0]) + np.arange(rows) * float(t_s[-1] - t_s[0]) / (len(t_s) - 1)


def fit_clock(
    t_s: Array,
    features: Array,
    reference_s: Array,
    reference: Array,
    *,
    most_offset_s: float = 20.0,
    most_rate: float = 0.04,
) -> Clock:
    """Fit the clock with which `features` (n, k) at `t_s` (n,) explain `reference` (m,) or (m, channels) best.

    Both times must never decrease; count them from the trial's beginning, since the offset is the one at time 0. Rows
    of the reference with NaN are ignored. Offsets up to `most_offset_s` in the middle of the trial are searched; the
    rate is at most `most_rate`. Raises CalibrationError if the reference is constant or does not follow the taxels.
    """
    columns = reference[:, None] if reference.ndim == 1 else reference
    is_finite = np.isfinite(columns).all(axis=1)
    reference_s, row = np.unique(reference_s[is_finite], return_index=True)
    columns = columns[is_finite][row]
    is_moving = (columns != columns[:1]).any(axis=0)
    if not is_moving.any():
        raise CalibrationError(
            f"the reference has the same value in all of its {len(columns)} readings, expected one that varies: "
            "was it switched on, and is it the right column?"
        )
    columns = columns[:, is_moving]
    pair = _StreamPair(t_s, features, reference_s, columns, most_rate)
    start = pair.search(most_offset_s)
    # Averaged streams converge from farther away, and seldom miss the optimum.
    best, unsmoothed = (
        pair.assess(pair.refine(pair.refine(start, _SMOOTHED_S), 0.0)),
        pair.assess(pair.refine(start, 0.0)),
    )
    if 1.0 - unsmoothed.explained < _BETTER_BY * (1.0 - best.explained):
        best = unsmoothed
    if not best.explained > _MIN_EXPLAINED:
        raise CalibrationError(
            f"the reference does not follow the taxels: at best {max(best.explained, 0.0):.0%} of its edges are "
            f"explained, expected more than {_MIN_EXPLAINED:.0%}, within {most_offset_s:g} s and {most_rate:.1%} of "
            "its times: is it of the same trial and foot, and does it rise and fall within seconds?"
        )
    return best


class _StreamPair:
    """Both streams with a common fit; a clock is (2,) here: its lead in s at the middle of the trial, and its rate."""

    def __init__(self, t_s: Array, features: Array, reference_s: Array, reference: Array, most_rate: float) -> None:
        self._middle_s = float(t_s[0] + t_s[-1]) / 2
        self._most_rate = most_rate
        self._t_s, self._reference_s = t_s, reference_s
        self._features, self._reference = _extract_edges(features, t_s), _extract_edges(reference, reference_s)

    def search(self, most_offset_s: float) -> Array:
        """Return the best clock of the grid; outside its readings the reference is assumed constant."""
        period_s = max(float(np.median(np.diff(self._t_s))), float(np.ptp(self._t_s)) / _MAX_GRID)
        grid_s = np.arange(self._t_s[0], self._t_s[-1], period_s)
        n, most_lag = len(grid_s), int(most_offset_s / period_s)
        basis = np.linalg.qr(_interpolate(grid_s, self._t_s, self._features))[0]
        lags = np.arange(-most_lag, most_lag + 1)
        size = next_fast_len(n + 2 * most_lag, real=True)
        spectrum = np.conj(rfft(basis, size, axis=0))[..., None]
        reach_s = grid_s[0] - self._middle_s + period_s * np.arange(-most_lag, n + most_lag)
        n_rates = int(np.ceil(self._most_rate * np.ptp(self._t_s) / 2 / _RATE_STEP_S))
        best = (np.inf, np.zeros(2))
        for rate in np.linspace(-self._most_rate, self._most_rate, 2 * n_rates + 1):
            times_s = self._middle_s + (1.0 + rate) * reach_s
            r = _interpolate(times_s, self._reference_s, self._reference)
            explained = irfft(spectrum * rfft(r, size, axis=0)[:, None], size, axis=0)[: len(lags)] ** 2
            energy = _sliding_sums(r**2, n)
            flat = _FLAT * energy.mean(axis=0)
            unexplained = ((energy - explained.sum(axis=1) + flat) / (energy + flat)).sum(axis=1)
            lowest = int(unexplained.argmin())
            if unexplained[lowest] < best[0]:
                best = float(unexplained[lowest]), np.array([(1.0 + rate) * lags[lowest] * period_s, rate])
        return best[1]

    def refine(self, clock: Array, smoothed_s: float) -> Array:
        """Return the best clock near `clock`, with streams averaged over `smoothed_s`; 0: not averaged, but
        weighted.
        """
        features = _average(self._features, self._t_s, smoothed_s)
        reference = _average(self._reference, self._reference_s, smoothed_s)
        weight = np.ones(len(features))
        for _ in range(_MAX_STEPS):
            residual, slopes, _ = self._residuals(clock, features, reference, weight)
            root = np.sqrt(weight)[:, None]
            columns, left = (slopes * root[..., None]).reshape(-1, 2), (residual * root).ravel()
            step = np.linalg.lstsq(columns, left, rcond=None)[0]
            if abs(clock[1] - step[1]) > self._most_rate:  # the lead that goes with the largest rate
                step[1] = clock[1] - np.clip(clock[1] - step[1], -self._most_rate, self._most_rate)
                step[:1] = np.linalg.lstsq(columns[:, :1], left - step[1] * columns[:, 1], rcond=None)[0]
            clock = clock - step
            if abs(step[0]) + abs(step[1]) * np.ptp(self._t_s) / 2 < _SMALL_STEP_S:
                break
            if smoothed_s == 0.0:
                weight = tukey_weights(residual)
        return clock

    def assess(self, clock: Array) -> Clock:
        """Return the clock with its standard deviations and the fraction it explains."""
        residual, _, _ = self._residuals(clock, self._features, self._reference, np.ones(len(self._features)))
        weight = tukey_weights(residual)
        residual, slopes, edges = self._residuals(clock, self._features, self._reference, weight)
        n = int(np.clip(np.ptp(self._t_s) / _BLOCK_S, *_BLOCKS))
        blocks = np.linspace(0, len(residual), n + 1).astype(int)[:-1]
        scores = np.add.reduceat(np.einsum("n,nc,nci->ni", weight, residual, slopes), blocks)
        inverse = np.linalg.pinv(np.einsum("n,nci,ncj->ij", weight, slopes, slopes))
        covariance = inverse @ (scores.T @ scores) @ inverse * n / (n - 2)
        to_zero = np.array([1.0, -self._middle_s])  # converts the lead in the middle to the offset at time 0
        return Clock(
            offset_s=float(to_zero @ clock),
            rate=float(clock[1]),
            offset_std_s=float(np.sqrt(to_zero @ covariance @ to_zero)),
            rate_std=float(np.sqrt(covariance[1, 1])),
            explained=float(1.0 - (weight[:, None] * residual**2).sum() / (weight[:, None] * edges**2).sum()),
        )

    def _residuals(self, clock: Array, features: Array, reference: Array, weight: Array) -> tuple[Array, Array, Array]:
        """Return, per sample and channel, (n, c) residual, (n, c, 2) its derivative by the clock, (n, c) reference.

        All are 0 where the reference has no readings.
        """
        since_middle_s = self._t_s - self._middle_s
        times_s = self._t_s + clock[0] + clock[1] * since_middle_s
        is_inside = (times_s >= self._reference_s[0]) & (times_s <= self._reference_s[-1])
        if is_inside.mean() < _MIN_OVERLAP:
            raise CalibrationError(
                f"the reference covers {is_inside.mean():.0%} of the time of the taxels, expected at least "
                f"{_MIN_OVERLAP:.0%}: is it of the same trial, and did it run all the time?"
            )
        smooth = _average(reference, self._reference_s, _SLOPE_S)
        slope = _interpolate(times_s, self._reference_s, np.gradient(smooth, self._reference_s, axis=0))
        shifted = _interpolate(times_s, self._reference_s, reference)
        by_rate = slope * since_middle_s[:, None] * (self._most_rate > 0.0)  # 0 keeps the rate fixed
        targets = np.concatenate([shifted, slope, by_rate], axis=1)
        root = np.sqrt(weight * is_inside)[:, None]
        residual = (targets - features @ np.linalg.lstsq(features * root, targets * root, rcond=None)[0]) * is_inside[
            :, None
        ]
        n = reference.shape[1]
        return (
            residual[:, :n],
            np.stack([residual[:, n : 2 * n], residual[:, 2 * n :]], axis=2),
            shifted * is_inside[:, None],
        )


def _interpolate(at_s: Array, t_s: Array, columns: Array) -> Array:
    """Return (n, c) the columns at the times `at_s`, linear between their own times and constant beyond them."""
    return np.stack([np.interp(at_s, t_s, column) for column in columns.T], axis=1)


def _average(columns: Array, t_s: Array, over_s: float) -> Array:
    size = round(over_s / float(np.ptp(t_s)) * (len(t_s) - 1))
    return uniform_filter1d(columns, size, axis=0, mode="nearest") if size > 1 else columns


def _extract_edges(columns: Array, t_s: Array) -> Array:
    """Return the columns without their slow part, each scaled to an RMS of 1."""
    edges = columns - _average(columns, t_s, _SLOW_S)
    size = np.sqrt((edges**2).mean(axis=0))
    return edges / np.where(size > 0, size, 1.0)


def _sliding_sums(columns: Array, n: int) -> Array:
    """Return (m − n + 1, c) sums of n consecutive rows."""
    sums = np.concatenate([np.zeros_like(columns[:1]), np.cumsum(columns, axis=0)])
    return np.asarray(sums[n:] - sums[:-n])


def tukey_weights(residual: Array, least_std: float = np.finfo(float).tiny) -> Array:
    """Return (n,) weights for residuals (n, c), whose robust standard deviation is at least `least_std`."""
    size = np.abs(residual) / (np.maximum(1.4826 * np.median(np.abs(residual), axis=0), least_std) * TUKEY)
    weight: Array = (1.0 - np.minimum(size.max(axis=1), 1.0) ** 2) ** 2
    return weight
