"""Forces scaled so that both feet bear the body's weight over a stride."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.errors import InsoleError
from insole_daemon.mechanics.gait.body_weight import scale_to_body_weight
from insole_daemon.mechanics.gait.steps import find_steps
from insole_daemon.mechanics.gait.symmetry import symmetry
from insole_daemon.simulation.foot import Walk

from .walked import LAYOUTS, course_of

SECONDS = 20.0
MASS_KG = 70.0
GAIN = 0.93  # of the insoles
FIGURES = ("peak_force_n", "impulse_n_s", "loading_rate_n_s", "heel_peak_pa", "forefoot_peak_pa", "stance_s",
           "cop_path_m", "heel_area_m2", "valid_fraction")  # fmt: skip


def steps_read(gain, feet=("left", "right")):
    """The steps of a walk that the insoles read too low by `gain`, in force and pressure."""
    walk = Walk(list(LAYOUTS.values()), body_mass_kg=MASS_KG, cadence_per_min=100.0, seed=2)
    courses = []
    for foot in feet:
        course = course_of(walk, foot, SECONDS, std_pa=1000.0)
        wrench = course.wrench
        scaled = {name: gain * getattr(wrench, name) for name in ("f_z_n", "m_x_nm", "m_y_nm", "f_z_std_n")}
        courses.append(replace(course, wrench=replace(wrench, **scaled), pressure_pa=gain * course.pressure_pa))
    return find_steps(courses, 0)


def test_a_gain_of_both_insoles_is_corrected_in_forces_and_pressures_alone():
    truth, scaled = steps_read(1.0), scale_to_body_weight(steps_read(GAIN), MASS_KG)
    for name in [name for name in FIGURES if name in truth.columns and not name.endswith("area_m2")]:
        assert np.nanmean(scaled.steady[name]) == pytest.approx(np.nanmean(truth.steady[name]), rel=0.006), name
    assert np.nanmean(scaled.steady.curves["f_z_n"]) == pytest.approx(
        np.nanmean(truth.steady.curves["f_z_n"]), rel=0.006
    )
    assert scaled.remarks[-1].startswith("forces and pressures times 1.0")


def test_symmetry_and_the_relative_uncertainty_do_not_change():
    read = steps_read(GAIN)
    scaled = scale_to_body_weight(read, MASS_KG)
    assert symmetry(scaled, "impulse_n_s").value == pytest.approx(symmetry(read, "impulse_n_s").value)
    relative = [steps.std("peak_force_n") / steps["peak_force_n"] for steps in (scaled, read)]
    assert relative[0] == pytest.approx(relative[1], nan_ok=True)


def test_a_mass_that_is_not_the_persons_is_refused():
    with pytest.raises(InsoleError, match=r"the insoles bear 47% of the weight of 150 kg, expected 80% to 125%"):
        scale_to_body_weight(steps_read(1.0), 150.0)
    with pytest.raises(InsoleError, match="expected the mass of the person in kg, found 0"):
        scale_to_body_weight(steps_read(1.0), 0.0)


def test_one_foot_is_refused():
    with pytest.raises(InsoleError, match="found 0: record both feet"):
        scale_to_body_weight(steps_read(1.0, feet=("left",)), MASS_KG)


def test_a_table_without_steps_is_refused():
    with pytest.raises(InsoleError, match="found 0"):
        scale_to_body_weight(find_steps([], 0), MASS_KG)
