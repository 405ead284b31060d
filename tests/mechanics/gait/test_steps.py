"""The table of steps against the person who walked them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.errors import InsoleError
from insole_daemon.mechanics.gait.contacts import find_contacts
from insole_daemon.mechanics.gait.steps import find_steps, mean_curve
from insole_daemon.simulation.foot import STANCE, Stand, Walk

from .walked import LAYOUTS, course_of, steps_of

SECONDS = 24.0


@pytest.fixture(scope="module")
def walk():
    return Walk(list(LAYOUTS.values()), body_mass_kg=70.0, cadence_per_min=100.0, seed=2)


@pytest.fixture(scope="module")
def steps(walk):
    return steps_of(walk, SECONDS, noise_pa=8000.0)


def true_stance(walk, step) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Every 0.5 ms of the stance nearest to a row of the table: times and reference."""
    foot, middle_s = str(step["foot"][0]), float(step["contact_s"][0] + step["toe_off_s"][0]) / 2
    t_s = np.arange(middle_s - 0.6, middle_s + 0.6, 0.0005)
    loaded = walk.force_n(foot, t_s) > 0
    middle = len(t_s) // 2
    first = middle - np.argmax(~loaded[middle::-1]) + 1
    last = middle + np.argmax(~loaded[middle:])
    return t_s[first:last], {name: column[first:last] for name, column in walk.reference(foot, t_s).items()}


def test_contact_and_toe_off_are_within_10_ms_of_the_persons_own(walk, steps):
    errors_s = []
    for number in range(len(steps)):
        step = steps.select(np.array([number]))
        if step["label"][0] != "steady":
            continue
        t_s, _ = true_stance(walk, step)
        errors_s += [float(step["contact_s"][0]) - t_s[0], float(step["toe_off_s"][0]) - t_s[-1]]
    assert len(errors_s) > 60
    assert np.sqrt(np.mean(np.square(errors_s))) < 0.010


def test_forces_impulses_and_cop_path_are_within_2_percent(walk, steps):
    ratios = {"peak_force_n": [], "impulse_n_s": [], "cop_path_m": []}
    steady = steps.steady
    for number in range(len(steady)):
        step = steady.select(np.array([number]))
        _, wrench = true_stance(walk, step)
        f_z = wrench["fz_n"]
        borne = f_z >= 0.1 * f_z.max()
        x, y = -wrench["my_nm"][borne] / f_z[borne], wrench["mx_nm"][borne] / f_z[borne]
        truth = {
            "peak_force_n": f_z.max(),
            "impulse_n_s": f_z.sum() * 0.0005,
            "cop_path_m": np.hypot(np.diff(x), np.diff(y)).sum(),
        }
        for name, value in truth.items():
            ratios[name].append(float(step[name][0]) / value)
    for name, values in ratios.items():
        assert np.mean(values) == pytest.approx(1.0, abs=0.02), name


def test_times_of_both_feet_are_those_of_the_walk(steps):
    steady, stride_s = steps.steady, 1.2
    for name, expected in {
        "stride_s": stride_s,
        "stance_s": STANCE * stride_s,
        "swing_s": (1 - STANCE) * stride_s,
        "step_s": stride_s / 2,
        "double_support_s": 2 * (STANCE - 0.5) * stride_s,
        "cadence_per_min": 100.0,
    }.items():
        assert np.nanmedian(steady[name]) == pytest.approx(expected, rel=0.02, abs=0.012), name


def test_the_first_and_the_last_step_of_each_foot_are_not_steady(steps):
    assert steps["label"][0] != "steady"
    assert steps["label"][-1] != "steady"
    for foot in ("left", "right"):
        labels = steps.of(foot)["label"]
        assert set(labels[1:-2]) <= {"steady", "start", "stop"}
        assert np.count_nonzero(labels == "steady") >= len(labels) - 4


def test_an_offset_of_the_sensor_is_not_force(walk, steps):
    shifted = steps_of(walk, SECONDS, noise_pa=8000.0, offset_pa=6000.0)
    for name in ("peak_force_n", "impulse_n_s", "cop_path_m", "contact_s"):
        np.testing.assert_allclose(shifted[name], steps[name], rtol=0.01, atol=0.004, err_msg=name)


