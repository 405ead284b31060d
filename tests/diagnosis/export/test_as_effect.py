"""Findings as effects of a model and of its file."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from insole_daemon.config import Config
from insole_daemon.diagnosis.export.as_effect import effect_of
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics import effects_document
from insole_daemon.physics.effect import Where
from insole_daemon.service.foot_setup import load_layout

LAYOUT = load_layout(Config().insoles[0])
SEEN = SimpleNamespace(pressure_pa=np.array([200e3]), layout=LAYOUT)


def test_a_model_with_swapped_triangles_can_be_read(tmp_path: Path) -> None:
    pair = tuple(tuple(each) for each in LAYOUT.identities[[3, 15]].tolist())
    found = effect_of("swapped_triangles", Where("triangle", pair), {}, SEEN)
    assert found is not None
    board, triangle = pair[0]
    taxel = {"board": board, "triangle": triangle, "taxel": 0, "baseline_count": 240.0, "coefficients_pa": [0.0, 7e3]}
    model = {"format": "insole-calibration/1", "foot": "left", "taxels": [taxel], "provenance": {}}
    (tmp_path / "model.json").write_text(json.dumps({**model, "effects": effects_document.document([found], LAYOUT)}))
    (read,) = calibrations.load(tmp_path / "model.json", LAYOUT).effects
    assert read.where.ids == pair
    np.testing.assert_array_equal(read.values["pair"], pair)
