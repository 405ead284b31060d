"""Plays that close as the load vanishes are compared with sliders moved in small steps, and with their inverse."""

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
R_PA, W, HALF_PA = [2e3, 2.5e4, 6e4], [0.2, 0.3, 0.4], [0.0, 3e4, 1e3]
CLOSING = effect("hysteresis", r_pa=R_PA, w=W, half_pa=HALF_PA)
OF_A_BOARD = effect("hysteresis", Where("board", ((6,),)), r_pa=[9e4], w=[0.95], half_pa=[1e5])


def drawn(n: int, lowest_pa: float = 0.0, seed: int = 1) -> tuple[Array, Array]:
    """Return (n, 28, 12) Pa and times (n,) s."""
    return np.random.default_rng(seed).uniform(lowest_pa, FULL_SCALE_PA, (n, 28, 12)), np.arange(n) * 0.02


def by_pushing(load: Array) -> Array:
    """Return q (n,) of P (n,), linear between its samples: each slider is pushed by the edges of a slot of width 2r."""
    fine = np.interp(np.arange((len(load) - 1) * 50 + 1) / 50, np.arange(len(load)), load)
    q = fine.copy()
    for r, w, half in zip(R_PA, W, HALF_PA, strict=True):
        slider = 0.0
        for i, p in enumerate(fine):
            slider = min(max(slider, p - r), p + r)
            q[i] -= w * (p - slider) * (p / (p + half) if half else 1.0)
    return q[::50]


def test_it_equals_sliders_moved_in_small_steps() -> None:
    load, t_s = drawn(30)
    load[0] = 0.0
    q = Chain([CLOSING], LAYOUT).forward()(load, t_s)
    for row, taxel in ((0, 0), (9, 4), (27, 11)):
        np.testing.assert_allclose(q[:, row, taxel], by_pushing(load[:, row, taxel]), atol=1e-6)


def test_without_load_nothing_remains_of_plays_that_close() -> None:
    load = np.array([0.0, 2e5, 3e4, 0.0])[:, None, None] * np.ones((28, 12))
    closing, others = ({"half_pa": [1e4]}, {})
    left = [
        Chain([effect("hysteresis", r_pa=[2e4], w=[0.3], **half)], LAYOUT).forward()(load, np.arange(4.0))[-1]
        for half in (closing, others)
    ]
    np.testing.assert_array_equal(left[0], 0.0)
    np.testing.assert_allclose(left[1], 0.3 * 2e4)


@pytest.mark.parametrize("effects", [[CLOSING], [OF_A_BOARD], [CLOSING, OF_A_BOARD]])
@pytest.mark.parametrize("lowest_pa", [0.0, -2e4])
def test_the_inverse_is_exact(effects: list[Effect], lowest_pa: float) -> None:
    load, t_s = drawn(200, lowest_pa)
    chain = Chain(effects, LAYOUT)
    np.testing.assert_allclose(chain.inverse()(chain.forward()(load, t_s), t_s), load, atol=1e-8 * FULL_SCALE_PA)


def test_samples_one_by_one_give_the_same_numbers() -> None:
    load, t_s = drawn(50)
    chain = Chain([CLOSING], LAYOUT)
    whole, live = chain.forward()(load, t_s), chain.forward()
    samples = [live(load[i : i + 1], t_s[i : i + 1]) for i in range(len(t_s))]
    np.testing.assert_array_equal(np.concatenate(samples), whole)


def test_a_half_load_of_zero_is_the_usual_law() -> None:
    load, t_s = drawn(50, lowest_pa=-2e4)
    # One of them closes, so that both plays are computed by the law that may close; its weight is too small to see.
    one = effect("hysteresis", r_pa=[8e3, 2e4], w=[0.2, 1e-12], half_pa=[0.0, 1e4])
    usual = effect("hysteresis", r_pa=[8e3], w=[0.2])
    expected = Chain([usual], LAYOUT).forward()(load, t_s)
    np.testing.assert_allclose(Chain([one], LAYOUT).forward()(load, t_s), expected, atol=1e-6)


def test_the_live_inverse_undoes_a_loop_that_closes() -> None:
    """All taxels bear the same load, so the mean of neighbours is each one's."""
    t_s = np.arange(500) * 0.02
    load = (1e5 * np.clip(np.sin(t_s), 0.0, None))[:, None, None] * np.ones((28, 12))
    chain = Chain([effect("hysteresis", r_pa=[2e4], w=[0.5], half_pa=[2e4])], LAYOUT)
    q = chain.forward()(load, t_s)
    undone = chain.live()(q, t_s)
    assert np.abs(undone - load).max() < 0.05 * np.abs(q - load).max()
