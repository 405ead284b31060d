"""The simulated person: forces, CoP and pressures while walking and standing."""

import numpy as np
import pytest

from insole_daemon.simulation.foot import STANCE, Stand, Walk
from insole_daemon.simulation.load import Unloaded
from insole_daemon.skin import layout

FEET = ("left", "right")
LAYOUTS = (layout.builtin("left", (5, 6, 7)), layout.builtin("right", (8, 9, 10)))
T_S = np.arange(0.0, 30.0, 0.005)


def force_n(of, pressure_pa):
    return pressure_pa.sum(axis=(1, 2)) * of.taxel_area_m2


def cop_m(of, pressure_pa):
    return np.einsum("ntk,tkc->nc", pressure_pa, of.xy_m) / pressure_pa.sum(axis=(1, 2))[:, None]


@pytest.fixture(scope="module")
def walk():
    return Walk(LAYOUTS)


@pytest.mark.parametrize("load", [Walk(LAYOUTS, seed=3), Stand(LAYOUTS)], ids=["walk", "stand"])
@pytest.mark.parametrize("of", LAYOUTS, ids=FEET)
def test_pressures_add_up_to_the_force(load, of):
    pressure_pa = load.pressure_pa(of.foot, T_S)
    assert pressure_pa.shape == (len(T_S), len(of.triangles), 12)
    np.testing.assert_allclose(force_n(of, pressure_pa), load.force_n(of.foot, T_S), rtol=1e-12, atol=1e-9)
    assert (pressure_pa >= 0).all()
    assert not pressure_pa[..., [6, 10]].any()


def test_one_step_has_two_humps_and_a_valley(walk):
    t_s = np.linspace(0, walk.stride_s, 2001, endpoint=False)
    in_weights = walk.force_n("left", t_s) / walk.weight_n
    stance = in_weights[: int(2001 * STANCE)]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(stance))))
    first, valley, second = stance[turns + 1]
    assert 1.0 < first < 1.2
    assert 1.0 < second < 1.2
    assert 0.6 < valley < 0.85
    assert not in_weights[int(2001 * STANCE) + 1 :].any()


def test_both_feet_bear_the_weight_on_average(walk):
    t_s = np.arange(0, 97 * walk.stride_s, 0.01)
    total_n = sum(walk.force_n(foot, t_s) for foot in FEET)
    assert total_n.mean() == pytest.approx(walk.weight_n, rel=0.01)
    assert total_n.min() > 0.6 * walk.weight_n
    assert total_n.max() < 1.3 * walk.weight_n


def test_the_feet_are_half_a_stride_apart_with_double_support(walk):
    down = {foot: walk.force_n(foot, T_S) > 0 for foot in FEET}
    strikes = {foot: T_S[1:][down[foot][1:] & ~down[foot][:-1]] for foot in FEET}
    left, right = strikes["left"], strikes["right"]
    following = right[np.searchsorted(right, left[:-1])]
    np.testing.assert_allclose(following - left[:-1], walk.stride_s / 2, atol=0.011)
    np.testing.assert_allclose(np.diff(left), walk.stride_s, atol=0.011)
    assert np.mean(down["left"] & down["right"]) == pytest.approx(2 * STANCE - 1, abs=0.02)
    assert (down["left"] | down["right"]).all()


def test_cadence_is_steps_of_both_feet_in_a_minute():
    assert Walk(LAYOUTS, cadence_per_min=100.0).stride_s == pytest.approx(1.2)


@pytest.mark.parametrize("of", LAYOUTS, ids=FEET)
def test_the_cop_rolls_from_heel_to_toe_inside_the_foot(walk, of):
    start = 0.0 if of.foot == "left" else walk.stride_s / 2
    t_s = start + walk.stride_s * STANCE * np.linspace(0.02, 0.98, 60)
    x_m, y_m = cop_m(of, walk.pressure_pa(of.foot, t_s)).T
    assert (np.diff(x_m) > 0).all()
    low, high = of.xy_m.min(axis=(0, 1)), of.xy_m.max(axis=(0, 1))
    length = high[0] - low[0]
    assert x_m[0] < low[0] + 0.25 * length
    assert x_m[-1] > low[0] + 0.75 * length
    assert (y_m > low[1]).all()
    assert (y_m < high[1]).all()
    lateral_m = (y_m if of.foot == "left" else -y_m) - (y_m[0] if of.foot == "left" else -y_m[0])
    assert lateral_m.max() > 0.003  # first outwards, along the midfoot
    assert 5 < lateral_m.argmax() < 40
    assert lateral_m[-1] < -0.003  # then inwards, to the hallux


def test_walking_pressures_are_in_the_published_range(walk):
    assert 200e3 < walk.pressure_pa("left", T_S).max() < 800e3


def test_standing_shares_the_weight_with_the_cop_in_front_of_the_heel():
    stand = Stand(LAYOUTS, body_mass_kg=70.0)
    total_n = sum(stand.force_n(foot, T_S) for foot in FEET)
    np.testing.assert_allclose(total_n, 70.0 * 9.81)
    x_m = cop_m(LAYOUTS[0], stand.pressure_pa("left", T_S))[:, 0]
    assert np.ptp(x_m) > 0.001
    assert 0.2 < (x_m.mean() - LAYOUTS[0].xy_m[..., 0].min()) / np.ptp(LAYOUTS[0].xy_m[..., 0]) < 0.5


def test_pressure_depends_on_time_alone(walk):
    whole = walk.pressure_pa("right", T_S[:100])
    one_by_one = np.concatenate([walk.pressure_pa("right", T_S[i : i + 1]) for i in range(100)])
    # A product of matrices may add in another order for another number of rows.
    np.testing.assert_allclose(one_by_one, whole, rtol=1e-13)
    assert (Walk(LAYOUTS).pressure_pa("right", T_S[:100]) == whole).all()
    assert not np.allclose(Walk(LAYOUTS, seed=1).pressure_pa("right", T_S[:100]), whole, atol=1.0)


def test_unloaded_is_zero_everywhere():
    assert not Unloaded(LAYOUTS).pressure_pa("left", T_S[:5]).any()
