"""The paper's taxel against its own equations, step by step, and mixtures against their limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.physics.capacitor import EPSILON_0, Capacitor

A, D0, K, EPSILON_R = 19e-6, 3e-3, 6000.0, 1.5
PLAIN = Capacitor(A, D0, K, EPSILON_R)
MIXED = Capacitor(A, D0, K, 1.0, solid_permittivity=2.5, solid_share=0.3)

pressures = st.floats(0, 3.4e5)


@settings(max_examples=50)
@given(pressures)
def test_capacitance_of_a_plate_that_has_moved(pressure: float) -> None:
    d = D0 - A * pressure / K  # Hooke, with F = A·P
    assert PLAIN.capacitance_f(np.array(pressure)) == pytest.approx(EPSILON_R * EPSILON_0 * A / d, rel=1e-12)


@settings(max_examples=50)
@given(pressures, st.floats(1e-17, 1e-13))
def test_the_papers_last_equation(pressure: float, farad_per_count: float) -> None:
    change = PLAIN.activation_count(np.array(pressure), farad_per_count)  # C_d0 − C_d
    last = D0 * K / A - EPSILON_R * EPSILON_0 * K / (farad_per_count * change + A * EPSILON_R * EPSILON_0 / D0)
    assert last == pytest.approx(pressure, abs=1e-6 * 3.4e5)
    assert PLAIN.pressure_of_activation_pa(change, farad_per_count) == pytest.approx(pressure, abs=1e-6 * 3.4e5)


@settings(max_examples=50)
@given(pressures)
def test_pressure_is_linear_in_the_inverse_of_the_capacitance(pressure: float) -> None:
    c, rest = PLAIN.capacitance_f(np.array(pressure)), PLAIN.capacitance_f(np.array(0.0))
    assert -K * EPSILON_R * EPSILON_0 * (1 / c - 1 / rest) == pytest.approx(pressure, abs=1e-6 * 3.4e5)


@settings(max_examples=50)
@given(pressures)
def test_a_mixture_back_from_its_capacitance(pressure: float) -> None:
    s = pressure * A / (K * D0)
    relative = 1.0 + 1.5 * 0.3 / (1 - s)
    capacitance = MIXED.capacitance_f(np.array(pressure))
    assert capacitance == pytest.approx(relative * EPSILON_0 * A / (D0 * (1 - s)), rel=1e-12)
    assert MIXED.pressure_pa(capacitance) == pytest.approx(pressure, abs=1e-9 * 3.4e5)


def test_with_all_the_gas_out_it_is_solid_and_no_further() -> None:
    far = MIXED.capacitance_f(np.array([1e7, 2e7]))
    assert far == pytest.approx(2.5 * EPSILON_0 * A / (D0 * 0.3), rel=1e-9)
    assert np.isfinite(PLAIN.capacitance_f(np.array(1e9)))


def test_taxels_of_several_builds() -> None:
    several = Capacitor(A, np.array([2e-3, 3e-3]), np.array([5e3, 6e3]), EPSILON_R)
    load = np.full((4, 2), 1e5)
    np.testing.assert_allclose(several.pressure_pa(several.capacitance_f(load)), load, rtol=1e-12)
    assert several.capacitance_f(load)[0, 1] == PLAIN.capacitance_f(np.array(1e5))
