"""Lag, viscoelasticity and creep are compared with scipy's solver, closed forms, and their inverses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.physics.effects import laws
from insole_daemon.physics.effects.creep import log_spaced_s
from insole_daemon.physics.effects.power_creep import SPAN_S, kernel
from insole_daemon.skin.layout import builtin

Array = NDArray[np.float64]

LAYOUT = builtin("left", (5, 6, 7))
FULL_SCALE_PA = 3.4e5


def times(rng: np.random.Generator, n: int, shortest_s: float = 0.001, longest_s: float = 0.06) -> Array:
    """Return (n,) times at irregular intervals."""
    return np.cumsum(rng.uniform(shortest_s, longest_s, n))


def loads(rng: np.random.Generator, n: int) -> Array:
    """Return (n, 28, 12) Pa, rough from sample to sample, with holds."""
    load = rng.uniform(0, FULL_SCALE_PA, (n, 28, 12))
    load[n // 3 : n // 2] = load[n // 3]
    return load


def solved(t_s: Array, load: Array, tau_s: Array) -> Array:
    """Return (n, k, m) z of τ·z' = P − z for P (n, m) linear between samples, z(0) = P(0), τ (k, m); by DOP853."""
    k, m = tau_s.shape
    z = np.empty((len(t_s), k, m))
    z[0] = load[0]
    for i in range(1, len(t_s)):
        begin, end = t_s[i - 1 : i + 1]
        slope = (load[i] - load[i - 1]) / (end - begin)

        def rate(t: float, state: Array, i: int = i, begin: float = begin, slope: Array = slope) -> Array:
            return ((load[i - 1] + slope * (t - begin) - state.reshape(k, m)) / tau_s).ravel()

        solution = solve_ivp(rate, (begin, end), z[i - 1].ravel(), "DOP853", rtol=1e-11, atol=1e-11 * FULL_SCALE_PA)
        z[i] = solution.y[:, -1].reshape(k, m)
    return z


def through(effects: list[Effect], load: Array, t_s: Array) -> Array:
    return Chain(effects, LAYOUT).forward()(load, t_s)


def back(effects: list[Effect], q: Array, t_s: Array) -> Array:
    return Chain(effects, LAYOUT).inverse()(q, t_s)


RNG = np.random.default_rng(3)
TAXELS = Where("taxel", tuple((5, 0, i) for i in range(12)))
PER_TAXEL_A, PER_TAXEL_TAU = RNG.uniform(0.02, 0.4, 12), np.geomspace(0.005, 3.0, 12)
CREEP_A, CREEP_TAU = [0.03, 0.05, 0.02, 0.04], [0.02, 0.5, 7.0, 300.0]


@pytest.mark.parametrize(
    ("made", "a", "tau_s"),
    [
        (effect("lag", TAXELS, tau_s=PER_TAXEL_TAU), np.ones((1, 12)), PER_TAXEL_TAU[None]),
        (effect("viscoelasticity", TAXELS, a=PER_TAXEL_A, tau_s=PER_TAXEL_TAU), PER_TAXEL_A[None], PER_TAXEL_TAU[None]),
        (effect("creep", TAXELS, a=CREEP_A, tau_s=CREEP_TAU), np.array(CREEP_A)[:, None], np.array(CREEP_TAU)[:, None]),
        (
            effect("creep", TAXELS, a=np.outer([1.0, 0.5], PER_TAXEL_A), tau_s=np.outer([1.0, 20.0], PER_TAXEL_TAU)),
            np.outer([1.0, 0.5], PER_TAXEL_A),
            np.outer([1.0, 20.0], PER_TAXEL_TAU),
        ),
    ],
    ids=["lag", "viscoelasticity", "creep", "creep per taxel"],
)
def test_operators_equal_an_ode_solver(made: Effect, a: Array, tau_s: Array) -> None:
    rng = np.random.default_rng(0)
    t_s, load = times(rng, 80), loads(rng, 80)
    row = LAYOUT.rows[5, 0]
    output = through([made], load, t_s)
    z = solved(t_s, load[:, row], np.broadcast_to(tau_s, (len(tau_s), 12)))
    expected = (1 - a.sum(axis=0)) * load[:, row] + (a * z).sum(axis=1)
    np.testing.assert_allclose(output[:, row], expected, rtol=0, atol=1e-8 * FULL_SCALE_PA)
    others = np.arange(28) != row
    assert (output[:, others] == load[:, others]).all(), "only where it is at work"


