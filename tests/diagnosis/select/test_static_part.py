"""Static effects beside a memory whose mean curve the calibration may contain."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from insole_daemon.diagnosis.select import static_part
from insole_daemon.diagnosis.select.count_errors import ErrorByLoad
from insole_daemon.skin import layout as layouts

LOAD_PA = np.linspace(10e3, 300e3, 23)
ACTIVATION_COUNT = 1.6e-4 * LOAD_PA
MEMORY_COUNT = 8.0 * (0.4 - LOAD_PA / 300e3)
REFINED = SimpleNamespace(design=SimpleNamespace(seen=SimpleNamespace(layout=layouts.builtin("left", (5, 6, 7)))))


def found(monkeypatch, after_count):
    """Return the static effect of the insole in curves with the mean errors `after_count`."""
    rough = after_count + 0.1 * np.random.default_rng(0).standard_normal(len(LOAD_PA))
    error = ErrorByLoad(np.full(len(LOAD_PA), 1e4), LOAD_PA, ACTIVATION_COUNT, rough, MEMORY_COUNT, 1.0)
    monkeypatch.setattr(static_part, "errors_by_load", lambda refined, places: [error])
    return static_part.static_part(REFINED)


def test_a_gain_that_the_quick_response_or_a_temperature_leaves_is_no_static_effect(monkeypatch):
    assert found(monkeypatch, 0.5 * MEMORY_COUNT - 0.25 * ACTIVATION_COUNT + 1.5) is None


def test_a_stiffening_beside_them_is_one(monkeypatch):
    over_pa = np.maximum(LOAD_PA - 100e3, 0.0)
    less_count = 1.6e-4 * (over_pa - over_pa * 120e3 / (120e3 + over_pa))
    part = found(monkeypatch, 0.5 * MEMORY_COUNT - 0.1 * ACTIVATION_COUNT + less_count)
    assert part is not None
    assert part.word == "stiffening"


def test_of_equal_descriptions_the_smallest_stiffening_is_taken(monkeypatch):
    """On a curve that saturates, one from a lower load on with a gain against it leaves hardly less."""
    activation_count = 80.0 * (1.0 - np.exp(-LOAD_PA / 150e3))
    monkeypatch.setattr(f"{__name__}.ACTIVATION_COUNT", activation_count)
    over_pa = np.maximum(LOAD_PA - 160e3, 0.0)
    felt_pa = LOAD_PA - over_pa + over_pa * 190e3 / (190e3 + over_pa)
    less_count = activation_count - np.interp(felt_pa, LOAD_PA, activation_count)
    part = found(monkeypatch, less_count)
    assert part is not None
    assert part.square == pytest.approx(np.mean(less_count**2), rel=0.2)
