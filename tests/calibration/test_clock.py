"""Planted offsets and rates between two streams are fitted, and unsuitable references are refused."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.calibration import clock
from insole_daemon.errors import CalibrationError
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import effect
from insole_daemon.simulation.conditions import ChamberCycles
from insole_daemon.simulation.scenarios.chamber import programme
from insole_daemon.skin import layout as layouts

TURNS = programme(300_000.0, (10_000.0, 40_000.0), ChamberCycles(cycles=1, hold_s=40.0))
T_S = np.arange(0.0, TURNS[-1, 0], 0.02)
PA_PER_COUNT, TAXELS = 7000.0, 40
MEMORY = (
    effect("hysteresis", r_pa=[2000.0, 12_000.0], w=[0.05, 0.06]),
    effect("viscoelasticity", a=0.08, tau_s=0.5),
    effect("creep", a=[0.03, 0.04], tau_s=[8.0, 90.0]),
)


def level_pa(t_s):
    return np.interp(t_s, TURNS[:, 0], TURNS[:, 1])


def activation(*effects, seed=0):
    """Return (n,) the mean activation of some taxels with whole counts."""
    layout = layouts.builtin("left", (5, 6, 7))
    load = np.repeat(level_pa(T_S)[:, None, None], len(layout) * 12, axis=1).reshape(len(T_S), len(layout), 12)
    felt = Chain(effects, layout).forward()(load, T_S)[:, 0, 0]
    draw = np.random.default_rng(seed)
    counts = felt[:, None] / PA_PER_COUNT * draw.uniform(0.7, 1.3, TAXELS) + draw.normal(0.0, 1.0, (len(T_S), TAXELS))
    return np.rint(counts).mean(axis=1)


def gauge(offset_s, rate, hz=50.0, seed=1):
    """Return times and noisy readings of a gauge with such a clock, with spikes and missing readings."""
    true_s = np.arange(0.0, T_S[-1], 1.0 / hz)
    draw = np.random.default_rng(seed)
    shown = level_pa(true_s) + draw.normal(0.0, 300.0, len(true_s))
    shown[draw.integers(0, len(shown), 40)] += 60_000.0
    shown[draw.integers(0, len(shown), 40)] = np.nan
    return offset_s + (1.0 + rate) * true_s, shown


def powers(x):
    return x[:, None] ** np.arange(1, 4)


@pytest.mark.parametrize(
    ("offset_s", "rate", "hz"), [(0.0, 0.0, 50.0), (1.37, 0.006, 50.0), (-7.9, -0.011, 23.0), (12.0, 5e-5, 200.0)]
)
@pytest.mark.parametrize("memory", [(), MEMORY], ids=["static", "memory"])
def test_simulated_offset_and_rate_are_estimated(offset_s, rate, hz, memory):
    fitted = clock.fit_clock(T_S, powers(activation(*memory)), *gauge(offset_s, rate, hz))
    assert fitted.offset_s == pytest.approx(offset_s, abs=0.1)
    assert fitted.rate == pytest.approx(rate, abs=0.001)
    assert fitted.explained > 0.9
    assert fitted.offset_std_s < 0.1
    np.testing.assert_allclose(fitted.reference_s(T_S), offset_s + (1 + rate) * T_S, atol=0.25)


def test_a_fixed_rate_stays_0():
    fitted = clock.fit_clock(T_S, powers(activation()), *gauge(1.37, 0.0004), most_rate=0.0)
    assert (fitted.rate, fitted.rate_std) == (0.0, 0.0)
    middle_s = T_S[-1] / 2
    assert fitted.offset_s == pytest.approx(1.37 + 0.0004 * middle_s, abs=0.02)


def test_a_rate_beyond_the_largest_stays_at_that():
    fitted = clock.fit_clock(T_S, powers(activation()), *gauge(1.37, 0.0015), most_rate=0.0003)
    assert fitted.rate == pytest.approx(0.0003, rel=1e-9)
    middle_s = T_S[-1] / 2
    at_the_ends_s = (0.0015 - 0.0003) * middle_s
    assert fitted.reference_s(middle_s) == pytest.approx(1.37 + 1.0015 * middle_s, abs=at_the_ends_s)


def test_a_reference_without_times_is_aligned_by_its_rows():
    true_s = np.arange(0.7, T_S[-1], 0.0201)  # begins later, and is slower by 0.5 %
    fitted = clock.fit_clock(T_S, powers(activation()), clock.row_times_s(T_S, len(true_s)), level_pa(true_s))
    assert fitted.offset_s == pytest.approx(-0.7 * 0.02 / 0.0201, abs=0.1)
    assert fitted.rate == pytest.approx(0.02 / 0.0201 - 1, abs=0.0005)


def test_periodic_steps_are_aligned_by_their_begin_and_end():
    """Three channels, some of which follow a feature: steps of one second, as in a shoe."""
    t_s = np.arange(0.0, 60.0, 0.02)

    def wrench(t):
        on = (t > 5.3) & (t < 52.0)
        force = np.where(on, 400.0 * np.clip(np.sin(2 * np.pi * 0.91 * t), 0.0, None), 0.0)
        return np.stack([force, 0.02 * force * np.sin(0.8 * t), np.zeros_like(t)], axis=1)

    reference_s = np.arange(0.0, 62.0, 0.01)
    draw = np.random.default_rng(3)
    reference = wrench((reference_s - 2.4) / 1.0002) + draw.normal(0.0, [5.0, 0.2, 0.0], (len(reference_s), 3))
    fitted = clock.fit_clock(
        t_s, wrench(t_s) + draw.normal(0.0, [10.0, 0.4, 0.0], (len(t_s), 3)), reference_s, reference
    )
    assert fitted.offset_s == pytest.approx(2.4, abs=0.02)
    assert fitted.rate == pytest.approx(2e-4, abs=2e-4)


def test_a_constant_reference_is_refused():
    reference_s, shown = gauge(0.0, 0.0)
    with pytest.raises(CalibrationError, match=r"has the same value in all of its \d+ readings.*switched on"):
        clock.fit_clock(T_S, powers(activation()), reference_s, np.zeros_like(shown))


def test_a_reference_of_another_trial_is_refused():
    reference_s, _ = gauge(0.0, 0.0)
    other = np.random.default_rng(5).normal(size=len(reference_s)).cumsum()
    with pytest.raises(CalibrationError, match="does not follow the taxels: at best .* of the same trial"):
        clock.fit_clock(T_S, powers(activation()), reference_s, other)


def test_a_reference_that_stops_early_is_refused():
    reference_s, shown = gauge(0.0, 0.0)
    short = len(shown) // 3
    with pytest.raises(CalibrationError, match=r"covers 3\d% of the time of the taxels, expected at least 50%"):
        clock.fit_clock(T_S, powers(activation()), reference_s[:short], shown[:short])
