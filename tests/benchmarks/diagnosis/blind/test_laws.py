"""The generator's laws against closed forms and against plain loops."""

import numpy as np
import pytest

from benchmarks.diagnosis.blind import laws

T = np.arange(8000) * laws.STEP_S


def wandering(rng: np.random.Generator, n: int = 4000) -> np.ndarray:
    """A load (n,) in Pa of straight lines between random corners."""
    corners = rng.uniform(0, 1e5, 9)
    return np.interp(np.linspace(0, 8, n), np.arange(9), corners)


def test_low_pass_of_a_ramp_lags_by_tau():
    z = laws.low_pass(3000.0 * T, 0.4)
    assert z == pytest.approx(3000 * (T - 0.4 * (1 - np.exp(-T / 0.4))), abs=1e-6)


def test_low_pass_starts_settled():
    assert laws.low_pass(np.full(100, 7.0), 0.3) == pytest.approx(7.0)


def test_bouc_wen_does_not_depend_on_rate_and_saturates():
    load = wandering(np.random.default_rng(1))
    slow = np.interp(np.arange(0, 4000, 0.25), np.arange(4000), load)
    departure, slow_departure = laws.bouc_wen(load, 5000.0), laws.bouc_wen(slow, 5000.0)
    assert slow_departure[::4] == pytest.approx(departure, abs=0.02)
    assert 0.95 < np.max(np.abs(departure)) < 1.05


def test_laws_treat_columns_alone():
    rng = np.random.default_rng(2)
    load = np.stack([wandering(rng) for _ in range(3)], 1)
    for law in (
        lambda x: laws.bouc_wen(x, 9000.0),
        lambda x: laws.relaxation(x, 0.3, 0.15),
        lambda x: laws.power_law(x, 0.25, 2.0),
        lambda x: laws.snap(x, 6e4, 3e4, 0.02),
        lambda x: laws.mullins(x, 1e5, 30.0),
    ):
        assert law(load) == pytest.approx(np.stack([law(c) for c in load.T], 1), abs=1e-6)


def test_relay_by_its_definition():
    load = wandering(np.random.default_rng(2))
    state, states = 0.0, []
    for value in load:
        state = 1.0 if value >= 6e4 else 0.0 if value <= 3e4 else state
        states.append(state)
    assert laws.relay(load, 6e4, 3e4).tolist() == states


def test_preisach_reads_low_while_loading_and_has_no_static_curve():
    up_and_down = np.concatenate([np.linspace(0, 1e5, 4001), np.linspace(1e5, 0, 4000)])
    departure = laws.preisach(up_and_down, 1e5, 4000.0)
    assert departure[2000] < departure[6000] - 2000
    assert abs(departure[0]) < 1.0
    middle = (departure[:4001] + departure[:3999:-1]) / 2
    assert np.abs(middle[400:3600]).max() < 0.25 * np.ptp(departure) / 2


def test_power_law_superposes():
    step = np.where(T >= 1, 1e5, 0.0)
    seconds_since = np.maximum(T - 1, 0)
    expected = 1e5 * ((1 + seconds_since / 2) ** 0.25 - 1) / ((1 + laws.FELT_S / 2) ** 0.25 - 1)
    # On a grid of 20 ms the step is up to 20 ms late.
    assert laws.power_law(step, 0.25, 2.0) + step == pytest.approx(expected, abs=150.0)
    wave = 1e4 * np.sin(T)
    departure = laws.power_law(step + wave, 0.25, 2.0)
    assert departure == pytest.approx(laws.power_law(step, 0.25, 2.0) + laws.power_law(wave, 0.25, 2.0), abs=1e-3)


def test_steady_creep_has_one_phase_at_every_frequency():
    phase = 2 * np.pi * np.arange(1000) / 1000
    for harmonic in (1, 3):
        response = laws.power_law_steady(np.cos(harmonic * phase), 0.2)
        assert response == pytest.approx(harmonic**-0.2 * np.cos(harmonic * phase - 0.2 * np.pi / 2), abs=1e-9)


@pytest.mark.parametrize("n", [7000, 7175, 7218])  # the cycle turns on a sample or between two
@pytest.mark.parametrize("shape", ["sine", "ramps"])
def test_a_hysteresis_closes_the_loop_of_creep(shape, n):
    phase = np.arange(n) / n
    wave = (1 - np.cos(2 * np.pi * phase)) / 2 if shape == "sine" else 1 - np.abs(1 - 2 * phase)
    creep = laws.power_law_steady(1e5 * wave, 0.25)
    departure, missed = laws.hysteresis_like(1e5 * wave, creep)
    assert missed < 0.005  # at 3 x the floor 0.015 x
    # The part that a static recalibration would remove is equal, too.
    assert departure == pytest.approx(creep, abs=0.01 * np.ptp(creep))
