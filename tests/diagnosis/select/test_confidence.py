"""The stated probability of a finding."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from insole_daemon.diagnosis.finding import Finding
from insole_daemon.diagnosis.one_recording import _with_confidence
from insole_daemon.diagnosis.select.confidence import LEAST, MOST, confidence
from insole_daemon.physics.effect import Where


def test_confidence_rises_with_the_margin_and_falls_with_the_rest_and_the_number_of_findings():
    by_margin = [confidence(margin, 0.1, 2) for margin in (0.0, 0.5, 2.0, 10.0, 80.0)]
    by_rest = [confidence(10.0, rest, 1) for rest in (0.0, 0.05, 0.2, 0.6, 1.0)]
    by_number = [confidence(10.0, 0.1, n) for n in (1, 2, 3, 6)]
    assert all(low < high for low, high in pairwise(by_margin))
    assert all(high > low for high, low in pairwise(by_rest))
    assert all(high > low for high, low in pairwise(by_number))


@pytest.mark.parametrize("margin", [0.5, 5.0, 50.0])
def test_an_effect_of_single_triangles_is_less_certain_than_one_of_the_insole(margin):
    assert confidence(margin, 0.1, 2, of_triangles=True) < confidence(margin, 0.1, 2)


def test_no_finding_is_certain_and_none_impossible():
    assert confidence(1e9, 0.0, 1) <= MOST
    assert confidence(-1.0, 1.0, 9, of_triangles=True) >= LEAST


def test_an_unknown_is_less_certain_beside_other_findings():
    figures: Any = SimpleNamespace(residual_fraction=0.1)
    of_walk: dict[str, Any] = {"foot": "left", "where": Where(), "sentence": "", "recordings": ("walk",)}
    unknown, gain = Finding(effect="unknown", left=4.0, **of_walk), Finding(effect="gain", margin=10.0, **of_walk)
    fault = Finding(effect="dead_taxels", **of_walk)
    (alone,) = _with_confidence([unknown], figures)
    beside, _, of_fault = _with_confidence([unknown, gain, fault], figures)
    assert beside.confidence < 0.8 * alone.confidence
    assert of_fault.confidence == fault.confidence
