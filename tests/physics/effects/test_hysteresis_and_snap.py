"""Play and relay are compared with small steps and known properties of such operators, and with their inverses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

Array = NDArray[np.float64]

LAYOUT = builtin("left", (5, 6, 7))
FULL_SCALE_PA = 3.4e5
R_PA, W = [2e3, 8e3, 2.5e4], [0.06, 0.03, 0.04]
PI = effect("hysteresis", r_pa=R_PA, w=W)

loads_pa = st.lists(st.floats(0, FULL_SCALE_PA), min_size=2, max_size=12)


def one(effects: list[Effect], load: list[float] | Array) -> Array:
    """Return (n,) the output of one taxel for `load`."""
    column = np.broadcast_to(np.asarray(load, float)[:, None, None], (len(load), 28, 12))
    return Chain(effects, LAYOUT).forward()(column, np.arange(len(load)) * 0.02)[:, 7, 5]


def in_small_steps(load: Array, per_step: int = 50) -> tuple[Array, Array]:
    """Return `load` with intermediate points, and the indices of its samples."""
    n = len(load)
    fine = np.interp(np.arange((n - 1) * per_step + 1) / per_step, np.arange(n), load)
    return fine, np.arange(n) * per_step


def by_pushing(load: Array, r: float) -> Array:
    """Return the output of a play as a mechanism: a slider pushed by the edges of a slot of width 2r."""
    slider, seen = 0.0, []
    for p in load.tolist():
        if p - r > slider:
            slider = p - r
        elif p + r < slider:
            slider = p + r
        seen.append(slider)
    return np.array(seen)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32))
def test_hysteresis_equals_sliders_moved_in_small_steps(seed: int) -> None:
    load = np.random.default_rng(seed).uniform(0, FULL_SCALE_PA, 15)
    fine, at = in_small_steps(np.concatenate([[0.0], load]))
    expected = (1 - sum(W)) * fine + sum(w * by_pushing(fine, r) for r, w in zip(R_PA, W, strict=True))
    np.testing.assert_allclose(one([PI], load), expected[at[1:]], rtol=0, atol=1e-9 * FULL_SCALE_PA)


@settings(max_examples=100, deadline=None)
@given(loads_pa, st.floats(0, FULL_SCALE_PA), st.floats(0, FULL_SCALE_PA))
def test_a_minor_loop_returns_to_its_start(before: list[float], first: float, second: float) -> None:
    # From a turning point, out and back to it: the answer there is the same, however often.
    high, low = max(first, second), min(first, second)
    q = one([PI], [*before, high, low, high, low, high])
    came_from_below = before[-1] <= high
    if came_from_below:
        assert q[-1] == pytest.approx(q[-3], abs=1e-6)
    assert q[-2] == pytest.approx(q[-4], abs=1e-6)


@settings(max_examples=100, deadline=None)
@given(loads_pa, loads_pa)
def test_a_larger_cycle_erases_smaller_loops(history: list[float], other: list[float]) -> None:
    # A load above all there was wipes out what was before it.
    top = max(*history, *other)
    assert one([PI], [*history, top, 5e4])[-2:] == pytest.approx(one([PI], [*other, top, 5e4])[-2:], abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(loads_pa, st.integers(1, 20))
def test_only_turning_points_determine_the_output(load: list[float], per_step: int) -> None:
    fine, at = in_small_steps(np.array(load), per_step)
    for made in (PI, effect("snap", up_pa=1.5e5, down_pa=5e4, step_pa=1e4)):
        assert one([made], fine)[at] == pytest.approx(one([made], load), abs=1e-6)


def test_the_loop_of_one_play_equals_hand_computed_values() -> None:
    q = one([effect("hysteresis", r_pa=[10.0], w=[0.5])], [0, 5, 30, 25, 5, 0, 30])
    assert q.tolist() == [0, 2.5, 25, 22.5, 10, 5, 25]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 6))
def test_the_inverse_is_exact(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    r = rng.uniform(0, 5e4, k)
    w = rng.dirichlet(np.ones(k + 1))[:k] * 0.9
    made = [effect("hysteresis", r_pa=r, w=w)]
    load = rng.uniform(-2e4, FULL_SCALE_PA, (60, 28, 12))
    t_s = np.arange(60) * 0.02
    chain = Chain(made, LAYOUT)
    inverted_pa = chain.inverse()(chain.forward()(load, t_s), t_s)
    np.testing.assert_allclose(inverted_pa, load, rtol=0, atol=1e-9 * FULL_SCALE_PA)


def test_taxels_may_have_different_hysteresis() -> None:
    rng = np.random.default_rng(1)
    r, w = rng.uniform(0, 3e4, (3, 28 * 12)), rng.uniform(0, 0.2, (3, 28 * 12))
    load = rng.uniform(0, FULL_SCALE_PA, (40, 28, 12))
    t_s = np.arange(40) * 0.02
    chain = Chain([effect("hysteresis", r_pa=r, w=w)], LAYOUT)
    q = chain.forward()(load, t_s)
    np.testing.assert_allclose(chain.inverse()(q, t_s), load, rtol=0, atol=1e-9 * FULL_SCALE_PA)
    for slot in (0, 100, 335):
        single_effect = [effect("hysteresis", r_pa=r[:, slot], w=w[:, slot])]
        assert one(single_effect, load.reshape(40, -1)[:, slot]) == pytest.approx(q.reshape(40, -1)[:, slot], rel=1e-12)


# ---- snap


def test_snap_equals_hand_computed_values() -> None:
    made = [effect("snap", up_pa=40.0, down_pa=20.0, step_pa=7.0)]
    load = [0, 39.9, 40, 30, 20.1, 20, 30, 39, 55, 0]
    assert one(made, load).tolist() == [0, 39.9, 47, 37, 27.1, 20, 30, 39, 62, 0]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32))
def test_the_inverse_of_snap_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    down, up = np.sort(rng.uniform(0, 2e5, 2))
    made = [
        effect("snap", up_pa=up + 1, down_pa=down, step_pa=rng.uniform(0, 5e4)),
        effect("snap", up_pa=1.2e5, down_pa=9e4, step_pa=6e3),
    ]
    load = rng.uniform(0, 2.5e5, (60, 28, 12))
    t_s = np.arange(60) * 0.02
    chain = Chain(made, LAYOUT)
    inverted_pa = chain.inverse()(chain.forward()(load, t_s), t_s)
    np.testing.assert_allclose(inverted_pa, load, rtol=0, atol=1e-9 * FULL_SCALE_PA)


def test_the_taxels_of_a_triangle_may_switch_together_by_their_mean() -> None:
    rng = np.random.default_rng(5)
    load = rng.uniform(0, 1e5, (60, 1, 1)) * rng.uniform(0.2, 1.8, (28, 12))
    t_s = np.arange(60) * 0.02
    chain = Chain([effect("snap", up_pa=5e4, down_pa=3e4, step_pa=8e3, together=1)], LAYOUT)
    read = chain.forward()(load, t_s)
    added_pa = (read - load)[:, :, PRESSURE_TAXELS]
    assert np.ptp(added_pa, axis=2).max() < 1e-6
    is_on = np.zeros(28, bool)
    for mean_pa, added in zip(load[:, :, PRESSURE_TAXELS].mean(axis=2), added_pa[..., 0], strict=True):
        is_on = (mean_pa >= 5e4) | (is_on & (mean_pa > 3e4))
        np.testing.assert_allclose(added, 8e3 * is_on, atol=1e-6)
    np.testing.assert_allclose(chain.inverse()(read, t_s), load, rtol=0, atol=1e-9 * FULL_SCALE_PA)


def test_noise_below_half_a_step_does_not_mislead_the_inverse() -> None:
    rng = np.random.default_rng(2)
    load = np.abs(np.sin(np.arange(400) / 20))[:, None, None] * np.full((400, 28, 12), 1e5)
    t_s = np.arange(400) * 0.02
    chain = Chain([effect("snap", up_pa=4e4, down_pa=2e4, step_pa=1e4)], LAYOUT)
    noise = rng.uniform(-4.9e3, 4.9e3, load.shape)
    assert np.abs(chain.inverse()(chain.forward()(load, t_s) + noise, t_s) - load - noise).max() < 1e-6
