"""The static part that a calibration absorbed of a memory is no larger than the memory."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insole_daemon.diagnosis.model.regression import PlacedTerm
from insole_daemon.diagnosis.model.solve import solve_shares
from insole_daemon.diagnosis.terms import viscoelasticity
from insole_daemon.physics.effect import Where


def design(memory: float, gain: float) -> tuple[Any, PlacedTerm]:
    """Columns of a memory and of a gain, nearly orthogonal, in a residual with these shares of them."""
    x = np.random.default_rng(1).normal(size=(4000, 3))
    y = x @ np.array([memory, 0.0, gain])
    candidate = PlacedTerm(
        viscoelasticity.TERM, Where(), ({"tau_s": 0.1}, {"tau_s": 0.3}), np.array([0, 1]), 1, np.array([2]),
        companion_words=("gain",), companion_std=(viscoelasticity.TERM.absorbs["gain"],),
    )  # fmt: skip
    return SimpleNamespace(gram=x.T @ x, cross=x.T @ y), candidate


def test_a_gain_beside_no_memory_is_not_absorbed():
    regression, candidate = design(0.01, 0.5)
    _, explained = solve_shares(regression, [candidate])
    assert explained < 0.1 * 4000 * 0.5**2


def test_a_gain_as_large_as_a_part_of_the_memory_is_absorbed():
    regression, candidate = design(0.4, -0.1)
    shares, explained = solve_shares(regression, [candidate])
    assert shares[0].sum() == pytest.approx(0.4, abs=0.02)
    assert explained > 0.95 * 4000 * (0.4**2 + 0.1**2)
