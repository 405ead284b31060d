"""What insoles without a flaw, but for noise, measure of a person: the input of the analysis."""

from __future__ import annotations

import numpy as np

from insole_daemon.mechanics.gait.figures import FootCourse
from insole_daemon.mechanics.gait.steps import Steps, find_steps
from insole_daemon.mechanics.region_map import load_regions, map_regions
from insole_daemon.mechanics.wrench import WrenchEstimator
from insole_daemon.simulation.foot import Person
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.geometry import PRESSURE_TAXELS

LAYOUTS = {"left": layouts.builtin("left", (5, 6, 7)), "right": layouts.builtin("right", (8, 9, 10))}
PERIOD_S = 0.02
MIN_PRESSURE_PA = 20_000.0


def course_of(person: Person, foot: str, seconds: float, *, noise_pa=0.0, offset_pa=0.0, std_pa=None) -> FootCourse:
    layout = LAYOUTS[foot]
    t_s = np.arange(0, seconds, PERIOD_S)
    noise = np.random.default_rng(3).standard_normal((len(t_s), len(layout), 12)) * noise_pa
    pressure = person.pressure_pa(foot, t_s) + (noise + offset_pa) * PRESSURE_TAXELS
    valid = np.broadcast_to(PRESSURE_TAXELS, pressure.shape)
    variance = None if std_pa is None else np.full(pressure.shape, std_pa**2)
    return FootCourse(
        foot=foot,
        t_s=t_s,
        wrench=WrenchEstimator(layout, 20.0, MIN_PRESSURE_PA).series(pressure, valid, variance),
        pressure_pa=pressure,
        valid=valid,
        variance_pa2=lambda rows: None if variance is None else variance[rows],
        regions=map_regions(load_regions(), layout),
        taxel_area_m2=layout.taxel_area_m2,
        min_pressure_pa=MIN_PRESSURE_PA,
        calibration="one",
    )


def steps_of(person: Person, seconds: float, feet=("left", "right"), **more) -> Steps:
    return find_steps([course_of(person, foot, seconds, **more) for foot in feet], 0)
