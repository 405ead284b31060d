"""The figures of `validate` are compared with figures computed by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_insole import LAYOUT
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.calibration import validation
from insole_daemon.calibration.validation import ChamberResult, ShoeResult, validate
from insole_daemon.calibration.validation_report import validation_page
from insole_daemon.cli import app
from insole_daemon.errors import CalibrationError
from insole_daemon.physics.calibration import Calibration
from insole_daemon.physics.effect import effect


@pytest.fixture(scope="module")
def true(chamber: Path) -> Calibration:
    """Return the true curves of the simulated insole."""
    calibration = insole_daemon.load(chamber)["left"].calibration
    assert calibration is not None
    return calibration


def test_the_true_calibration_has_errors_of_noise_only(true: Calibration, tasks: dict[str, Path]) -> None:
    (walk,), _ = validate([insole_daemon.load(tasks["t4"])], true)
    outcome = walk.outcome
    assert isinstance(outcome, ShoeResult)
    assert outcome.f_z.rmse < 20
    assert outcome.f_z.accuracy > 93
    assert outcome.cop_x.rmse < 0.01
    assert outcome.cop_x.accuracy > 95, "an accuracy of 95 % and an RMSE of mm go together"
    assert np.isnan(outcome.steady_rmse_n), "nobody stands still while walking"


def test_figures_follow_their_definitions(true: Calibration, tasks: dict[str, Path]) -> None:
    (stand,), _ = validate([insole_daemon.load(tasks["t2"])], true)
    outcome = stand.outcome
    assert isinstance(outcome, ShoeResult)
    has_reference = np.isfinite(stand.reference).all(axis=1)
    error, reference = (stand.estimate - stand.reference)[has_reference], stand.reference[has_reference]
    assert outcome.f_z.rmse == pytest.approx(float(np.sqrt(np.mean(error[:, 0] ** 2))))
    assert outcome.m_y.accuracy == pytest.approx(
        float(100 - 100 * np.abs(error[:, 2]).sum() / np.abs(reference[:, 2]).sum())
    )
    assert outcome.steady > 0.5
    assert outcome.steady_rmse_n < outcome.f_z.rmse * 1.5


def test_a_wrong_gain_increases_the_error(true: Calibration, tasks: dict[str, Path], chamber: Path) -> None:
    wrong = replace(true, coefficients_pa=true.coefficients_pa * 1.2)
    recordings = [insole_daemon.load(tasks["t2"]), insole_daemon.load(chamber)]
    stand, bag = (result.outcome for result in validate(recordings, wrong)[0])
    assert isinstance(stand, ShoeResult)
    assert stand.f_z.accuracy == pytest.approx(80, abs=3)
    assert isinstance(bag, ChamberResult)
    assert np.median(bag.mean_error_pa) > 4e3


def test_chamber_results_list_good_taxels(true: Calibration, chamber: Path) -> None:
    (bag,), _ = validate([insole_daemon.load(chamber)], true)
    outcome = bag.outcome
    assert isinstance(outcome, ChamberResult)
    assert outcome.rmse_pa.shape == (10 * len(LAYOUT),)
    assert 5e3 < np.median(outcome.rmse_pa) < 12e3, "a count of noise is 8 kPa"
    assert outcome.good.mean() > 0.5


def test_the_command_writes_all_figures(chamber: Path, tasks: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "validation.json"
    calibration = next(tasks["t4"].glob("*calibration.json"))
    done = CliRunner().invoke(
        app, ["validate", str(tasks["t4"]), str(chamber), "--calibration", str(calibration), "--json", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert "t4" in done.stdout
    document = json.loads(out.read_text())
    assert document["format"] == validation.FORMAT
    shoe, bag = document["recordings"]
    assert set(shoe["f_z"]) == {"rmse_n", "accuracy"}
    assert shoe["steady"]["f_z_rmse_n"] is None
    assert bag["taxels"]["good"] <= bag["taxels"]["judged"] == 10 * len(LAYOUT)
    assert "contradicts" in document["definitions"]["cop"]


def test_the_calibration_of_the_other_foot_is_refused(tasks: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "right.json"
    text = next(tasks["t4"].glob("*calibration.json")).read_text()
    path.write_text(text.replace('"foot": "left"', '"foot": "right"'))
    done = CliRunner().invoke(app, ["validate", str(tasks["t4"]), "--calibration", str(path)])
    assert isinstance(done.exception, CalibrationError)
    assert "of the right foot, which none of the recordings has" in str(done.exception)


def test_a_calibration_with_effects_is_evaluated_with_both_models(true: Calibration, tasks: dict[str, Path]) -> None:
    late = replace(true, effects=(effect("viscoelasticity", a=0.3, tau_s=0.3),))
    walk = [insole_daemon.load(tasks["t4"])]
    (alone,), _ = validate(walk, true)
    (static, dynamic), _ = validate(walk, late)
    assert [static.model, dynamic.model, alone.model] == ["static", "dynamic", None]
    np.testing.assert_allclose(static.estimate, alone.estimate)
    assert isinstance(static.outcome, ShoeResult)
    assert isinstance(dynamic.outcome, ShoeResult)
    assert dynamic.outcome.f_z.rmse > 2 * static.outcome.f_z.rmse, "the walk was without"
    page = validation_page([static, dynamic], late, "late.json")
    assert "A heel strike, before and after" in page
    assert validation_page([alone], true, "true.json").count("heel strike") == 0
    entries = validation.validation_document([static, dynamic], "late.json")["recordings"]
    assert [(entry["name"], entry["model"]) for entry in entries] == [("t4", "static"), ("t4", "dynamic")]
