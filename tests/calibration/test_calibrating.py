"""Recordings of a simulated insole are calibrated to its true curves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from small_insole import LAYOUT, OFFSET_S, RATE

import insole_daemon
from insole_daemon.calibration import document
from insole_daemon.calibration.calibrating import Calibrated, calibrate, curve_pa
from insole_daemon.physics import calibration as calibrations
from insole_daemon.simulation.trial import START_NS


@pytest.fixture(scope="module")
def fused(chamber: Path, tasks: dict[str, Path]) -> Calibrated:
    recordings = [insole_daemon.load(folder) for folder in (chamber, *(tasks[name] for name in ("t1", "t2", "t3")))]
    return calibrate(recordings, "left")


def true_pa(folder: Path, slots: np.ndarray, activation: np.ndarray) -> np.ndarray:
    true = insole_daemon.load(folder)["left"].calibration
    assert true is not None
    return curve_pa(true.coefficients_pa.reshape(-1, true.coefficients_pa.shape[-1])[slots], activation)


def test_every_taxel_has_its_own_curve(fused: Calibrated, chamber: Path) -> None:
    assert len(fused.slots) == 10 * len(LAYOUT)
    assert not fused.left_out
    assert {verdict.word for verdict in fused.verdicts.values()} == {"healthy"}
    at = np.full((1, len(fused.slots)), 8.0)
    fitted_pa, true = curve_pa(fused.fit.coefficients_pa, at)[0], true_pa(chamber, fused.slots, at)[0]
    assert np.std(true) > 5e3, "else one curve for all would do"
    assert np.sqrt(np.mean((fitted_pa - true) ** 2)) < 2e3


def test_curves_are_zero_at_rest_and_never_fall(fused: Calibrated) -> None:
    assert np.all(fused.fit.coefficients_pa[:, 0] == 0)
    assert fused.fit.solution.kkt <= 1e-6
    grid = np.linspace(0, fused.highest_count.max(), 200)[:, None]
    curves = curve_pa(fused.fit.coefficients_pa, np.tile(grid, (1, len(fused.slots))))
    # Between the points at which slopes are limited one may fall by next to nothing.
    assert np.diff(curves, axis=0).min() > -1e-3 * curves.max()


def test_the_clock_is_part_of_the_fit(fused: Calibrated) -> None:
    for trial_samples in fused.samples:
        middle_s = float(trial_samples.trial.t_s[-1]) / 2
        began_s = float(trial_samples.trial.foot.t_ns[0]) * 1e-9 - START_NS * 1e-9
        true_s = OFFSET_S + (1 + RATE) * (middle_s + began_s) - began_s
        assert float(trial_samples.clock.reference_s(np.array([middle_s]))[0]) == pytest.approx(true_s, abs=0.03)
    assert fused.samples[0].clock.rate == pytest.approx(RATE, abs=5e-4)


def test_curve_errors_match_the_stated_uncertainty(fused: Calibrated, chamber: Path) -> None:
    a = 8.0
    fitted_pa = curve_pa(fused.fit.coefficients_pa, np.full((1, len(fused.slots)), a))[0]
    error = fitted_pa - true_pa(chamber, fused.slots, np.full((1, len(fused.slots)), a))[0]
    p = a ** np.arange(fused.fit.coefficients_pa.shape[1])
    std = np.sqrt(np.einsum("mij,i,j->m", fused.fit.covariance_pa2, p, p))
    spread = error - np.median(error)  # what all share is drift, and of the instruments
    assert 0.3 < np.sqrt(np.mean((spread / std) ** 2)) < 3.0


def test_the_daemon_reads_the_saved_file(fused: Calibrated, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    document.save_calibration(fused, path)
    read = calibrations.load(path, fused.layout)
    assert read.usable.sum() == len(fused.slots)
    assert read.covariance_pa2 is not None
    assert read.highest_count is not None
    loaded_pa = read.coefficients_pa.reshape(-1, read.coefficients_pa.shape[-1])[fused.slots]
    assert np.allclose(loaded_pa, fused.fit.coefficients_pa, rtol=1e-9)
    document_in_file = json.loads(path.read_text())
    assert document_in_file["provenance"]["recordings"][0]["clock"]["offset_std_s"] > 0
    assert document_in_file["extensions"]["verdict"] == document_in_file["extensions"]["left_out"] == []
    assert set(document_in_file["extensions"]["wrench_residual_std"]) == {"f_z_n", "m_x_nm", "m_y_nm"}


def test_a_chamber_alone_states_the_source_of_the_area(chamber: Path) -> None:
    calibrated = calibrate([insole_daemon.load(chamber)], "left")
    assert np.isnan(calibrated.fit.residual_wrench).all()
    assert "nothing has checked it" in document.provenance(calibrated)["area_from"]


def test_a_shoe_alone_calibrates_the_pressed_taxels(tasks: dict[str, Path]) -> None:
    calibrated = calibrate([insole_daemon.load(tasks[name]) for name in ("t1", "t2", "t3")], "left")
    assert np.isnan(calibrated.fit.residual_pa).all()
    assert calibrated.fit.residual_wrench[0] < 20


def test_the_published_method_gives_the_published_weights(chamber: Path, tasks: dict[str, Path]) -> None:
    recordings = [insole_daemon.load(folder) for folder in (chamber, tasks["t1"], tasks["t3"])]
    calibrated = calibrate(recordings, "left", "paper")
    assert calibrated.fit.degree == 3
    assert np.abs(calibrated.fit.coefficients_pa[:, 0]).max() > 0, "it has a constant"
    # The minimum is that of the raw problem: its gradient in raw counts vanishes.
    assert calibrated.fit.solution.kkt < 1e-8
    assert calibrated.fit.residual_wrench[0] < 20
