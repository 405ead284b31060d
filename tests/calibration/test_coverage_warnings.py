"""What a calibration's recordings do not cover is said."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from insole_daemon.calibration.coverage_warnings import coverage_warnings, ramp_speeds_pa_s


def triangle_wave(speeds_pa_s, top_pa=90e3, step_s=0.02):
    """(t_s, pressure_pa) of one cycle up and down at each speed."""
    pressure = []
    for speed_pa_s in speeds_pa_s:
        ramp = np.arange(0.0, top_pa, speed_pa_s * step_s)
        pressure += [ramp, ramp[::-1]]
    pressure_pa = np.concatenate(pressure)
    return np.arange(len(pressure_pa)) * step_s, pressure_pa


def samples_of(kind, t_s, values):
    readings = SimpleNamespace(t_s=t_s, values=values[:, None])
    return SimpleNamespace(trial=SimpleNamespace(kind=kind, readings=readings))


def test_the_speed_of_every_ramp():
    speeds = ramp_speeds_pa_s(*triangle_wave([3e3, 12e3]))
    assert speeds == pytest.approx([3e3, 3e3, 12e3, 12e3], rel=0.02)


@pytest.mark.parametrize(
    ("speeds", "kinds", "known_pa", "n_left_out", "beginnings"),
    [
        ([3e3, 12e3], ["chamber"], 400e3, 0, []),
        ([3e3], ["chamber"], 400e3, 0, ["the pressure changes at one speed only, 3 kPa/s"]),
        ([3e3], ["chamber", "shoe"], 400e3, 0, []),
        ([3e3, 12e3], ["chamber"], 90e3, 0, ["the curves are known up to 90 kPa"]),
        ([3e3, 12e3], ["chamber", "shoe"], 400e3, 60, ["60 of 280 taxels have no curve"]),
    ],
)
def test_only_uncovered_loads_are_warned_about(speeds, kinds, known_pa, n_left_out, beginnings):
    t_s, pressure_pa = triangle_wave(speeds)
    samples = [samples_of(kind, t_s, pressure_pa) for kind in kinds]
    warnings = coverage_warnings(samples, np.full(280 - n_left_out, known_pa), n_left_out)
    assert len(warnings) == len(beginnings)
    assert all(text.startswith(start) for text, start in zip(warnings, beginnings, strict=True))