def test_ramp_and_hold_equal_the_closed_form() -> None:
    # τ·q' = s·t − q from 0: q = s·(t − τ·(1 − exp(−t/τ))); then q → P with exp(−t/τ).
    tau_s, slope = 0.04, 1e5
    t_s = np.array([0.0, 0.013, 0.1, 0.35, 0.4, 1.0])
    load = np.tile(np.minimum(t_s, 0.35)[:, None, None] * slope, (1, 28, 12))
    expected = slope * (t_s - tau_s * (1 - np.exp(-t_s / tau_s)))
    at_end = expected[3]
    expected[4:] = load[4:, 0, 0] + (at_end - slope * 0.35) * np.exp(-(t_s[4:] - 0.35) / tau_s)
    np.testing.assert_allclose(through([effect("lag", tau_s=tau_s)], load, t_s)[:, 3, 4], expected, rtol=1e-12)


def test_the_sampling_rate_does_not_matter_for_a_piecewise_linear_load() -> None:
    coarse_s = np.linspace(0, 4, 21)
    fine_s = np.linspace(0, 4, 401)
    load = np.tile((1e5 * np.abs(np.sin(7 * coarse_s)))[:, None, None], (1, 28, 12))
    same = np.tile(np.interp(fine_s, coarse_s, load[:, 0, 0])[:, None, None], (1, 28, 12))
    for made in (
        effect("lag", tau_s=0.03),
        effect("viscoelasticity", a=0.2, tau_s=0.4),
        effect("creep", a=[0.1, 0.05], tau_s=[0.3, 30]),
    ):
        np.testing.assert_allclose(
            through([made], same, fine_s)[::20], through([made], load, coarse_s), rtol=0, atol=1e-8
        )


INVERTIBLE: list[Callable[[np.random.Generator], Effect]] = [
    lambda rng: effect("lag", tau_s=10 ** rng.uniform(-2.5, 0)),
    lambda rng: effect("viscoelasticity", a=rng.uniform(0, 0.95), tau_s=10 ** rng.uniform(-4, 3)),
    lambda rng: effect("creep", a=rng.dirichlet(np.ones(6)) * 0.9, tau_s=10 ** rng.uniform(-4, 4, 6)),
    lambda rng: effect(
        "power_creep", a=rng.uniform(0, 0.95), exponent=rng.uniform(0.01, 0.9), t0_s=10 ** rng.uniform(-2, 4)
    ),
]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(range(4)))
def test_the_inverse_is_exact(seed: int, which: int) -> None:
    rng = np.random.default_rng(seed)
    made = INVERTIBLE[which](rng)
    t_s, load = times(rng, 150), loads(rng, 150)
    inverted = back([made], through([made], load, t_s), t_s)
    np.testing.assert_allclose(inverted, load, rtol=0, atol=1e-9 * FULL_SCALE_PA)


def test_the_inverse_of_a_lag_amplifies_noise_as_documented() -> None:
    noise = np.random.default_rng(0).normal(0, 1, (3000, 28, 12))
    for tau_s, gain in ((0.02, 5), (0.04, 14)):
        assert f"{gain} times" in laws()["lag"].inverse_is
        inverted = back([effect("lag", tau_s=tau_s)], noise, np.arange(3000) * 0.02)
        assert inverted[100:].std() == pytest.approx(gain, rel=0.03)


