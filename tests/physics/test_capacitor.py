"""The paper's model of a taxel is compared with its equations, step by step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.physics.capacitor import EPSILON_0, Capacitor

A, D0, K, EPSILON_R = 19e-6, 3e-3, 6000.0, 1.5
TAXEL = Capacitor(A, D0, K, EPSILON_R)

pressures = st.floats(0, 3.4e5)
counts = st.floats(1e-17, 1e-13)


@settings(max_examples=50)
@given(pressures, counts)
def test_capacitance_follows_the_plate_distance(pressure: float, farad_per_count: float) -> None:
    d = D0 - A * pressure / K  # Hooke, with F = A·P
    change = EPSILON_R * EPSILON_0 * A / d - EPSILON_R * EPSILON_0 * A / D0
    change_f = TAXEL.activation_count(np.array(pressure), farad_per_count) * farad_per_count
    assert change_f == pytest.approx(change, rel=1e-9, abs=1e-25)


@settings(max_examples=50)
@given(pressures, counts)
def test_pressure_equals_the_papers_last_equation(pressure: float, farad_per_count: float) -> None:
    change = TAXEL.activation_count(np.array(pressure), farad_per_count)  # C_d0 − C_d
    last = D0 * K / A - EPSILON_R * EPSILON_0 * K / (farad_per_count * change + A * EPSILON_R * EPSILON_0 / D0)
    assert last == pytest.approx(pressure, abs=1e-6 * 3.4e5)
    assert TAXEL.pressure_pa(change, farad_per_count) == pytest.approx(pressure, abs=1e-9 * 3.4e5)


@settings(max_examples=50)
@given(pressures)
def test_pressure_is_linear_in_the_inverse_of_the_capacitance(pressure: float) -> None:
    rest = TAXEL.rest_f()
    c = rest + TAXEL.activation_count(np.array(pressure), 1.0)
    assert -K * EPSILON_R * EPSILON_0 * (1 / c - 1 / rest) == pytest.approx(pressure, abs=1e-6 * 3.4e5)


def test_plates_never_touch() -> None:
    assert np.isfinite(TAXEL.activation_count(np.array(1e9), 1e-15))


def test_taxels_may_differ_in_their_constants() -> None:
    several = Capacitor(A, np.array([2e-3, 3e-3]), np.array([5e3, 6e3]), EPSILON_R)
    load = np.full((4, 2), 1e5)
    counts = several.activation_count(load, 1e-15)
    np.testing.assert_allclose(several.pressure_pa(counts, 1e-15), load, rtol=1e-12)
    assert counts[0, 1] == TAXEL.activation_count(np.array(1e5), 1e-15)
