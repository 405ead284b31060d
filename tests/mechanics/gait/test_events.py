"""Steps in simulated walking against the load that made them, and none where nobody walks."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.mechanics.gait import events
from insole_daemon.mechanics.gait.events import HIGH_N, LOW_N, FootGait, Gait
from insole_daemon.mechanics.regions import REGIONS, regions
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.foot import STANCE, Stand, Walk
from insole_daemon.simulation.scenarios import scenario
from insole_daemon.simulation.scenarios.standing import ALOFT_S, STEP_S
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.geometry import PRESSURE_TAXELS

LAYOUTS = [layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))]
LEFT = LAYOUTS[0]
START_NS = 1_700_000_000_000_000_000
PERIOD_S = 0.02
VALID = np.tile(PRESSURE_TAXELS, (len(LEFT), 1))


def told(person, seconds, *, noise_n=5.0, offset_n=0.0, feet=("left", "right"), skip=lambda t_s: False):
    """The events of a person on insoles that read f_z with noise and an offset, and pressure as it is."""
    rng = np.random.default_rng(7)
    gait = Gait([layout for layout in LAYOUTS if layout.foot in feet])
    t_s = np.arange(0, seconds, PERIOD_S)
    force = {foot: person.force_n(foot, t_s) + noise_n * rng.standard_normal(len(t_s)) + offset_n for foot in feet}
    pressure = {foot: person.pressure_pa(foot, t_s) for foot in feet}
    found = []
    for at, now_s in enumerate(t_s.tolist()):
        if skip(now_s):
            continue
        for foot in feet:
            now_ns = round(now_s * 1e9)
            event = gait.update(foot, now_ns, START_NS + now_ns, float(force[foot][at]), pressure[foot][at], VALID)
            if event is not None:
                found.append(event)
    return found


def seconds_of(events, foot, kind):
    return np.array([(event.t_ns - START_NS) * 1e-9 for event in events if (event.foot, event.kind) == (foot, kind)])


@pytest.mark.parametrize("cadence", [60.0, 84.0, 110.0, 140.0])
@pytest.mark.parametrize("offset_n", [0.0, 35.0, -20.0])
def test_every_step_of_a_walk_is_reported_once_with_its_time(cadence, offset_n):
    walk = Walk(LAYOUTS, cadence_per_min=cadence)
    events = told(walk, 20.0, offset_n=offset_n)
    for row, foot in enumerate(("left", "right")):
        stride_s = walk.stride_s
        starts_s = np.arange(-1, 20.0 / stride_s + 1) * stride_s - 0.5 * row * stride_s
        for kind, after_s in (("initial_contact", 0.0), ("toe_off", STANCE * stride_s)):
            true_s = starts_s + after_s
            found_s = seconds_of(events, foot, kind)
            assert all(np.abs(true_s - time_s).min() < 0.035 for time_s in found_s), "none that is not there"
            for time_s in true_s[(true_s > 2.5) & (true_s < 19.8)]:  # until then an offset is being learned
                assert np.count_nonzero(np.abs(found_s - time_s) < 0.035) == 1
    assert max(event.noticed_after_s for event in events) < 0.06


def test_the_figures_are_those_of_the_walk():
    walk = Walk(LAYOUTS, body_mass_kg=70.0, cadence_per_min=100.0)
    events = [event for event in told(walk, 12.0) if event.t_ns > START_NS + 4_000_000_000]
    contacts = [event.figures for event in events if event.kind == "initial_contact"]
    lifts = [event.figures for event in events if event.kind == "toe_off"]
    for figures in contacts:
        assert figures["cadence_per_min"] == pytest.approx(100.0, rel=0.03)
        assert figures["stride_s"] == pytest.approx(1.2, abs=0.03)
        assert figures["swing_s"] == pytest.approx((1 - STANCE) * 1.2, abs=0.03)
    for figures in lifts:
        assert figures["stance_s"] == pytest.approx(STANCE * 1.2, abs=0.03)
        assert figures["double_support_s"] == pytest.approx((STANCE - 0.5) * 1.2, abs=0.03)
        assert figures["stance_symmetry_percent"] == pytest.approx(0.0, abs=4.0)
        assert figures["peak_force_n"] == pytest.approx(1.1 * 70 * 9.81, rel=0.08)
        assert figures["valid_fraction"] == 1.0


def test_peak_and_integral_of_every_region_are_those_of_its_pressure():
    walk = Walk(LAYOUTS)
    (last,) = [event for event in told(walk, 3.0, noise_n=0.0) if event.kind == "toe_off" and event.foot == "left"][-1:]
    end_s = (last.t_ns - START_NS) * 1e-9
    t_s = np.arange(end_s - last.figures["stance_s"], end_s, 0.001)
    pressure = walk.pressure_pa("left", t_s)
    region = regions(LEFT)
    for number, name in enumerate(REGIONS):
        highest = pressure[:, region == number].max(axis=1)
        assert last.figures[f"{name}_peak_pa"] == pytest.approx(highest.max(), rel=0.05)
        assert last.figures[f"{name}_integral_pa_s"] == pytest.approx(highest.sum() * 0.001, rel=0.06)


def test_a_limp_on_straight_ramps_has_the_figures_worked_out_by_hand():
    """Rest at 50 N and 600 N more under load: low is a twentieth of these above rest, 80 N, and high 140 N."""
    gait, last = Gait(LAYOUTS), {}
    for at in range(400):
        t_s = at * PERIOD_S
        for foot, begin_s, end_s in (("left", 0.0, 0.72), ("right", 0.6, 0.8)):
            into_s = (t_s - begin_s) % 1.2
            f_z_n = 50.0 + 600.0 * min(max(min(into_s, end_s - into_s) / 0.24, 0.0), 1.0)
            t_ns = at * 20_000_000
            event = gait.update(foot, t_ns, START_NS + t_ns, f_z_n, np.full((len(LEFT), 12), 1e4), VALID)
            if event is not None:
                last[foot, event.kind] = event
    by_hand = {  # into a stride: low is crossed 12 ms after a rise began, 12 ms before a fall ended
        ("left", "initial_contact"): (0.012, {"swing_s": 0.504}),
        ("left", "toe_off"): (0.708, {"stance_s": 0.696, "double_support_s": 0.096}),
        ("right", "initial_contact"): (0.612, {"swing_s": 0.424}),
        ("right", "toe_off"): (0.188, {"stance_s": 0.776, "double_support_s": 0.176}),
    }
    for (foot, kind), (into_s, figures) in by_hand.items():
        event = last[foot, kind]
        assert (event.t_ns - START_NS) * 1e-9 % 1.2 == pytest.approx(into_s, abs=1e-6)
        assert event.noticed_after_s == pytest.approx(0.028 if kind == "initial_contact" else 0.012, abs=1e-6)
        if kind == "initial_contact":
            figures |= {"stride_s": 1.2, "cadence_per_min": 100.0}
        else:
            figures |= {"stance_symmetry_percent": 200 * (0.696 - 0.776) / (0.696 + 0.776), "peak_force_n": 650.0}
        assert {name: event.figures[name] for name in figures} == pytest.approx(figures, abs=1e-6)


@pytest.mark.parametrize("name", ["stand", "t1", "t2", "t3"])
def test_standing_gives_no_step(name):
    conditions = Conditions(mass_kg=95.0)
    load, seconds = scenario(name).load(LAYOUTS, None, conditions, 0), scenario(name).length_s(conditions)
    events = told(load, 60.0 if seconds is None else seconds)
    begin_s, end_s = (0.0, 60.0) if seconds is None else (ALOFT_S + STEP_S, seconds - ALOFT_S - STEP_S)
    assert [e for e in events if begin_s <= (e.t_ns - START_NS) * 1e-9 <= end_s] == []


@pytest.mark.parametrize("offset_n", [0.0, 200.0])
def test_noise_on_an_empty_insole_is_no_step(offset_n):
    class Nobody(Stand):
        def region_n(self, foot, t_s):
            return 0.0 * super().region_n(foot, t_s)

        def force_n(self, foot, t_s):
            return 0.0 * t_s

    assert told(Nobody(LAYOUTS), 30.0, noise_n=10.0, offset_n=offset_n) == []


def test_readings_before_a_gap_are_unknown():
    events = told(Walk(LAYOUTS), 12.0, skip=lambda t_s: 5.0 < t_s < 5.5)
    after = [e for e in events if e.foot == "left" and e.t_ns > START_NS + 5_500_000_000]
    assert after[0].figures.get("stance_s", after[0].figures.get("swing_s")) is None
    assert all(0.2 < e.figures["stance_s"] < 0.9 for e in after[2:] if e.kind == "toe_off")


def test_an_unknown_force_ends_nothing_else():
    gait = FootGait(LEFT)
    nothing = np.full((len(LEFT), 12), np.nan)
    assert gait.update(0, 0, None, nothing, np.zeros_like(VALID)) is None
    assert gait.update(20_000_000, 0, 500.0, nothing, np.zeros_like(VALID)) is None
    assert gait.loaded, "it was on the ground when somebody looked: no contact is told"
    assert LOW_N < HIGH_N


def test_one_foot_alone_has_no_figures_of_both():
    events = told(Walk(LAYOUTS), 6.0, feet=("left",))
    lifts = [event.figures for event in events if event.kind == "toe_off"]
    assert {figures["double_support_s"] for figures in lifts} == {None}
    assert {figures["stance_symmetry_percent"] for figures in lifts} == {None}


def test_invalid_taxels_have_no_pressure_and_lower_the_valid_fraction():
    gait = FootGait(LEFT)
    half = VALID & (regions(LEFT) > 0)
    reported = []
    for at in range(100):
        f_z_n = 500.0 if at % 40 > 15 else 0.0
        reported.append(gait.update(at * 20_000_000, 0, f_z_n, np.full((len(LEFT), 12), 1e5), half))
    (lift,) = [event for event in reported if event is not None and event.kind == "toe_off"][-1:]
    assert lift.figures["heel_peak_pa"] == 0.0
    assert lift.figures["toes_peak_pa"] == 1e5
    assert lift.figures["valid_fraction"] == pytest.approx(half.sum() / VALID.sum())


def test_regions_share_the_sole_from_heel_to_toes():
    region = regions(LEFT)
    assert (region[:, ~PRESSURE_TAXELS] == -1).all()
    x = [LEFT.xy_m[..., 0][region == number] for number in range(len(REGIONS))]
    assert all(x_of_region.size for x_of_region in x)
    assert all(near.max() < far.min() for near, far in itertools.pairwise(x))


def test_a_region_without_taxels_presses_nothing():
    region = regions(LEFT)[:, PRESSURE_TAXELS]
    ends = np.flatnonzero((region == 0).all(axis=1) | (region == 3).all(axis=1)).tolist()
    few = replace(LEFT, triangles=tuple(LEFT.triangles[row] for row in ends), xy_m=LEFT.xy_m[ends])
    gait, valid, pressure_pa = FootGait(few), np.tile(PRESSURE_TAXELS, (len(ends), 1)), np.full((len(ends), 12), 1e4)
    reported = [gait.update(at * 20_000_000, 0, 500.0 if at % 40 > 15 else 0.0, pressure_pa, valid) for at in range(60)]
    (lift,) = [event for event in reported if event is not None and event.kind == "toe_off"]
    assert [lift.figures[f"{name}_peak_pa"] for name in REGIONS] == [1e4, 0.0, 0.0, 1e4]


def test_levels_that_move_do_not_tell_one_contact_twice(monkeypatch):
    """A soak found it after ten hours: the force was between the levels all the time, and they moved around it."""
    gait = FootGait(LEFT)
    monkeypatch.setattr(gait._levels, "update", lambda t_mono_ns, f_z_n: None)

    def update(f_z_n, low_n, high_n):
        gait._levels.low_n, gait._levels.high_n = low_n, high_n
        update.t_ns += 20_000_000
        return gait.update(update.t_ns, START_NS + update.t_ns, f_z_n, np.zeros((len(LEFT), 12)), VALID)

    update.t_ns = 0
    forces = [(0.0, 20.0, 60.0), (100.0, 20.0, 60.0), (100.0, 120.0, 360.0), (100.0, 20.0, 60.0), (100.0, 20.0, 60.0)]
    events = [update(*force) for force in forces]
    assert [force and force.kind for force in events] == [None, "initial_contact", None, None, None]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32))
def test_any_forces_at_all_are_survived(seed):
    """Forces about the levels, unknown ones and pauses: every event is a later one, every figure a number."""
    random, gait, nothing, t_ns = Random(seed), Gait(LAYOUTS), np.zeros((len(LEFT), 12)), 0
    some_n = [0.0, LOW_N, HIGH_N, *(random.uniform(-100, 1500) for _ in range(4))]
    happened_ns = {"left": -1, "right": -1}
    f_z_n = dict.fromkeys(happened_ns, 0.0)
    for _ in range(200):
        t_ns += random.choice([20] * 12 + [1, 19, 40, 150, 200, 201, 1000]) * 1_000_000
        for foot in happened_ns:
            f_z_n[foot] = random.choice(some_n) if random.random() < 0.5 else f_z_n[foot]
            known = None if random.random() < 0.01 else f_z_n[foot]
            event = gait.update(foot, t_ns, t_ns, known, nothing, VALID)
            if event is None:
                continue
            assert happened_ns[foot] <= event.t_ns <= t_ns
            happened_ns[foot] = event.t_ns
            symmetry = event.figures.pop("stance_symmetry_percent", None)
            assert symmetry is None or abs(symmetry) < 200
            assert all(value is None or 0 <= value < math.inf for value in event.figures.values())


@pytest.mark.skipif(events.kernel is None, reason="the compiled kernel was not built")
def test_the_kernel_takes_the_peaks_and_integrals_that_numpy_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(11)
    compiled, numpy = FootGait(LEFT), FootGait(LEFT)
    for _ in range(50):
        pressure_pa = rng.normal(5e4, 5e4, VALID.shape).astype(np.float32)
        valid = (VALID & (rng.random(VALID.shape) < 0.9)).astype(np.uint8)
        seconds, f_z_n = float(rng.uniform(0.01, 0.03)), float(rng.uniform(100.0, 800.0))
        compiled._press(seconds, f_z_n, pressure_pa, valid)
        with monkeypatch.context() as patch:
            patch.setattr(events, "kernel", None)
            numpy._press(seconds, f_z_n, pressure_pa, valid)
    assert compiled._peak_pa.tobytes() == numpy._peak_pa.tobytes()
    assert compiled._integral_pa_s.tobytes() == numpy._integral_pa_s.tobytes()
    assert compiled._valid_fraction == numpy._valid_fraction < 1
    assert (numpy._peak_pa > 0).all()
    assert (numpy._integral_pa_s > 0).all()
