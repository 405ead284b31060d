"""Activated flow is compared with small steps of Eyring's equation, and its inverse with the load."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.skin.layout import builtin

Array = NDArray[np.float64]

LAYOUT = builtin("left", (5, 6, 7))
FULL_SCALE_PA = 3.4e5
STEP_S = 0.02
FLOWING = effect("creep", a=[0.3, 0.2], tau_s=[40.0, 2.0], scale_pa=[15e3, 0.0])
TOGETHER = effect("creep", Where("board", ((6,),)), a=[0.9], tau_s=[200.0], scale_pa=[3e3])


def steps_s(seconds: float) -> Array:
    return np.arange(0.0, seconds, STEP_S)


def pressed(t_s: Array, seed: int = 1) -> Array:
    """Return (n, 28, 12) Pa: a different stance of half a second on each taxel every second, then a hold."""
    tops = np.random.default_rng(seed).uniform(2e4, FULL_SCALE_PA, (28, 12))
    began_s = np.floor(0.6 * t_s[-1])
    swing = np.where(t_s < began_s, np.clip(np.sin(2 * np.pi * t_s), 0.0, None), np.clip(4 * (t_s - began_s), 0.0, 1.0))
    return swing[:, None, None] * tops


def by_small_steps(t_s: Array, load: Array, tau_s: float, scale_pa: float) -> Array:
    """Return (n,) P − z of P (n,), linear between its samples, by the rule of Euler."""
    fine_s = np.linspace(t_s[0], t_s[-1], 40 * len(t_s))
    z, late = load[0], []
    for p in np.interp(fine_s, t_s, load):
        late.append(p - z)
        z += (fine_s[1] - fine_s[0]) / tau_s * (scale_pa * np.sinh((p - z) / scale_pa) if scale_pa else p - z)
    return np.interp(t_s, fine_s, late)


def test_the_law_solves_eyrings_equation() -> None:
    t_s = steps_s(5.0)
    load = pressed(t_s)
    q = Chain([FLOWING], LAYOUT).forward()(load, t_s)
    for row, taxel in ((0, 0), (9, 4), (27, 11)):
        p = load[:, row, taxel]
        expected = p - 0.3 * by_small_steps(t_s, p, 40.0, 15e3) - 0.2 * by_small_steps(t_s, p, 2.0, 0.0)
        np.testing.assert_allclose(q[:, row, taxel], expected, atol=5e-3 * p.max())
    assert np.abs(q - load).max() > 0.1 * FULL_SCALE_PA


@pytest.mark.parametrize("effects", [[FLOWING], [TOGETHER], [FLOWING, TOGETHER]])
def test_the_inverse_is_exact(effects: list[Effect]) -> None:
    t_s = steps_s(4.0)
    load, chain = pressed(t_s), Chain(effects, LAYOUT)
    np.testing.assert_allclose(chain.inverse()(chain.forward()(load, t_s), t_s), load, atol=1e-8 * FULL_SCALE_PA)


def test_samples_one_by_one_give_the_same_numbers() -> None:
    t_s = steps_s(1.0)
    load, chain = pressed(t_s), Chain([FLOWING], LAYOUT)
    whole, live = chain.forward()(load, t_s), chain.forward()
    samples = [live(load[i : i + 1], t_s[i : i + 1]) for i in range(len(t_s))]
    np.testing.assert_array_equal(np.concatenate(samples), whole)


def test_within_no_time_nothing_flows() -> None:
    """A leap of a hundred scales between two samples at one time, and its inverse."""
    t_s, chain = np.array([0.0, 0.02, 0.02, 0.04]), Chain([TOGETHER], LAYOUT)
    load = np.array([0.0, 0.0, 3e5, 3e5])[:, None, None] * np.ones((28, 12))
    q = chain.forward()(load, t_s)
    of_board = np.asarray(LAYOUT.identities[:, 0] == 6)
    np.testing.assert_allclose(q[2, of_board], 0.1 * 3e5)
    assert (q[3, of_board] > 2 * q[2, of_board]).all()
    np.testing.assert_allclose(chain.inverse()(q, t_s), load, atol=1e-3)


def test_a_settled_load_stays_constant_and_a_large_scale_is_a_relaxation() -> None:
    t_s = steps_s(3.0)
    chain = Chain([FLOWING], LAYOUT)
    np.testing.assert_array_equal(chain.forward()(np.full((len(t_s), 28, 12), 1e5), t_s), 1e5)
    linear, activated = (
        Chain([effect("creep", a=[0.4], tau_s=[1.5], **scale)], LAYOUT).forward()(pressed(t_s), t_s)
        for scale in ({}, {"scale_pa": [1e9]})
    )
    np.testing.assert_allclose(activated, linear, atol=1e-3 * FULL_SCALE_PA)
