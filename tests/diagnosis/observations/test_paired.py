"""The shortest lag that a simulation beside a recording shows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.paired import PairedObservation
from insole_daemon.diagnosis.operators import low_pass

STEP_S = 0.001


def width_s(kernel: np.ndarray) -> float:
    """Return the standard deviation of a kernel, s."""
    at_s = STEP_S * np.arange(len(kernel))
    mean_s = np.average(at_s, weights=kernel)
    return float(np.sqrt(np.average((at_s - mean_s) ** 2, weights=kernel)))


def test_the_shortest_lag_blurs_as_much_as_interpolation_between_the_slower_readings():
    periods: Any = SimpleNamespace(period_s=np.array([0.05, np.nan, 0.05]), field=SimpleNamespace(period_s=0.02))
    least_lag_s = PairedObservation.least_lag_s.fget(periods)  # type: ignore[attr-defined]
    impulse = np.zeros((1000, 1))
    impulse[1] = 1.0
    lag = low_pass(impulse, STEP_S, least_lag_s)[:, 0]
    at_s = STEP_S * np.arange(101)
    interpolation = np.interp(at_s, [0.0, 0.05, 0.1], [0.0, 1.0, 0.0])
    assert width_s(lag) == pytest.approx(width_s(interpolation), rel=0.02)
