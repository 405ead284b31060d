"""What a model takes over of an explanation: what holds for loads it has not seen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import insole_daemon
from insole_daemon.diagnosis import modelling
from insole_daemon.diagnosis.diagnosing import diagnose
from insole_daemon.diagnosis.modelling import N_LOADS, Curves
from insole_daemon.diagnosis.prediction import counts
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics.chain import Chain

from .chamber import LAYOUT, SLOTS, Array, write


def test_what_nothing_explains_leaves_the_static_curves_as_they_are_and_the_clock(tmp_path: Path) -> None:
    def humming(t_s: Array, counts: Array) -> None:
        counts += 9.0 * np.sin(2 * np.pi * t_s / 3.7)[:, None]

    plain = insole_daemon.load(write(tmp_path / "plain", clock="own"))
    recording = insole_daemon.load(write(tmp_path / "hum", touch=humming, clock="own"))
    diagnosis = diagnose([recording], None, None, lambda text: None)
    assert "unknown" in {each.effect for each in diagnosis.findings}
    assert diagnosis.model["effects"] == []
    model = tmp_path / "model.json"
    model.write_text(json.dumps(diagnosis.model))
    off = (plain["left"].counts - counts(model, plain)["left"]).reshape(-1, len(LAYOUT) * 12)[:, SLOTS]
    assert np.sqrt(np.mean(off**2)) < 1.6  # 1.08 is noise and rounding


def test_a_curve_with_a_knee_is_written_as_nearly_as_it_is_read(tmp_path: Path) -> None:
    load_pa = np.linspace(-1e3, 300e3, N_LOADS)
    reads = 4e-4 * np.where(load_pa < 180e3, load_pa, 180e3 + 0.35 * (load_pa - 180e3))
    curves = Curves(SLOTS, load_pa, np.tile(reads - 240.0, (len(SLOTS), 1)))
    model = tmp_path / "model.json"
    model.write_text(json.dumps(modelling.document("left", LAYOUT, [curves], [], {})))
    run = Chain((), LAYOUT, calibrations.load(model, LAYOUT), []).forward()
    load = np.broadcast_to(load_pa[:, None, None], (N_LOADS, len(LAYOUT), 12))
    said = run(load, np.arange(N_LOADS) * 0.02, None).reshape(N_LOADS, -1)[:, SLOTS[0]]
    assert np.sqrt(np.mean((240.0 - reads - said) ** 2)) < 0.4
