"""The law of `hysteresis` whose inverse, from readings, is a sum of columns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from insole_daemon.diagnosis.operators import plays
from insole_daemon.diagnosis.terms.hysteresis import RADII_PA, TERM
from insole_daemon.physics.closing_plays import ClosingPlays
from insole_daemon.physics.law import MOST_SHARED, Moments

T_S = np.arange(0.0, 40.0, 0.02)
STEPS_PA = 250e3 * np.abs(np.sin(T_S))[:, None] ** 1.5  # (n, 1)
MOMENTS = Moments(T_S, np.full(len(T_S), 0.02), None)
RADII = np.array(RADII_PA)


def closing_plays(load_pa: np.ndarray, half_pa: float) -> np.ndarray:
    """Return the columns (n, k) of plays that close at zero."""
    return -plays(load_pa, RADII)[..., 0].T * load_pa / (load_pa + half_pa)


@pytest.mark.parametrize("weight", [0.2, 0.5])
def test_the_law_of_closing_plays_undoes_what_its_columns_describe(weight):
    half_pa = 250e3
    law = np.full((1, 1), 12e3), np.full((1, 1), weight), np.full((1, 1), half_pa)
    read_pa = ClosingPlays(*law)(STEPS_PA, MOMENTS)
    shares, _ = nnls(closing_plays(read_pa, half_pa), (STEPS_PA - read_pa)[:, 0])
    values = TERM.parameters([{"r_pa": radius, "half_pa": half_pa} for radius in RADII_PA], shares)
    found = (np.array(values[name])[:, None] for name in ("r_pa", "w", "half_pa"))
    undone = ClosingPlays(*found, is_inverse=True)(read_pa, MOMENTS)
    assert np.std(undone - STEPS_PA) < 0.2 * np.std(read_pa - STEPS_PA)


def test_weights_beyond_the_bound_of_the_law_become_wider_plays():
    half_pa = 250e3
    shares = np.array([0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0])
    values = TERM.parameters([{"r_pa": radius, "half_pa": half_pa} for radius in RADII_PA], shares)
    assert sum(values["w"]) == pytest.approx(MOST_SHARED)
    assert np.dot(values["w"], values["r_pa"]) == pytest.approx(9.0 * RADII_PA[2], rel=0.01)