def test_the_uncertainty_of_the_wrench_is_carried_into_figures(walk, steps):
    assert np.isnan(steps.std("peak_force_n")).all(), "the calibration carries none"
    carried = steps_of(walk, SECONDS, std_pa=4000.0).steady
    for name in carried.figure_names:
        known = np.isfinite(carried[name])
        assert known.any(), name
        # Contact areas are sure where no taxel is near the pressure of contact, and a slope forgets a common offset.
        least = 0.0 if name.endswith("area_m2") or name == "loading_rate_n_s" else 1e-9
        assert name == "valid_fraction" or (carried.std(name)[known] >= least).all(), name
    assert carried.std("heel_peak_pa") == pytest.approx(4000.0)


def test_regions_have_peak_integral_and_area(walk, steps):
    pressure = walk.pressure_pa("left", np.arange(0, 12, 0.002))
    from insole_daemon.mechanics.region_map import load_regions, map_regions

    regions = map_regions(load_regions(), LAYOUTS["left"])
    exact = steps_of(walk, SECONDS).of("left").steady
    for number, name in enumerate(regions.names):
        highest = pressure[:, regions.of_taxel == number].max()
        assert np.nanmax(exact[f"{name}_peak_pa"]) == pytest.approx(highest, rel=0.06), name
        whole_m2 = np.count_nonzero(regions.of_taxel == number) * LAYOUTS["left"].taxel_area_m2
        assert (exact[f"{name}_area_m2"] <= whole_m2 + 1e-12).all()
        assert (exact[f"{name}_integral_pa_s"] > 0).all()


def test_mean_curves_have_101_points_and_the_spread_of_the_steps(steps):
    mean, spread = mean_curve(steps.of("left").steady.curves["f_z_n"])
    assert mean.shape == spread.shape == (101,)
    assert mean[0] == pytest.approx(0.0, abs=1e-6)
    assert mean.max() == pytest.approx(1.1 * 70 * 9.81, rel=0.05)
    assert 0 < np.nanmedian(spread) < 40


def test_one_foot_alone_is_reported_with_the_missing_foot(walk):
    alone = steps_of(walk, 12.0, feet=("right",))
    assert len(alone.steady) > 5
    assert np.isnan(alone["double_support_s"]).all()
    assert "without steps of the left foot" in " ".join(alone.remarks)


def test_standing_is_labelled_and_no_step():
    still = steps_of(Stand(list(LAYOUTS.values())), 10.0)
    assert still["label"].tolist() == ["standing", "standing"]
    assert len(still.steady) == 0


def test_unworn_insoles_have_no_steps_and_a_remark():
    class Nobody(Stand):
        def region_n(self, foot, t_s):
            return 0.0 * super().region_n(foot, t_s)

    nobody = steps_of(Nobody(list(LAYOUTS.values())), 10.0, noise_pa=8000.0)
    assert len(nobody) == 0
    assert "no step of the left foot" in " ".join(nobody.remarks)
    assert len(repr(nobody).splitlines()) <= 5


def test_a_repr_is_five_lines(steps):
    assert len(repr(steps).splitlines()) <= 5
    assert "steady" in repr(steps)


def test_an_unknown_column_and_figure_are_named(steps):
    with pytest.raises(KeyError, match="stance_s"):
        steps["stance"]
    with pytest.raises(InsoleError, match="peak_force_n"):
        steps.check_figure("label")


def test_a_gap_in_a_stance_leaves_it_out():
    t_s = np.arange(0, 8, 0.02)
    f_z_n = 600.0 * np.maximum(np.sin(2 * np.pi * t_s / 1.2), 0.0)
    keep = (t_s < 2.6) | (t_s > 2.9)  # within a stance
    assert len(find_contacts(t_s[keep], f_z_n[keep])) == len(find_contacts(t_s, f_z_n)) - 1


@pytest.mark.parametrize("n", [0, 1, 2])
def test_hardly_any_cycles_are_no_steps(n):
    assert len(find_contacts(np.arange(n) * 0.02, np.full(n, 500.0))) == 0


def test_standing_alone_is_reported_as_no_steady_step():
    standing = course_of(Stand(list(LAYOUTS.values())), "left", 12.0)
    force = np.where((standing.t_s > 2) & (standing.t_s < 10), standing.wrench.f_z_n, 0.0)
    steps = find_steps([replace(standing, wrench=replace(standing.wrench, f_z_n=force))], 0)
    assert len(steps) == 1
    assert "no steady step, so no mean, symmetry or comparison: 1 standing" in " ".join(steps.remarks)
    assert "no steady step" not in " ".join(
        steps_of(Walk(list(LAYOUTS.values()), seed=2), 12.0, feet=("left",)).remarks
    )
