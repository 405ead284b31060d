"""The package reads the files that the generator writes; the file formats are all that they share."""

import json

import numpy as np
import pytest

import insole_daemon


def test_every_folder_is_a_recording(generated):
    sealed = json.loads((generated.sealed / "truth.json").read_text())["cases"]
    for name, case in sealed.items():
        folders = [
            f for f in (generated.cases / name / "recording", generated.cases / name / "simulation") if f.is_dir()
        ]
        for folder in folders:
            recording = insole_daemon.load(folder)
            foot = recording[case["foot"]]
            assert foot.counts.shape[1:] == (28, 12)
            assert foot.calibration is not None
            assert foot.pressure_pa is not None
            if recording.kind == "chamber":
                assert foot.reference is not None
                highest = np.quantile(np.nanmedian(foot.pressure_pa, axis=(1, 2)), 0.999)
                assert highest == pytest.approx(case["span_pa"], rel=0.05)


def test_the_rows_kept_back_are_the_rows_that_are_read(generated):
    truth = json.loads((generated.sealed / "truth.json").read_text())["cases"]
    name = next(n for n, c in truth.items() if c["recording"] == "chamber")
    foot = insole_daemon.load(generated.sealed / name / "recording").feet[0]
    with np.load(generated.sealed / name / "scoring.npz") as scoring:
        assert len(foot) == len(scoring["untouched"])
