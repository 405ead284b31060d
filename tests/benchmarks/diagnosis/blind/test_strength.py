"""The strength k, computed again from its definition, and the conventions that it needs."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.diagnosis.blind import plan
from benchmarks.diagnosis.blind.case import UnsolvedError, _draw_clock, draw_case
from benchmarks.diagnosis.blind.chamber import chamber
from benchmarks.diagnosis.blind.effect import Effect, conceal, positions
from benchmarks.diagnosis.blind.geometry import AREA_MM2, PRESSURE_TAXELS, build_insole
from benchmarks.diagnosis.blind.plan import Spec
from benchmarks.diagnosis.blind.sensor import draw_sensors
from benchmarks.diagnosis.blind.signal_path import Signal, taxels
from benchmarks.diagnosis.blind.strength import Bench, Clock, clock_of, solve
from benchmarks.diagnosis.blind.truth import parameters
from benchmarks.diagnosis.blind.walk import walk

SHOE = np.array([2.0, 0.08, 0.08])


@pytest.fixture(scope="module")
def strolled():
    geometry = build_insole("left", 5)
    return geometry, walk(np.random.default_rng(1), geometry, "walking")


def test_solved_strength_in_a_chamber_is_the_definition():
    rng = np.random.default_rng(4)
    geometry, insole_sensors, trial = build_insole("left", 5), draw_sensors(rng), chamber(rng, "full")
    bench = Bench(trial, geometry, insole_sensors, True, False, np.array([80.0]))
    effect, k = solve(bench, conceal(rng, geometry, trial, "viscoelasticity", "triangle"), 3.0, "can")
    assert k == pytest.approx(3.0, rel=0.06)
    seconds, columns = np.arange(0, trial.main_s, 0.1), taxels(effect.place)
    clean = Signal(trial, geometry.taxel_mm, insole_sensors, (), columns).mean(seconds)
    with_effect = Signal(trial, geometry.taxel_mm, insole_sensors, (effect,), columns).mean(seconds)
    pressure = trial.at(trial.courses[:, 0], seconds) / trial.span_pa
    static = np.vander(pressure, 4)
    residual = with_effect - clean
    residual = residual - static @ np.linalg.lstsq(static, residual, rcond=None)[0]
    noise_variance = np.mean(insole_sensors.noise.ravel()[columns] ** 2 + 1 / 12)
    assert np.sqrt(np.mean(residual**2) / noise_variance) == pytest.approx(3.0, rel=0.08)


def test_solved_strength_in_a_walk_stands_out_of_the_wrench(strolled):
    geometry, trial = strolled
    insole_sensors = draw_sensors(np.random.default_rng(5))
    bench = Bench(trial, geometry, insole_sensors, False, False, SHOE)
    gain, k = solve(bench, conceal(np.random.default_rng(6), geometry, trial, "gain", "board"), 5.0, "can")
    assert k == pytest.approx(5.0, rel=0.06)
    assert np.abs(bench.wrench_mismatch(())).max() < 0.5  # the static curve and its inverse agree
    mismatch = bench.wrench_mismatch((gain,))
    assert np.max(np.sqrt(np.mean(mismatch**2, 0)) / bench.wrench_noise) == pytest.approx(k, rel=1e-6)


def test_out_of_range_stays_at_the_limit():
    rng = np.random.default_rng(5)
    geometry, insole_sensors, trial = build_insole("left", 5), draw_sensors(rng), chamber(rng, "full")
    bench = Bench(trial, geometry, insole_sensors, True, False, np.array([80.0]))
    effect = conceal(rng, geometry, trial, "creep", "insole")
    assert solve(bench, effect, 1000.0, "can")[0].amplitude == effect.limits[1]


@pytest.mark.parametrize("k", [np.nan, np.inf, 3.9e8])
def test_a_strength_that_is_none_is_refused(k):
    case = draw_case(6, 0, Spec("null"))
    with pytest.raises(UnsolvedError, match="a hysteresis of"):
        replace(case, k={"hysteresis": k})


def test_the_wrench_is_the_sum_over_the_taxels(strolled):
    geometry, trial = strolled
    flat_mm = geometry.taxel_mm.reshape(-1, 2)
    rows = slice(5000, 7000, 100)
    columns = np.array([12 * t + k for t in range(28) for k in PRESSURE_TAXELS])
    force_n = trial.pressure(flat_mm)[rows][:, columns] * AREA_MM2 * 1e-6
    position_m = flat_mm[columns] * 1e-3
    expected = np.stack([force_n.sum(1), (force_n * position_m[:, 1]).sum(1), -(force_n * position_m[:, 0]).sum(1)], 1)
    assert trial.wrench(geometry.taxel_mm)[rows] == pytest.approx(expected, rel=1e-4, abs=1e-3)
    assert expected[:, 2].min() < 0  # the load lies before the heel


def test_the_map_is_turned_about_the_centres_and_shifted():
    geometry = build_insole("left", 5)
    shape = {"way": 0.6, "rotation_deg": 3.0}
    effect = Effect("map_transform", "map_transform", {}, np.ones((28, 12), bool), 5.0, shape)
    taxels_mm = positions(geometry, (effect,))
    centre, centre_before = taxels_mm[:, 3], geometry.taxel_mm[:, 3]  # taxel 3 is the centre
    assert centre.mean(0) - centre_before.mean(0) == pytest.approx([5 * np.cos(0.6), 5 * np.sin(0.6)])
    before, after = centre_before[-1] - centre_before[0], centre[-1] - centre[0]
    turned = np.degrees(np.arctan2(*after[::-1]) - np.arctan2(*before[::-1]))
    assert (turned + 180) % 360 - 180 == pytest.approx(3.0)


def test_a_rezero_lands_on_no_load():
    rng = np.random.default_rng(7)
    geometry, insole_sensors, trial = build_insole("left", 5), draw_sensors(rng), chamber(rng, "full")
    effect = conceal(rng, geometry, trial, "rezero", "board").with_amplitude(0.5)
    columns, rezero_s = taxels(effect.place), 0.5 * trial.main_s
    after = Signal(trial, geometry.taxel_mm, insole_sensors, (effect,), columns).mean(np.array([rezero_s]))
    assert after == pytest.approx(insole_sensors.no_load + 0.5)


def test_readings_before_the_declared_clock_are_a_clock_error():
    spec = next(s for s in plan.cases(1, "single", 400) if s.words == ("clock",) and s.recording == "chamber")
    kinds = {}
    for index in range(12):
        clock, effect = _draw_clock(np.random.default_rng(index), spec)
        kinds[effect.law] = clock, effect
    assert set(kinds) == {"own", "can_rate", "can_offset", "rows"}
    # A load at 10 s is recorded with a later time, so the readings are early.
    concealed = kinds["can_offset"][1].with_amplitude(0.5)
    clock = clock_of(concealed, "can")
    assert clock == Clock("can", 0.5, 0.0)
    assert clock.true_seconds(np.array([10.0]))[0] == 9.5
    assert kinds["rows"][0].declared == "none"
    assert kinds["own"][0].declared == "own"


def test_a_case_hands_on_the_clock_that_was_concealed():
    case = draw_case(3, 0, Spec("single", "chamber", ("clock",), 3.0))
    effect = case.effects[0]
    clock_by_law = {"own": case.clock.rate, "can_rate": case.clock.rate, "can_offset": case.clock.offset_s}
    concealed = effect.amplitude if effect.law == "can_offset" else 1e-6 * effect.signed
    assert effect.law == "rows" or clock_by_law[effect.law] == pytest.approx(concealed)


@pytest.mark.parametrize("word", ["drift", "temperature", "baseline", "rezero"])
def test_a_shift_that_is_scored_is_the_one_in_the_counts(word):
    case = draw_case(3, 0, Spec("single", "chamber", (word,), 3.0))
    (effect,) = case.effects
    stated = parameters(case, effect)
    seconds = np.array([0.0, case.trial.main_s - 0.01])
    columns = taxels(effect.place)
    clean = Signal(case.trial, case.taxels_mm, case.sensors, (), columns).mean(seconds)
    shift = Signal(case.trial, case.taxels_mm, case.sensors, (effect,), columns).mean(seconds) - clean
    if word == "temperature":
        trial = case.trial
        warmer = float(np.diff(trial.at(trial.temperature_c, seconds))[0])
        assert shift[1].mean() / warmer == pytest.approx(stated["count_per_k"][0], rel=0.02)
    elif word == "drift":
        assert (shift[1] - shift[0]).mean() == pytest.approx(stated["shift_count"][0], rel=0.02)
    else:
        assert shift[1].mean() == pytest.approx(stated["shift_count"][0], rel=0.02)


def test_a_small_delay_of_all_boards_passes_for_a_lag_and_a_long_one_does_not(strolled):
    geometry, trial = strolled
    bench = Bench(trial, geometry, draw_sensors(np.random.default_rng(5)), False, False, SHOE)
    delay = conceal(np.random.default_rng(6), geometry, trial, "delay", "insole")
    assert bench.imitated(delay.with_amplitude(0.002), "lag") < 0.5
    assert bench.imitated(delay.with_amplitude(0.08), "lag") > 3.0
