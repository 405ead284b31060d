"""The course of the temperature by the thermal pads, of which many readings may be at an end of their range."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.pad_temperature import pad_course
from insole_daemon.diagnosis.observing import observed
from insole_daemon.recording.loading import load
from insole_daemon.skin.geometry import PRESSURE_TAXELS

from .. import chamber

PADS = np.flatnonzero(~np.tile(PRESSURE_TAXELS, len(chamber.LAYOUT)))
MOST_COUNT = 2.0  # range of the course


@pytest.mark.parametrize("end", [0.0, 255.0])
def test_pads_at_an_end_of_their_range_show_the_course_of_the_temperature(tmp_path, end):
    levels = np.random.default_rng(1).uniform(-0.8, 0.8, len(PADS))  # counts from the end: as often beyond as not
    rng = np.random.default_rng(2)

    def course_at(t_s):
        return MOST_COUNT * np.sin(np.pi * t_s / 60.0)

    def cut_off(t_s, counts):
        counts[:, PADS] = end + levels + course_at(t_s)[:, None] * (1.0 if end == 0.0 else -1.0)
        counts[:, PADS] += rng.normal(0.0, 1.0, (len(t_s), len(PADS)))

    folder = chamber.write(tmp_path / "bag", touch=cut_off, seconds=60.0, temperature=None)
    recording = load(folder)
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, ())
    course = pad_course(seen, ())
    assert course is not None
    expected = course_at(seen.t_s)
    assert abs(np.corrcoef(course, expected)[0, 1]) > 0.95
    assert abs(np.polyfit(expected, course, 1)[0]) == pytest.approx(1.0, abs=0.15)
