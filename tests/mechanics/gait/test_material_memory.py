"""The memory of the material: estimated from swings, undone, and not seen where there is none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from insole_daemon.mechanics.gait.contacts import find_contacts
from insole_daemon.mechanics.gait.material_memory import estimate_memory
from insole_daemon.mechanics.gait.steps import find_steps
from insole_daemon.mechanics.gait.swing_offset import swing_samples
from insole_daemon.physics.law import Moments
from insole_daemon.physics.relaxation import Relaxation
from insole_daemon.simulation.foot import Walk

from .walked import LAYOUTS, course_of

SECONDS = 30.0
WALK = Walk(list(LAYOUTS.values()), seed=6)
FIGURES = ("peak_force_n", "impulse_n_s", "forefoot_peak_pa", "heel_peak_pa")


def remembering(course, fraction, tau_s, drift_n_per_s=0.0):
    """`course` as an insole reads it that answers to `fraction` of a load with the time constant `tau_s`."""
    law = Relaxation(np.array([1 - fraction]), np.array([[fraction]]), np.array([[tau_s]]))
    moments = Moments(course.t_s, np.diff(course.t_s, prepend=course.t_s[0]), None)
    wrench, flat = course.wrench, course.pressure_pa.reshape(len(course.t_s), -1)
    loads = np.stack([wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm], axis=1)
    read = law(np.hstack([loads, flat]), moments)
    drift_n = drift_n_per_s * course.t_s
    return dataclasses.replace(
        course,
        wrench=dataclasses.replace(wrench, f_z_n=read[:, 0] + drift_n, m_x_nm=read[:, 1], m_y_nm=read[:, 2]),
        pressure_pa=read[:, 3:].reshape(course.pressure_pa.shape),
    )


def means(steps, names):
    return np.array([np.mean(steps.steady[name]) for name in names])


@pytest.mark.parametrize(("fraction", "tau_s"), [(0.05, 0.3), (0.2, 0.15), (0.1, 0.6)])
def test_a_memory_is_undone_to_a_hundredth_of_force_and_pressure(fraction, tau_s):
    course = course_of(WALK, "left", SECONDS, noise_pa=2000.0)
    names = [name for name in FIGURES if name in find_steps([course], 0).columns]
    truth = means(find_steps([course], 0), names)
    steps = find_steps([remembering(course, fraction, tau_s)], 0)
    assert "material remembers" in " ".join(steps.remarks)
    assert means(steps, names) / truth == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("noise_pa", [200.0, 4000.0])
def test_noise_and_drift_are_not_taken_for_a_memory(noise_pa):
    course = remembering(course_of(WALK, "left", SECONDS, noise_pa=noise_pa), 0.0, 1.0, drift_n_per_s=1.5)
    assert "remembers" not in " ".join(find_steps([course], 0).remarks)


def test_a_light_persons_short_walk_shows_a_memory_of_5_percent_and_none_where_there_is_none():
    """At the threshold of 9, 93 % of such walks show it, with 25 half of them; none of 30 without a memory does."""
    t_s = np.arange(0, 20.0, 0.02)
    force = Walk(list(LAYOUTS.values()), body_mass_kg=50.0, cadence_per_min=100.0, seed=3).force_n("left", t_s)
    moments = Moments(t_s, np.diff(t_s, prepend=t_s[0]), None)
    counts = []
    for fraction in (0.0, 0.05):
        law = Relaxation(np.array([1 - fraction]), np.array([[fraction]]), np.array([[0.3]]))
        read = law(force[:, None], moments)[:, 0]
        noisy = [read + np.random.default_rng(seed).normal(0, 4.5, len(t_s)) for seed in range(12)]
        in_swing = np.zeros(len(t_s), np.bool_)
        in_swing[np.concatenate(swing_samples(t_s, find_contacts(t_s, read)))] = True
        counts.append(sum(estimate_memory(t_s, force_n, in_swing) is not None for force_n in noisy))
    assert counts[0] == 0
    assert counts[1] >= 10


def test_a_foot_that_is_touched_in_two_swings_does_not_pull_the_memory():
    course = remembering(course_of(WALK, "left", SECONDS, noise_pa=2000.0), 0.1, 0.3)
    calm = find_steps([course], 0)
    force = course.wrench.f_z_n.copy()
    in_air = np.flatnonzero((force < 20) & (course.t_s > 10) & (course.t_s < 12))
    force[in_air] += 30.0
    touched = find_steps([dataclasses.replace(course, wrench=dataclasses.replace(course.wrench, f_z_n=force))], 0)
    late = [step.remarks[-1] for step in (calm, touched)]
    assert late[0] == late[1]


def test_a_force_that_is_not_known_for_a_while_leaves_the_others_known():
    course = remembering(course_of(WALK, "left", SECONDS, noise_pa=2000.0), 0.1, 0.3)
    force = course.wrench.f_z_n.copy()
    force[500:503] = np.nan
    steps = find_steps([dataclasses.replace(course, wrench=dataclasses.replace(course.wrench, f_z_n=force))], 0)
    assert np.isfinite(steps.steady["impulse_n_s"]).sum() >= len(find_steps([course], 0).steady) - 2
