"""Operators on whole signals, against the equations they solve."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.operators import frictions

WAYS_PA = np.cumsum([0.0, 80e3, -30e3, 10e3, 90e3, -150e3, 5e3])
FINE = 20_000


@pytest.mark.parametrize("width_pa", [5e3, 60e3, 400e3])
def test_friction_is_dahls(width_pa):
    """Against small steps of dz = (1 − sgn(dx)·z/s)·dx."""
    (found,) = frictions(WAYS_PA[:, None], np.array([width_pa]))
    z, expected = 0.0, [0.0]
    for way in np.diff(WAYS_PA):
        for _ in range(FINE):
            z += (1.0 - np.sign(way) * z / width_pa) * way / FINE
        expected.append(z)
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-3 * width_pa)
    assert np.abs(found).max() <= width_pa
