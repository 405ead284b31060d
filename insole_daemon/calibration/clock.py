"""Offset and rate between the clocks of the taxels and of a reference, fitted together with what links the two.

    t_reference = offset_s + (1 + rate)·t_can                                         (the law `clock`)

Where the clocks agree, the reference is a combination of what the taxels say:

    r(offset + (1 + rate)·t_n) = Σ_k β_k·x_kn + e_n

with `features` x: powers of the taxels' mean activation for a chamber, the wrench of a calibration for a shoe. Of both
only the edges are compared, what differs from the mean of the seconds around it: creep, hysteresis, drift and a wrong
curve would else pass for a late clock, by half a second in the published chamber. A delay of all taxels, and a memory
shorter than the edges, cannot be told from an offset.

For given clocks β is a linear problem, which leaves two unknowns. They are looked for on a grid, every offset of a rate
at once by a Fourier transform, and refined by Gauss–Newton steps, each a linear problem in β and both unknowns; the
last ones with Tukey's weights, so that spikes do not pull.

Sources: separable least squares, Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973) 413–432; weights, Beaton & Tukey,
Technometrics 16 (1974) 147–185; standard deviations by sums over blocks, since what is left is not white,
Liang & Zeger, Biometrika 73 (1986) 13–22.
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

_MOST_GRID = 1 << 14  # samples that are searched
_RATE_STEP_S = 0.25  # that two rates of the grid lie apart at the trial's ends, counted from its middle
_SLOW_S = 8.0  # what changes over more than this is no edge
_SLOPE_S = 0.2  # that slopes are taken over: the difference of two readings is mostly noise
_FLAT = 0.01  # of the reference's variance, added to it: a stretch in which it rests fits everything
_SMOOTHED_S = 0.5
_CLEARER = 0.5  # of what one way leaves unexplained, that the other may
_MOST_STEPS = 20  # Gauss–Newton: it ends by itself after three to six
_SMALL_STEP_S = 1e-5
_TUKEY = 4.685  # robust standard deviations beyond which a sample counts nothing: 95 % efficient if all are good
_BLOCK_S, _BLOCKS = 20.0, (6, 30)  # longer than what is left over remembers; at least and at most as many
_LEAST_OVERLAP = 0.5  # of the taxels' samples: less may agree by chance
_LEAST_EXPLAINED = 0.25  # of the variance of the reference's edges; anything at all explains up to 0.2


@dataclass(frozen=True, slots=True)
class Clock:
    """What the reference's clock says, against that of the taxels."""

    offset_s: float  # what it says when the taxels' says 0
    rate: float
    offset_std_s: float  # of what the fit leaves; what delays all taxels alike is not in it
    rate_std: float
    explained: float  # by the taxels: share of the variance of the reference's edges, 1 where nothing is left

    def reference_s(self, t_s: Array) -> Array:
        """(n,) what it says when the taxels' says `t_s`."""
        return self.offset_s + (1.0 + self.rate) * t_s


