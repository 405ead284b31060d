"""Where in the load an effect does its work, and when."""

from __future__ import annotations

import numpy as np

from insole_daemon.diagnosis.regimes import Gain, regime, when

from .chamber import load


def gain(there) -> Gain:
    """Rows of the tests' load, with squares where `there(t, load, rate)` says so."""
    t_s, load_pa = (each[::10] for each in load())
    rate = np.gradient(load_pa, t_s)
    square = there(t_s, load_pa, rate).astype(float) + np.random.default_rng(1).normal(0.0, 0.05, len(t_s))
    return Gain(square, load_pa, rate, t_s, np.zeros(len(t_s), np.intp))


def test_a_range_of_loads_and_a_phase():
    found = regime(gain(lambda t_s, p, rate: 5.0 * ((p > 90e3) & (p < 180e3) & (rate < -1e3))))
    low, high = found["pressure_pa"]
    assert 60e3 <= low <= 120e3 <= 150e3 <= high <= 210e3
    assert found["phase"] == "unloading"
    assert found["rate_pa_s"][0] > 1e3


def test_what_is_there_everywhere_has_no_phase():
    found = regime(gain(lambda t_s, p, rate: 3.0 * (np.abs(rate) > 1e3)))
    assert "phase" not in found
    assert found["pressure_pa"][1] - found["pressure_pa"][0] > 150e3


def test_what_explains_nothing_has_no_regime():
    assert regime(gain(lambda t_s, p, rate: np.full(len(t_s), -1.0))) == {}


def test_from_a_moment_on():
    ((begins, ends),) = when(gain(lambda t_s, p, rate: 5.0 * (t_s > 55.0)), 0)
    assert 50.0 <= begins <= 60.0
    assert ends > 85.0


def test_all_the_time():
    assert when(gain(lambda t_s, p, rate: 5.0 * (p > 30e3)), 0) == ()
