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
SATURATING_COUNT = 80.0 * (1.0 - np.exp(-LOAD_PA / 150e3))
MEMORY_COUNT = 8.0 * (0.4 - LOAD_PA / 300e3)
LAYOUT = layouts.builtin("left", (5, 6, 7))


def found(monkeypatch, after_count, words=("viscoelasticity",), of_boards=(1.0, 1.0, 1.0)):
    """Return the static effect of the insole in curves with the mean errors `after_count`, and whether they are off.

    `of_boards`: errors of the boards, relative to those of the insole.
    """
    rough = after_count + 0.01 * np.random.default_rng(0).standard_normal(len(LOAD_PA))
    errors = [
        ErrorByLoad(np.full(len(LOAD_PA), 1e4), LOAD_PA, ACTIVATION_COUNT, part * rough, MEMORY_COUNT, 1.0)
        for part in (1.0, *of_boards)
    ]
    monkeypatch.setattr(static_part, "errors_by_load", lambda refined, places: errors)
    terms = [SimpleNamespace(word=word) for word in words]
    seen, priors = SimpleNamespace(layout=LAYOUT), SimpleNamespace(has_loose_curves=False)
    return static_part.static_part(SimpleNamespace(design=SimpleNamespace(seen=seen, candidates=terms, priors=priors)))


def saturate(monkeypatch):
    monkeypatch.setattr(f"{__name__}.ACTIVATION_COUNT", SATURATING_COUNT)


def test_a_gain_that_the_quick_response_or_a_temperature_leaves_is_no_static_effect(monkeypatch):
    assert found(monkeypatch, 0.5 * MEMORY_COUNT - 0.25 * ACTIVATION_COUNT + 1.5) == (None, True)


def test_a_stiffening_beside_them_is_one(monkeypatch):
    over_pa = np.maximum(LOAD_PA - 100e3, 0.0)
    less_count = 1.6e-4 * (over_pa - over_pa * 120e3 / (120e3 + over_pa))
    part, is_off = found(monkeypatch, 0.5 * MEMORY_COUNT - 0.1 * ACTIVATION_COUNT + less_count)
    assert is_off
    assert part is not None
    assert part.word == "stiffening"


def test_of_equal_descriptions_the_smallest_stiffening_is_taken(monkeypatch):
    """On a curve that saturates, one from a lower load on with a gain against it leaves hardly less."""
    saturate(monkeypatch)
    over_pa = np.maximum(LOAD_PA - 160e3, 0.0)
    felt_pa = LOAD_PA - over_pa + over_pa * 190e3 / (190e3 + over_pa)
    less_count = SATURATING_COUNT - np.interp(felt_pa, LOAD_PA, SATURATING_COUNT)
    part, _ = found(monkeypatch, less_count)
    assert part is not None
    assert part.square == pytest.approx(np.mean(less_count**2), rel=0.2)


def test_a_loss_of_gain_beside_a_viscoelasticity_is_one(monkeypatch):
    """A calibration with another response of the material would read less than this recording, not more."""
    part, _ = found(monkeypatch, 0.5 * MEMORY_COUNT + 0.15 * ACTIVATION_COUNT)
    assert part is not None
    assert part.word == "gain"
    assert part.values["gain"] == pytest.approx(0.85, abs=0.01)


def test_beside_a_creep_a_gain_is_one_if_another_response_does_not_describe_it(monkeypatch):
    saturate(monkeypatch)
    part, _ = found(monkeypatch, 0.15 * SATURATING_COUNT, ("creep",))
    assert part is not None
    assert part.values["gain"] == pytest.approx(0.85, abs=0.01)


def test_a_creep_that_goes_on_after_the_recording_is_no_gain(monkeypatch):
    saturate(monkeypatch)
    less_count = 0.15 * LOAD_PA * np.gradient(SATURATING_COUNT, LOAD_PA)
    assert found(monkeypatch, less_count, ("creep",)) == (None, True)


def test_a_gain_beside_a_temperature_is_none(monkeypatch):
    """The temperature of the calibration is not known."""
    assert found(monkeypatch, 0.15 * ACTIVATION_COUNT, ("viscoelasticity", "temperature")) == (None, True)


def test_a_gain_that_one_board_does_not_show_is_none_of_the_insole(monkeypatch):
    assert found(monkeypatch, 0.15 * ACTIVATION_COUNT, of_boards=(1.5, 1.4, 0.1)) == (None, True)


def test_curves_that_contain_a_part_of_the_memory_are_not_off(monkeypatch):
    assert found(monkeypatch, 0.7 * MEMORY_COUNT) == (None, False)


@pytest.mark.parametrize("number", [0, 4])
def test_few_loads_show_no_static_effect(monkeypatch, number):
    for name in ("LOAD_PA", "ACTIVATION_COUNT", "MEMORY_COUNT"):
        monkeypatch.setattr(f"{__name__}.{name}", globals()[name][:number])
    assert found(monkeypatch, 0.3 * ACTIVATION_COUNT) == (None, False)


def test_a_stiffening_with_a_gain_against_it_is_none_if_the_curves_are_right(monkeypatch):
    """The misfit of a memory's law is bent, and small against the two."""
    bent_count = 1.2 * np.cos(np.pi * LOAD_PA / 300e3) ** 2
    assert found(monkeypatch, bent_count, ("hysteresis",)) == (None, False)
