"""The clock of a reference of its own, by the edges of the load, with memory and warmth beside them."""

from __future__ import annotations

import numpy as np

from ...calibration import clock as clocks
from ...calibration.clock import Clock
from ...errors import CalibrationError
from ...physics.law import Array
from ..operators import low_pass, plays

FAR_S = 0.15  # that a declared clock is off by: more is no delay, and is found by the edges
USUAL_RATE = 3e-4
SURE = 0.995  # of the edges explained: there is nothing to look for
SHARPER = 0.7  # of what is left unexplained, that another rate may leave at the most
WITH_RATE = 0.98  # the same of rows without times, with any rate against none
PLAYS = (0.05, 0.15, 0.4)  # of the readings' range
RELAX_S = (0.5, 3.0, 20.0)
SLOW_S = 20.0


def fit_own_clock(t_s: Array, reading: Array, reference_s: Array, load: Array, *, memory: bool) -> Clock:
    """Offset and rate under which readings (n,) at `t_s` explain the edges of `load` (m,) at `reference_s`.

    With `memory`, what a sensor with memory and warmth may add to its curve is fitted beside it, and a rate that no
    two quartzes have is taken only where it explains clearly more of the edges. Without, any rate is possible, and
    memory beside the curve would take an offset's place where there is one rise and one fall. CalibrationError as
    `calibration.clock` raises it.
    """
    x = (reading - reading.mean()) / reading.std()
    features = np.stack([x**0, x, x**2, x**3], axis=1)
    if not memory:
        return _of_rows(t_s, features, reference_s, load)
    features = np.concatenate([features, late_parts(t_s, x), _slow(t_s, x)], axis=1)
    usual = clocks.fit_clock(t_s, features, reference_s, load, most_rate=USUAL_RATE)
    if abs(usual.rate) < USUAL_RATE and usual.explained > SURE:
        return usual
    wide = clocks.fit_clock(t_s, features, reference_s, load)
    return wide if 1.0 - wide.explained < SHARPER * (1.0 - usual.explained) else usual


def _of_rows(t_s: Array, features: Array, reference_s: Array, load: Array) -> Clock:
    """Of rows without times: any rate, for no quartz is behind it, but none unless it explains more of the edges.

    One rise and one fall are written as well with a rate that makes one of them late, as hysteresis does: then noise
    would choose between a rate and its opposite.
    """
    free = clocks.fit_clock(t_s, features, reference_s, load)
    try:
        held = clocks.fit_clock(t_s, features, reference_s, load, most_rate=0.0)
    except CalibrationError:  # without a rate it explains nothing
        return free
    return free if 1.0 - free.explained < WITH_RATE * (1.0 - held.explained) else held


def late_parts(t_s: Array, x: Array) -> Array:
    """(n, k) what a sensor with memory may say beside powers of the readings `x` (n,): a strong one bends edges."""
    above = (x - x.min())[:, None]
    loops = plays(above, np.array(PLAYS) * float(np.ptp(x)))[..., 0].T
    step_s = float(np.median(np.diff(t_s)))
    return np.concatenate([loops, *(low_pass(above, step_s, tau) - above for tau in RELAX_S)], axis=1)


def _slow(t_s: Array, x: Array) -> Array:
    """(n, k) what warmth and drift may do to the readings `x` (n,): their rest and their gain change within SLOW_S."""
    n = max(round(float(np.ptp(t_s)) / SLOW_S), 1) + 1
    knots = np.linspace(t_s[0], t_s[-1], n)
    hats = np.stack([np.interp(t_s, knots, hat) for hat in np.eye(n)[1:]], axis=1)
    return np.concatenate([hats, hats * x[:, None]], axis=1)
