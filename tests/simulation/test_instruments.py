"""Simulated reference instruments: rate, clock, noise and drift."""

import numpy as np
import pytest

from insole_daemon.physics.draws import Drawn, Draws
from insole_daemon.simulation.conditions import Conditions, InstrumentConditions
from insole_daemon.simulation.instruments import draw_clock, simulate_readings
from insole_daemon.simulation.reference_insole import reference_insole
from insole_daemon.simulation.scenarios import scenario
from insole_daemon.skin import layout as layouts

LAYOUTS = [layouts.builtin("left", (5, 6, 7))]
START_S = 1_760_000_000.0


def warm(t_s):
    return np.full_like(t_s, 25.0)


def of(name, seconds, seed=0, reference_clock=lambda t_s: t_s, chosen=InstrumentConditions()):
    load = scenario(name).load(LAYOUTS, None, Conditions(), 0)
    return simulate_readings(
        "left", load, seconds, START_S, reference_clock, warm, Draws(seed, Drawn.CLOCK), chosen
    ), load


def test_a_force_shoe_has_its_rate_clock_and_noise():
    contents, load = of("t1", 60.0, reference_clock=lambda t_s: 0.25 + 1.0001 * t_s)
    made = reference_insole()
    time_s = contents.columns["time_s"]
    assert list(contents.columns) == ["time_s", "fz_n", "mx_nm", "my_nm", "temperature_c"]
    assert contents.clock == "own"
    assert len(time_s) == 60 * made.shoe_rate_hz
    assert time_s[0] == START_S + 0.25
    assert np.diff(time_s) == pytest.approx(1.0001 / made.shoe_rate_hz, abs=1e-6)
    exact = load.reference("left", np.arange(6000) / made.shoe_rate_hz)
    for name, std in (("fz_n", made.shoe_force_noise_n), ("mx_nm", made.shoe_moment_noise_nm)):
        error = contents.columns[name] - exact[name]
        assert np.std(np.diff(error)) / 2**0.5 == pytest.approx(std, rel=0.05)
    assert (np.round(contents.columns["fz_n"], 3) == contents.columns["fz_n"]).all()


def test_drift_after_ten_minutes_has_the_stated_size():
    ends = []
    exact = of("walk", 1.0)[1].reference("left", np.arange(60_000) / 100)["fz_n"]
    for seed in range(40):
        error = of("walk", 600.0, seed)[0].columns["fz_n"] - exact
        ends.append(error[-500:].mean() - error[:500].mean())
    assert np.std(ends) == pytest.approx(reference_insole().shoe_drift_n, rel=0.35)


def test_a_gauge_has_its_rate_and_noise():
    contents, load = of("vacuum", 30.0)
    made = reference_insole()
    assert list(contents.columns) == ["time_s", "pressure_pa", "temperature_c"]
    error = contents.columns["pressure_pa"] - load.level_pa(np.arange(1500) / made.gauge_rate_hz)
    assert np.std(np.diff(error)) / 2**0.5 == pytest.approx(made.gauge_noise_pa, rel=0.1)


def test_a_reference_clock_is_drawn_from_the_seed():
    rates, offsets = [], []
    for seed in range(200):
        at = draw_clock(Draws(seed, Drawn.CLOCK), InstrumentConditions())(np.array([0.0, 1e4]))
        offsets.append(at[0])
        rates.append((at[1] - at[0]) / 1e4 - 1)
    assert np.std(offsets) == pytest.approx(reference_insole().reference_offset_s, rel=0.2)
    assert np.std(rates) == pytest.approx(1e-6 * reference_insole().reference_ppm, rel=0.2)


def test_chosen_values_override_the_reference_insole():
    chosen = InstrumentConditions(
        rate_hz=250.0, force_noise_n=0.0, force_drift_n=0.0, moment_noise_nm=0.5, moment_drift_nm=0.0
    )
    contents, load = of("t1", 20.0, chosen=chosen)
    exact = load.reference("left", np.arange(5000) / 250.0)
    assert contents.columns["fz_n"] == pytest.approx(exact["fz_n"], abs=6e-4)
    assert np.std(contents.columns["mx_nm"] - exact["mx_nm"]) == pytest.approx(0.5, rel=0.05)
    drifting, _ = of("t1", 20.0, chosen=InstrumentConditions(force_noise_n=0.0, force_drift_n=300.0))
    assert np.std(drifting.columns["fz_n"] - load.reference("left", np.arange(2000) / 100.0)["fz_n"]) > 5
    at = draw_clock(Draws(0, Drawn.CLOCK), InstrumentConditions(offset_s=-0.25, rate_ppm=500.0))(np.array([0.0, 100.0]))
    assert at == pytest.approx([-0.25, 99.8])
