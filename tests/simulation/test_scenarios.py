"""Scenarios: forces, pressures and chamber cycles."""

import numpy as np
import pytest

from insole_daemon.errors import SimulationError
from insole_daemon.simulation.conditions import ChamberCycles, Conditions
from insole_daemon.simulation.scenarios import length_s, scenario
from insole_daemon.simulation.scenarios.chamber import Chamber, programme
from insole_daemon.skin import layout as layouts

LAYOUTS = [layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))]
LEFT = LAYOUTS[0]
AS_IT_IS = Conditions()
WEIGHT_N = 63 * 9.81
TASKS = ("t1", "t2", "t3", "t4", "t5", "t6")


def made(name, places=None, seed=0, **conditions):
    return scenario(name).load(LAYOUTS, places, Conditions(**conditions), seed)


def times(name, step_s=0.02):
    return np.arange(0, scenario(name).length_s(AS_IT_IS), step_s)


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("layout", LAYOUTS, ids=["left", "right"])
def test_force_and_moments_match_the_pressure(name, layout):
    load, t_s = made(name), times(name, 0.2)
    pressure_pa, reference = load.pressure_pa(layout.foot, t_s), load.reference(layout.foot, t_s)
    newtons = pressure_pa * layout.taxel_area_m2
    assert newtons.sum(axis=(1, 2)) == pytest.approx(reference["fz_n"], abs=1e-6)
    assert (newtons * layout.xy_m[..., 1]).sum(axis=(1, 2)) == pytest.approx(reference["mx_nm"], abs=1e-6)
    assert -(newtons * layout.xy_m[..., 0]).sum(axis=(1, 2)) == pytest.approx(reference["my_nm"], abs=1e-6)
    assert (pressure_pa >= 0).all()
    assert not pressure_pa[..., [6, 10]].any()


@pytest.mark.parametrize("name", TASKS)
def test_a_task_begins_and_ends_unloaded(name):
    load, end_s = made(name), scenario(name).length_s(AS_IT_IS)
    for foot in ("left", "right"):
        assert not load.pressure_pa(foot, np.array([0.0, 1.9, end_s - 1.9, end_s])).any()


def test_forces_have_the_papers_orders_of_magnitude():
    """650 N, 25 N·m and 90 N·m; 220 kPa standing, 360 to 630 kPa walking."""
    f_z = {name: made(name).reference("left", times(name))["fz_n"] for name in TASKS}
    assert f_z["t1"].max() == pytest.approx(WEIGHT_N / 2, rel=0.1)
    assert f_z["t2"].max() == pytest.approx(WEIGHT_N, rel=0.02)
    assert not made("t2").reference("right", times("t2"))["fz_n"].any()
    for name in ("t4", "t5", "t6"):
        assert f_z[name].max() == pytest.approx(1.12 * WEIGHT_N, rel=0.06)
        moments = made(name).reference("left", times(name))
        assert 60 < -moments["my_nm"].min() < 160
        assert np.abs(moments["mx_nm"]).max() < 30
    slow = made("t3").reference("left", times("t3"))
    assert 10 < slow["mx_nm"].max() < 25, "on the lateral edge"
    assert -25 < slow["mx_nm"].min() < -10, "on the medial one"
    highest = {name: made(name).pressure_pa("left", times(name)).max() for name in TASKS}
    assert 100e3 < highest["t1"] < 260e3
    assert all(300e3 < highest[name] < 700e3 for name in ("t3", "t4", "t5", "t6"))


