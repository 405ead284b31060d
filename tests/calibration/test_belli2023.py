"""The published chamber data: clock, reproduction of the published model, and comparison with ours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.published_data import calibration

ROOT = Path(__file__).parents[2]
FOLDER = ROOT.parent / "shared" / "data" / "belli2023"

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not FOLDER.exists(), reason=f"the whole published files are not in {FOLDER}"),
]


def test_our_model_beats_the_published_one_on_its_training_data_and_can_be_saved(tmp_path):
    trial = calibration.read(FOLDER / calibration.CALIBRATION)
    all_of = calibration.healthy(trial)
    assert 150 < len(all_of.taxels) < 250
    healthy_eighth = replace(all_of, taxels=all_of.taxels[::8])
    clock = calibration.fitted_clock(trial, all_of)
    # Told from the steps of the chamber one by one: −1.3 s at the beginning, +1.4 s after 460 s; smoothing is 0.2 s.
    assert clock.offset_s == pytest.approx(-1.5, abs=0.2)
    assert clock.rate == pytest.approx(0.0062, abs=0.0006)
    trained = calibration.by_clock(trial, healthy_eighth, clock)
    published_pa, known = calibration.published(FOLDER, healthy_eighth)
    models = calibration.models(trained, trial, healthy_eighth, 0.1, 1e-2, published_pa)
    rmse = {}
    for name, (estimate, zeroed) in models.items():
        rmse[name] = np.median(calibration.scored(estimate(trained), trained, zeroed).rmse_pa[known])
    assert rmse["retrained"] == pytest.approx(rmse["published"], rel=0.1)  # the same model, trained by our own code
    assert rmse["ours, zeroed"] < 0.7 * rmse["plain cubic, zeroed"]
    assert rmse["ours, zeroed"] < 0.7 * rmse["published"]
    calibration.write_calibration(tmp_path / "calibration.json", models["ours, zeroed"][0].calibration, trial.layout)
    assert (tmp_path / "calibration.json").stat().st_size > 1000
