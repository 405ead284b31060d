"""Zero files: reading, problems, and atomic writing."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.errors import DocumentError
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics import zero as zeros
from insole_daemon.physics.zero import Zero
from insole_daemon.skin import layout as layouts

LEFT = layouts.builtin("left", (5, 6, 7))


def a_zero(seed: int = 1) -> Zero:
    baseline = np.random.default_rng(seed).normal(239, 3, (28, 12))
    baseline[:, [6, 10]] = np.nan
    baseline[3, 4] = np.nan
    return Zero("left", 1_700_000_000_000_000_000, baseline, np.where(np.isnan(baseline), np.nan, 0.9))


def test_a_saved_zero_loads_unchanged(tmp_path):
    path = tmp_path / "not" / "yet" / "zero.json"
    zeros.save(path, a_zero(), LEFT)
    back = zeros.load(path, LEFT)
    np.testing.assert_allclose(back.baseline_count, a_zero().baseline_count, atol=1e-4)
    np.testing.assert_allclose(back.noise_count, a_zero().noise_count, atol=1e-4)
    assert (back.foot, back.t_ns) == ("left", 1_700_000_000_000_000_000)
    assert os.listdir(path.parent) == ["zero.json"]
    assert len(json.loads(path.read_text())["taxels"]) == 279


def test_a_zero_replaces_only_baselines():
    boards = Config().insoles[0].boards
    calibration = calibrations.default(LEFT, boards)
    applied = zeros.apply(calibration, a_zero())
    assert applied.baseline_count[3, 4] == calibration.baseline_count[3, 4], "not in the zero: keeps its own"
    listed = ~np.isnan(a_zero().baseline_count)
    np.testing.assert_array_equal(applied.baseline_count[listed], a_zero().baseline_count[listed])
    assert applied.coefficients_pa is calibration.coefficients_pa
    assert applied.usable is calibration.usable


def test_all_problems_are_reported_together(tmp_path):
    path = tmp_path / "zero.json"
    good = {"board": 5, "triangle": 0, "taxel": 0, "baseline_count": 240.0, "noise_count": 0.9}
    taxels = [
        good,
        good,
        {**good, "taxel": 6},
        {**good, "triangle": 2},
        {**good, "taxel": 1, "baseline_count": float("nan")},
        {**good, "taxel": 2, "noise_count": -1},
        {**good, "taxel": 12},
        {**good, "taxel": 3, "count": 3},
    ]
    path.write_text(json.dumps({"format": "insole-zero/1", "foot": "right", "t_ns": 1, "taxels": taxels}))
    with pytest.raises(DocumentError) as refused:
        zeros.load(path, LEFT)
    text = str(refused.value)
    for message in (
        "expected the zero of the left foot",
        "is listed twice, first in taxels[0]",
        "thermal pad",
        "triangle 2 of board 5 is not in the layout",
        "taxels[4].baseline_count: expected a finite number",
        "taxels[5].noise_count",
        "taxels[6].taxel",
        "unknown key",
    ):
        assert message in text


def test_a_failed_write_keeps_only_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "zero.json"
    zeros.save(path, a_zero(1), LEFT)
    before = path.read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        zeros.save(path, a_zero(2), LEFT)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["zero.json"]