def test_a_step_has_two_humps_and_rolls_from_heel_to_toe():
    load, t_s = made("walk"), np.arange(0, 0.62 * 120 / 110, 0.002)
    reference = load.reference("left", t_s)
    f_z = reference["fz_n"]
    middle = f_z[len(f_z) * 2 // 5 : len(f_z) * 3 // 5].min()
    first, second = f_z[: len(f_z) // 2].max(), f_z[len(f_z) // 2 :].max()
    assert min(first, second) > WEIGHT_N > middle > 0.6 * WEIGHT_N
    borne = f_z > 50
    cop_x = -reference["my_nm"][borne] / f_z[borne]
    assert cop_x[0] < 0.06
    assert cop_x[-1] > 0.2
    assert (np.diff(cop_x) > -1e-4).all(), "the centre of pressure goes forward"
    assert np.abs(reference["mx_nm"][borne] / f_z[borne]).max() < 0.045


def test_twice_the_mass_gives_twice_the_force():
    t_s = times("t5", 0.1)
    one, two = (made("t5", mass_kg=mass_kg).reference("left", t_s)["fz_n"] for mass_kg in (40.0, 80.0))
    assert two == pytest.approx(2 * one)


def test_pressure_is_evaluated_at_true_positions():
    moved = {layout.foot: layout.xy_m + np.array([0.01, 0.0]) for layout in LAYOUTS}
    t_s = np.array([10.0])
    at_layout, at_true = made("t1").pressure_pa("left", t_s), made("t1", places=moved).pressure_pa("left", t_s)
    assert abs(at_true - at_layout).max() > 0.05 * at_layout.max()
    assert made("t1", places=moved).reference("left", t_s) == made("t1").reference("left", t_s)
    same = {layout.foot: layout.xy_m for layout in LAYOUTS}
    assert (made("t1", places=same).pressure_pa("left", t_s) == at_layout).all()


# ---- chambers


@pytest.mark.parametrize(("name", "top_pa"), [("vacuum", 90e3), ("plenum", 350e3)])
def test_a_chamber_has_one_pressure_on_every_taxel(name, top_pa):
    load, t_s = made(name), times(name, 0.5)
    pressure_pa, level = load.pressure_pa("left", t_s), load.reference("left", t_s)["pressure_pa"]
    assert level.max() == pytest.approx(top_pa)
    assert level.min() == 0.0
    assert (pressure_pa[..., 3] == level[:, None]).all()
    assert not pressure_pa[..., [6, 10]].any()


def test_chamber_cycles_have_the_chosen_speeds_hold_and_minor_loops():
    turns = programme(100e3, (5e3, 50e3), ChamberCycles(cycles=2, hold_s=30.0))
    t_s, level = turns.T
    speeds = np.abs(np.diff(level) / np.diff(t_s))
    assert speeds[1:5] == pytest.approx(5e3)
    assert speeds[5:9] == pytest.approx(50e3)
    held = np.flatnonzero((np.diff(level) == 0) & (np.diff(t_s) == 30.0))
    assert level[held].tolist() == [100e3, 0.0], "at the top, then its recovery"
    inner = level[held[-1] + 1 :]
    assert inner.tolist() == pytest.approx([0.0, 60e3, 30e3, 60e3, 30e3, 100e3, 0.0, 0.0])
    chamber = Chamber(LAYOUTS, turns)
    assert chamber.level_pa(np.array([15.0, 25.0, 1e4])) == pytest.approx([50e3, 100e3, 0.0])


# ---- names and lengths


def test_an_unknown_scenario_is_refused_with_the_known_ones():
    with pytest.raises(SimulationError, match=r'unknown scenario "t7": expected one of vacuum, plenum, t1, .*walk'):
        scenario("t7")


@pytest.mark.parametrize("name", ["t2", "vacuum"])
def test_a_length_beyond_the_load_is_refused(name):
    whole_s = scenario(name).length_s(AS_IT_IS)
    with pytest.raises(SimulationError, match=rf"{name}: seconds: expected at most {whole_s:g} s.*found 1000 s"):
        length_s(name, AS_IT_IS, 1000.0, 60.0)
    assert length_s(name, AS_IT_IS, None, 60.0) == whole_s
    assert length_s("walk", AS_IT_IS, 1000.0, 60.0) == 1000.0
    assert length_s("walk", AS_IT_IS, None, None) is None