def row_times_s(t_s: Array, rows: int) -> Array:
    """(rows,) times of a reference that has none: as if each row were read with the cycle of that number.

    The cycles' mean period goes on where they end; offset and rate found with these are against pairing row by row.
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
    """The clock under which `features` (n, k) at `t_s` (n,) explain `reference` (m,) or (m, channels) best.

    Both times never decrease; count them from the trial's beginning, for the offset is that at 0. Rows of the
    reference with NaN are left out. A clock further off than `most_offset_s` in the trial's middle, or `most_rate`,
    is not looked for; with `most_rate` 0 the rate is held at 0. CalibrationError where the reference does not move, or
    follows nothing that the taxels say.
    """
    given = reference[:, None] if reference.ndim == 1 else reference
    there = np.isfinite(given).all(axis=1)
    reference_s, first = np.unique(reference_s[there], return_index=True)
    given = given[there][first]
    moves = (given != given[:1]).any(axis=0)
    if not moves.any():
        raise CalibrationError(
            f"the reference says the same in all of its {len(given)} readings, expected one that moves: "
            "was it switched on, and is it the right column?"
        )
    given = given[:, moves]
    pair = _Pair(t_s, features, reference_s, given, has_rate=most_rate > 0)
    at = pair.search(most_offset_s, most_rate)
    # Averaged streams lead there from further away, and seldom past it.
    found, near = pair.judged(pair.refined(pair.refined(at, _SMOOTHED_S), 0.0)), pair.judged(pair.refined(at, 0.0))
    if 1.0 - near.explained < _CLEARER * (1.0 - found.explained):
        found = near
    if not found.explained > _LEAST_EXPLAINED:
        raise CalibrationError(
            f"the reference does not follow the taxels: at best {max(found.explained, 0.0):.0%} of its edges are "
            f"explained, expected more than {_LEAST_EXPLAINED:.0%}, within {most_offset_s:g} s and {most_rate:.1%} of "
            "its times: is it of the same trial and foot, and does it rise and fall within seconds?"
        )
    return found


class _Pair:
    """Both streams. A clock is (2,) here: its lead in s in the middle of the trial, and its rate."""

    def __init__(self, t_s: Array, features: Array, reference_s: Array, reference: Array, has_rate: bool) -> None:
        self._middle_s = float(t_s[0] + t_s[-1]) / 2
        self._has_rate = has_rate
        self._t_s, self._reference_s = t_s, reference_s
        self._features, self._reference = _edges(features, t_s), _edges(reference, reference_s)

    def search(self, most_offset_s: float, most_rate: float) -> Array:
        """The best clock of the grid; before and after its readings the reference is taken to have rested."""
        period_s = max(float(np.median(np.diff(self._t_s))), float(np.ptp(self._t_s)) / _MOST_GRID)
        grid_s = np.arange(self._t_s[0], self._t_s[-1], period_s)
        n, most_lag = len(grid_s), int(most_offset_s / period_s)
        basis = np.linalg.qr(_at(grid_s, self._t_s, self._features))[0]
        lags = np.arange(-most_lag, most_lag + 1)
        size = next_fast_len(n + 2 * most_lag, real=True)
        spectrum = np.conj(rfft(basis, size, axis=0))[..., None]
        reach_s = grid_s[0] - self._middle_s + period_s * np.arange(-most_lag, n + most_lag)
        n_rates = int(np.ceil(most_rate * np.ptp(self._t_s) / 2 / _RATE_STEP_S))
        best = (np.inf, np.zeros(2))
        for rate in np.linspace(-most_rate, most_rate, 2 * n_rates + 1):
            wanted_s = self._middle_s + (1.0 + rate) * reach_s
            r = _at(wanted_s, self._reference_s, self._reference)
            explained = irfft(spectrum * rfft(r, size, axis=0)[:, None], size, axis=0)[: len(lags)] ** 2
            edges = _sliding(r**2, n)
            flat = _FLAT * edges.mean(axis=0)
            left = ((edges - explained.sum(axis=1) + flat) / (edges + flat)).sum(axis=1)
            at = int(left.argmin())
            if left[at] < best[0]:
                best = float(left[at]), np.array([(1.0 + rate) * lags[at] * period_s, rate])
        return best[1]

    def refined(self, at: Array, smoothed_s: float) -> Array:
        """The clock near `at` that leaves the least, both streams averaged over `smoothed_s`; 0: less outliers."""
        features = _averaged(self._features, self._t_s, smoothed_s)
        reference = _averaged(self._reference, self._reference_s, smoothed_s)
        weight = np.ones(len(features))
        for _ in range(_MOST_STEPS):
            left, slopes, _ = self._left(at, features, reference, weight)
            root = np.sqrt(weight)[:, None]
            step = np.linalg.lstsq((slopes * root[..., None]).reshape(-1, 2), (left * root).ravel(), rcond=None)[0]
            at = at - step
            if abs(step[0]) + abs(step[1]) * np.ptp(self._t_s) / 2 < _SMALL_STEP_S:
                break
            if smoothed_s == 0.0:
                weight = tukey_weights(left)
        return at

    def judged(self, at: Array) -> Clock:
        """The clock `at`, with how well it is known and how much it explains."""
        left, _, _ = self._left(at, self._features, self._reference, np.ones(len(self._features)))
        weight = tukey_weights(left)
        left, slopes, edges = self._left(at, self._features, self._reference, weight)
        n = int(np.clip(np.ptp(self._t_s) / _BLOCK_S, *_BLOCKS))
        blocks = np.linspace(0, len(left), n + 1).astype(int)[:-1]
        scores = np.add.reduceat(np.einsum("n,nc,nci->ni", weight, left, slopes), blocks)
        inverse = np.linalg.pinv(np.einsum("n,nci,ncj->ij", weight, slopes, slopes))
        covariance = inverse @ (scores.T @ scores) @ inverse * n / (n - 2)
        to_zero = np.array([1.0, -self._middle_s])  # the offset at 0 is that in the middle less the rate's share
        return Clock(
            offset_s=float(to_zero @ at),
            rate=float(at[1]),
            offset_std_s=float(np.sqrt(to_zero @ covariance @ to_zero)),
            rate_std=float(np.sqrt(covariance[1, 1])),
            explained=float(1.0 - (weight[:, None] * left**2).sum() / (weight[:, None] * edges**2).sum()),
        )

    def _left(self, at: Array, features: Array, reference: Array, weight: Array) -> tuple[Array, Array, Array]:
        """Per sample and channel under the clock `at`: (n, c) what is left, (n, c, 2) how that changes with the clock,
        (n, c) what the reference says. Zero where the reference says nothing.
        """
        since_middle_s = self._t_s - self._middle_s
        wanted_s = self._t_s + at[0] + at[1] * since_middle_s
        inside = (wanted_s >= self._reference_s[0]) & (wanted_s <= self._reference_s[-1])
        if inside.mean() < _LEAST_OVERLAP:
            raise CalibrationError(
                f"the reference covers {inside.mean():.0%} of the time of the taxels, expected at least "
                f"{_LEAST_OVERLAP:.0%}: is it of the same trial, and did it run all the time?"
            )
        smooth = _averaged(reference, self._reference_s, _SLOPE_S)
        slope = _at(wanted_s, self._reference_s, np.gradient(smooth, self._reference_s, axis=0))
        said = _at(wanted_s, self._reference_s, reference)
        by_rate = slope * since_middle_s[:, None] * self._has_rate  # 0: least squares take no step in it
        whole = np.concatenate([said, slope, by_rate], axis=1)
        root = np.sqrt(weight * inside)[:, None]
        left = (whole - features @ np.linalg.lstsq(features * root, whole * root, rcond=None)[0]) * inside[:, None]
        n = reference.shape[1]
        return left[:, :n], np.stack([left[:, n : 2 * n], left[:, 2 * n :]], axis=2), said * inside[:, None]


def _at(wanted_s: Array, t_s: Array, columns: Array) -> Array:
    """(n, c) the columns at other times, linear between theirs and at rest beyond them."""
    return np.stack([np.interp(wanted_s, t_s, column) for column in columns.T], axis=1)


def _averaged(columns: Array, t_s: Array, over_s: float) -> Array:
    size = round(over_s / float(np.ptp(t_s)) * (len(t_s) - 1))
    return uniform_filter1d(columns, size, axis=0, mode="nearest") if size > 1 else columns


def _edges(columns: Array, t_s: Array) -> Array:
    """The columns less their slow part, each scaled to a size of 1."""
    edges = columns - _averaged(columns, t_s, _SLOW_S)
    size = np.sqrt((edges**2).mean(axis=0))
    return edges / np.where(size > 0, size, 1.0)


def _sliding(columns: Array, n: int) -> Array:
    """(m − n + 1, c) sums of n consecutive rows."""
    sums = np.concatenate([np.zeros_like(columns[:1]), np.cumsum(columns, axis=0)])
    return np.asarray(sums[n:] - sums[:-n])


def tukey_weights(left: Array, least_std: float = np.finfo(float).tiny) -> Array:
    """(n,) weights of samples with these residuals (n, c), whose robust standard deviation is `least_std` or more."""
    size = np.abs(left) / (np.maximum(1.4826 * np.median(np.abs(left), axis=0), least_std) * _TUKEY)
    weight: Array = (1.0 - np.minimum(size.max(axis=1), 1.0) ** 2) ** 2
    return weight
