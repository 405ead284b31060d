"""Bounds of coefficients: of companions of a memory, and of effects that can be undone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insole_daemon.diagnosis.model.regression import PlacedTerm
from insole_daemon.diagnosis.model.solve import solve_shares
from insole_daemon.diagnosis.terms import viscoelasticity
from insole_daemon.physics.effect import Where
from insole_daemon.physics.law import MOST_SHARED


def design(memory: float, gain: float, load_is_known: bool = False) -> tuple[Any, PlacedTerm]:
    """Return columns of a memory and a gain, nearly orthogonal, and a residual with these coefficients."""
    x = np.random.default_rng(1).normal(size=(4000, 3))
    y = x @ np.array([memory, 0.0, gain])
    candidate = PlacedTerm(
        viscoelasticity.TERM, Where(), ({"tau_s": 0.1}, {"tau_s": 0.3}), np.array([0, 1]), 1, np.array([2]),
        companion_words=("gain",), companion_std=(viscoelasticity.TERM.absorbs["gain"],),
    )  # fmt: skip
    return SimpleNamespace(gram=x.T @ x, cross=x.T @ y, load=SimpleNamespace(is_known=load_is_known)), candidate


def test_a_gain_beside_no_memory_is_not_absorbed():
    regression, candidate = design(0.01, 0.5)
    _, explained = solve_shares(regression, [candidate])
    assert explained < 0.1 * 4000 * 0.5**2


def test_a_gain_as_large_as_a_part_of_the_memory_is_absorbed():
    regression, candidate = design(0.4, -0.1)
    shares, explained = solve_shares(regression, [candidate])
    assert shares[0].sum() == pytest.approx(0.4, abs=0.02)
    assert explained > 0.95 * 4000 * (0.4**2 + 0.1**2)


def test_companions_at_their_bounds_are_fitted_together():
    """Three nearly equal columns whose coefficients are twice their prior: holding one spoils the others."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(4000, 4))
    x[:, 1:] = 0.99 * rng.normal(size=(4000, 1)) + np.sqrt(1.0 - 0.99**2) * x[:, 1:]
    y = x @ np.array([0.3, 0.6, -0.6, 0.6])
    candidate = PlacedTerm(
        viscoelasticity.TERM, Where(), ({"tau_s": 0.1},), np.array([0]), 1, np.array([1, 2, 3]),
        companion_words=("gain",) * 3, companion_std=(0.5,) * 3,
    )  # fmt: skip
    regression: Any = SimpleNamespace(gram=x.T @ x, cross=x.T @ y, load=SimpleNamespace(is_known=False))
    _, explained = solve_shares(regression, [candidate])
    assert explained > 0.95 * y @ y


@pytest.mark.parametrize(("load_is_known", "expected"), [(True, MOST_SHARED), (False, 1.4)])
def test_of_a_known_load_some_is_always_read_at_once(load_is_known, expected):
    regression, candidate = design(1.4, 0.0, load_is_known)
    shares, _ = solve_shares(regression, [candidate])
    assert shares[0].sum() == pytest.approx(expected, rel=0.02)
    assert (shares[0] >= 0).all()
