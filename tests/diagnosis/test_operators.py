"""Operators on whole signals, compared with the equations that they solve."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.operators import AT_ONCE, flows, frictions, held, low_pass, polynomial

WAYS_PA = np.cumsum([0.0, 80e3, -30e3, 10e3, 90e3, -150e3, 5e3])
FINE = 20_000


@pytest.mark.parametrize(("up_pa", "down_pa"), [(5e3, 5e3), (60e3, 20e3), (100e3, 400e3)])
def test_friction_solves_dahls_equation(up_pa, down_pa):
    """Against small steps of dz = (1 − sgn(dx)·z/L)·L/s·dx, L = s_u + s_d."""
    (friction,) = frictions(WAYS_PA[:, None], np.array([up_pa]), np.array([down_pa]))
    limit, z, expected = up_pa + down_pa, 0.0, [0.0]
    for way in np.diff(WAYS_PA):
        for _ in range(FINE):
            z += (1.0 - np.sign(way) * z / limit) * limit / (up_pa if way > 0.0 else down_pa) * way / FINE
        expected.append(z)
    np.testing.assert_allclose(friction[:, 0], expected, atol=1e-3 * limit)
    assert np.abs(friction).max() <= limit


def test_noise_within_the_radius_does_not_turn_a_held_signal_and_a_ramp_is_not_late():
    rng = np.random.default_rng(1)
    x = np.concatenate([np.zeros(100), np.linspace(0.0, 50.0, 200), np.full(300, 50.0), np.linspace(50.0, 20.0, 150)])
    noisy = x + rng.uniform(-0.5, 0.5, len(x))
    (still,) = held(noisy[:, None], np.array([0.6])).T
    assert np.ptp(still[320:580]) < 0.05
    assert np.ptp(noisy[320:580]) > 0.9
    np.testing.assert_allclose(still[110:290], noisy[110:290], atol=0.6)
    assert abs(np.mean(still[110:290] - x[110:290])) < 0.05


@pytest.mark.parametrize("scale_pa", [15e3, 40e3, 1e9])
def test_activated_flow_solves_eyrings_equation(scale_pa):
    """Against small steps of τ·dz/dt = s·sinh((x − z)/s)."""
    step_s, tau_s, fine = 0.5, 40.0, 20_000
    late = flows(WAYS_PA[:, None], np.array([tau_s]), np.array([scale_pa]), step_s)[0, :, 0]
    z, expected = WAYS_PA[0], [WAYS_PA[0]]
    for x in WAYS_PA[1:]:
        for _ in range(fine):
            z += step_s / fine / tau_s * scale_pa * np.sinh((x - z) / scale_pa)
        expected.append(z)
    np.testing.assert_allclose(WAYS_PA - late, expected, atol=1e-3 * np.ptp(WAYS_PA))


def test_activated_flow_at_a_large_scale_is_a_first_order_lag():
    x = np.repeat(WAYS_PA, 40)[:, None]
    late = flows(x, np.array([1.5]), np.array([1e9]), 0.02)[0]
    np.testing.assert_allclose(x - late, low_pass(x, 0.02, 1.5), atol=0.01 * np.ptp(WAYS_PA))


def test_the_inverse_of_activated_flow_is_a_flow():
    """Creep q = P − a·(P − z) is undone by P = q + a/(1 − a)·(q − z), with z from q, (1 − a)·τ and (1 − a)·s."""
    a, tau_s, scale_pa, step_s = 0.4, 8.0, 20e3, 0.01
    load_pa = 150e3 * np.sin(0.4 * np.arange(0.0, 60.0, step_s)[:, None]) ** 2
    read_pa = load_pa - a * flows(load_pa, np.array([tau_s]), np.array([scale_pa]), step_s)[0]
    late_pa = flows(read_pa, (1 - a) * np.array([tau_s]), (1 - a) * np.array([scale_pa]), step_s)[0]
    assert np.abs(load_pa - read_pa).max() > 25e3
    np.testing.assert_allclose(read_pa + a / (1 - a) * late_pa, load_pa, atol=200.0)


def test_polynomials_of_every_taxel_have_numpys_values():
    rng = np.random.default_rng(2)
    x, coefficients = rng.normal(size=(2 * AT_ONCE + 5, 3, 4)), rng.normal(size=(6, 3, 4))
    expected = np.polynomial.polynomial.polyval(x, coefficients, tensor=False)
    np.testing.assert_array_equal(polynomial(x, coefficients), expected)
