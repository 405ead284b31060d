"""Parameters of a selected set are refined without a bias by the noise of the readings."""

from __future__ import annotations

import numpy as np

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.observing import observed

from ..chamber import write


def test_a_gain_under_a_small_load_is_not_raised_by_the_noise_of_the_readings(tmp_path):
    folder = write(tmp_path / "bag", lambda t_s, p: 0.1 * 1.07 * p, reference=lambda t_s, p: 0.1 * p, seconds=20.0)
    recording = insole_daemon.load(folder)
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    design = block_design(KnownLoad(seen), seen.weight_variance**-0.5)
    chosen = next(k for k, c in enumerate(design.candidates) if c.word == "gain" and c.where.scope == "insole")
    refined = refine(design, (chosen,))
    np.testing.assert_allclose(refined.shares[0], 0.07, atol=0.006)  # standard deviation 0.0015; noise would add 0.02
