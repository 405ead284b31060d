"""The size of a memory at triangles of which little is known."""

from __future__ import annotations

import numpy as np

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.select.amplitude import amplitude_fraction

from ..chamber import bouc_wen, write


def test_a_triangle_with_half_the_readings_of_others_has_an_amplitude(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", bouc_wen(0.4, 60e3), seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    weights = seen.weight_variance**-0.5
    weights[::2, 0] = 0.0
    design = block_design(KnownLoad(seen), weights)
    chosen = next(
        k for k, c in enumerate(design.candidates)
        if c.word == "hysteresis" and c.where.scope == "triangle" and design.mask[c.columns[0]][0]
    )  # fmt: skip
    found = amplitude_fraction(refine(design, (chosen,)), 0)
    assert np.isfinite(found.value)
    assert found.value > 0.0