def test_two_samples_at_one_time_are_accepted() -> None:
    t_s = np.array([0.0, 0.02, 0.02, 0.04])
    load = np.tile(np.array([0.0, 1e5, 2e5, 2e5])[:, None, None], (1, 28, 12))
    for made, leap in ((effect("lag", tau_s=0.02), 0.0), (effect("viscoelasticity", a=0.25, tau_s=0.1), 0.75e5)):
        q = through([made], load, t_s)
        assert q[2, 0, 0] - q[1, 0, 0] == pytest.approx(leap, abs=1e-6), "what takes time has had none"
        assert np.isfinite(back([made], q, t_s)).all()
    solid = [effect("viscoelasticity", a=0.25, tau_s=0.1)]
    np.testing.assert_allclose(back(solid, through(solid, load, t_s), t_s), load, atol=1e-6)


def test_a_settled_load_stays_constant() -> None:
    load = np.full((5, 28, 12), 1e5)
    made = [effect("lag", tau_s=0.1), effect("viscoelasticity", a=0.2, tau_s=1), effect("creep", a=[0.1], tau_s=[50])]
    np.testing.assert_allclose(through(made, load, np.arange(5.0)), load, rtol=1e-12)


# ---- creep with a power of time


def convolved(t_s: Array, load: Array, exponent: Array, t0_s: Array) -> Array:
    """Return (n, m) ∫ ((t − s)/t0)^n dP for P (n, m) with a jump at t_0, linear between samples; piecewise
    closed form.
    """
    convolution = np.zeros_like(load)
    for i in range(1, len(t_s)):
        since = np.maximum(t_s[i] - t_s[: i + 1], 0.0)[:, None] ** (exponent + 1) / (exponent + 1)
        slopes = np.diff(load[: i + 1], axis=0) / np.diff(t_s[: i + 1])[:, None]
        jump = load[0] * (t_s[i] - t_s[0]) ** exponent
        convolution[i] = (jump + (slopes * (since[:-1] - since[1:])).sum(axis=0)) / t0_s**exponent
    return convolution


@pytest.mark.parametrize(("shortest_s", "longest_s"), [(0.001, 0.02), (0.01, 0.01), (0.02, 3.0), (1.0, 900.0)])
def test_power_creep_equals_the_convolution_integral(shortest_s: float, longest_s: float) -> None:
    rng = np.random.default_rng(5)
    t_s, load = times(rng, 200, shortest_s, longest_s), loads(rng, 200)
    row = LAYOUT.rows[5, 0]
    exponent = np.array([0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 0.9])
    t0_s, a = np.geomspace(0.1, 1e3, 12), np.linspace(0.01, 0.2, 12)
    output = through([effect("power_creep", TAXELS, a=a, exponent=exponent, t0_s=t0_s)], load, t_s)
    expected = (1 - a) * load[:, row] + a * convolved(t_s, load[:, row], exponent, t0_s)
    # Behind the first sample, at whose leap no time has gone by.
    of_full_scale = np.abs(output[1:, row] - expected[1:]) / np.maximum(np.abs(expected).max(axis=0), FULL_SCALE_PA)
    assert of_full_scale.max() < 1e-6


@pytest.mark.parametrize("exponent", [0.01, 0.1, 0.3, 0.5, 0.8, 0.9])
def test_the_sum_of_modes_equals_the_power_law_within_its_span(exponent: float) -> None:
    at_once, a, tau_s = kernel(np.array([exponent]))
    t_s = np.geomspace(1e-3, SPAN_S, 2000)
    grown = at_once + (a * (1 - np.exp(-t_s / tau_s))).sum(axis=0)
    assert np.abs(grown / t_s**exponent - 1).max() < 1e-6
    assert at_once > 0
    assert (a > 0).all(), "as a chain of springs and dampers has it"


def test_a_hold_creeps_to_the_load_at_t0_and_beyond() -> None:
    made = [effect("power_creep", a=0.1, exponent=0.25, t0_s=100.0)]
    t_s = np.array([0.0, 1.0, 100.0, 1600.0])
    q = through(made, np.full((4, 28, 12), 1e5), t_s)[1:, 0, 0]
    assert q == pytest.approx([0.9e5 + 1e4 * 0.01**0.25, 1e5, 0.9e5 + 2e4], abs=0.01)


def test_time_constants_are_spaced_logarithmically() -> None:
    assert log_spaced_s(0.5, 500.0, 4) == pytest.approx([0.5, 5, 50, 500])
