"""Fit the clock of a reference by the edges of the load, with regressors for memory and drift of the sensor."""

from __future__ import annotations

import numpy as np

from ...calibration import clock as clocks
from ...calibration.clock import Clock
from ...errors import CalibrationError
from ...physics.law import Array
from ..operators import low_pass, plays

MOST_CLOCK_ERROR_S = 0.15  # largest offset of a declared clock that a delay may explain; beyond it the edges are used
MOST_QUARTZ_RATE = 3e-4  # between two quartz clocks
GOOD_FIT = 0.995  # share of the edges explained, from which on no other rate is tried
CLEARLY_LESS = 0.7  # largest ratio of unexplained shares at which another rate is taken
LESS_WITH_RATE = 0.98  # the same for rows without times: with a rate against without
PLAY_RADII = (0.05, 0.15, 0.4)  # as shares of the readings' range
RELAXATION_S = (0.5, 3.0, 20.0)  # time constants
KNOT_SPACING_S = 20.0  # of gain and baseline over time


def fit_own_clock(t_s: Array, reading: Array, reference_s: Array, load: Array, *, memory: bool) -> Clock:
    """Return the clock on which the readings explain the edges of the load best.

    `reading` (n,) in counts at `t_s` (n,) of the recording; `load` (m,) at `reference_s` (m,) of the reference.

    With `memory`, regressors for memory and drift of the sensor are fitted together with its curve, and a rate beyond
    MOST_QUARTZ_RATE is used only if it explains clearly more of the edges. Without, any rate is possible, and there are
    no such regressors: with one rise and one fall of the load they would explain an offset of the clock. Raises
    CalibrationError as `calibration.clock` does.
    """
    x = (reading - reading.mean()) / reading.std()
    features = np.stack([x**0, x, x**2, x**3], axis=1)
    if not memory:
        return _clock_of_row_numbers(t_s, features, reference_s, load)
    features = np.concatenate([features, memory_regressors(t_s, x), _drift_regressors(t_s, x)], axis=1)
    quartz = clocks.fit_clock(t_s, features, reference_s, load, most_rate=MOST_QUARTZ_RATE)
    if abs(quartz.rate) < MOST_QUARTZ_RATE and quartz.explained > GOOD_FIT:
        return quartz
    unbounded = clocks.fit_clock(t_s, features, reference_s, load)
    return unbounded if 1.0 - unbounded.explained < CLEARLY_LESS * (1.0 - quartz.explained) else quartz


def _clock_of_row_numbers(t_s: Array, features: Array, reference_s: Array, load: Array) -> Clock:
    """Return the clock of a reference without times, with rate 0 unless a rate explains more of the edges.

    No quartz bounds such a rate. With a single rise and fall, a rate can stand for hysteresis, because both make one of
    the edges late: noise would then decide its sign.
    """
    with_rate = clocks.fit_clock(t_s, features, reference_s, load)
    try:
        without_rate = clocks.fit_clock(t_s, features, reference_s, load, most_rate=0.0)
    except CalibrationError:  # no offset alone explains the edges
        return with_rate
    return with_rate if 1.0 - with_rate.explained < LESS_WITH_RATE * (1.0 - without_rate.explained) else without_rate


def memory_regressors(t_s: Array, reading: Array) -> Array:
    """Return regressors (n, k) for the memory of a sensor, beside powers of its readings (n,).

    Plays of PLAY_RADII for hysteresis and low passes of RELAXATION_S for creep; strong memory bends edges.
    """
    load = (reading - reading.min())[:, None]
    loops = plays(load, np.array(PLAY_RADII) * float(np.ptp(reading)))[..., 0].T
    step_s = float(np.median(np.diff(t_s)))
    return np.concatenate([loops, *(low_pass(load, step_s, tau) - load for tau in RELAXATION_S)], axis=1)


def _drift_regressors(t_s: Array, reading: Array) -> Array:
    """Return regressors (n, k) for slow changes of baseline and gain, linear between knots KNOT_SPACING_S apart."""
    n_knots = max(round(float(np.ptp(t_s)) / KNOT_SPACING_S), 1) + 1
    knots = np.linspace(t_s[0], t_s[-1], n_knots)
    basis = np.stack([np.interp(t_s, knots, unit) for unit in np.eye(n_knots)[1:]], axis=1)
    return np.concatenate([basis, basis * reading[:, None]], axis=1)
