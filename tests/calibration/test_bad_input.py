"""Common mistakes in recordings are refused with a helpful message, and leave no file."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from small_insole import LAYOUT, made
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.calibration.calibrating import calibrate
from insole_daemon.calibration.trials import prepare_trials
from insole_daemon.cli import app
from insole_daemon.errors import CalibrationError
from insole_daemon.simulation.conditions import ChamberCycles
from insole_daemon.simulation.faults import InjectedFault

from .conftest import Edit

Row = dict[str, str]


def refusal(*folders: Path) -> str:
    with pytest.raises(CalibrationError) as caught:
        calibrate([insole_daemon.load(folder) for folder in folders], "left")
    return str(caught.value)


def with_changed(rows: list[Row], name: str, change: object) -> list[Row]:
    return [{**row, name: repr(change(float(row[name])))} for row in rows]  # type: ignore[operator]


def test_a_reference_in_bar_is_refused(chamber: Path, edited: Edit) -> None:
    message = refusal(edited(chamber, lambda rows: with_changed(rows, "pressure_pa", lambda p: p * 1e-5)))
    assert message.startswith("vacuum: expected pressure_pa to change by about")
    assert "is that bar? Convert it" in message


def about_the_recording(calibrated) -> tuple[str, ...]:
    """Return the remarks but those about what one chamber trial of one speed cannot cover."""
    coverage = [
        remark for remark in calibrated.remarks if remark.startswith(("the pressure changes", "the curves are"))
    ]
    assert len(coverage) == 2
    return tuple(remark for remark in calibrated.remarks if remark not in coverage)


def test_a_force_in_kilonewtons_is_refused(tasks: dict[str, Path], edited: Edit) -> None:
    message = refusal(edited(tasks["t3"], lambda rows: with_changed(rows, "fz_n", lambda f: f * 1e-3)))
    assert "t3: expected fz_n to change by about" in message
    assert "kN" in message


def test_a_reference_that_is_all_zero_is_refused(chamber: Path, edited: Edit) -> None:
    message = refusal(edited(chamber, lambda rows: with_changed(rows, "pressure_pa", lambda p: 0.0)))
    assert "vacuum: expected a reference that moves with the load" in message
    assert "was the instrument switched on" in message


def test_a_reference_shorter_than_the_counts(chamber: Path, edited: Edit) -> None:
    shorter = edited(chamber, lambda rows: rows[: round(len(rows) * 0.7)])
    calibrated = calibrate([insole_daemon.load(shorter)], "left")
    assert about_the_recording(calibrated) == (
        "vacuum: the reference covers 70% of the cycles; the others are left out",
    )
    assert calibrated.samples[0].t_s[-1] < 0.72 * calibrated.samples[0].trial.t_s[-1]


def test_a_reference_much_shorter_than_the_counts(chamber: Path, edited: Edit) -> None:
    message = refusal(edited(chamber, lambda rows: rows[: round(len(rows) * 0.3)]))
    assert message.startswith("vacuum: ")
    assert "of the time of the taxels" in message


def test_a_reference_longer_than_the_counts(chamber: Path, edited: Edit) -> None:
    def longer(rows: list[Row]) -> list[Row]:
        step, last = 0.02, float(rows[-1]["time_s"])
        return rows + [{**rows[-1], "time_s": f"{last + step * (n + 1):.6f}"} for n in range(1500)]

    calibrated = calibrate([insole_daemon.load(edited(chamber, longer))], "left")
    assert not calibrated.left_out
    assert about_the_recording(calibrated) == ()


def test_spikes_are_ignored_and_reported(chamber: Path, edited: Edit) -> None:
    def spiky(rows: list[Row]) -> list[Row]:
        return [{**row, "pressure_pa": "900000"} if n % 400 == 100 else row for n, row in enumerate(rows)]

    plain = calibrate([insole_daemon.load(chamber)], "left")
    calibrated = calibrate([insole_daemon.load(edited(chamber, spiky))], "left")
    n = len(range(100, len(plain.samples[0].trial.readings.values), 400))
    assert about_the_recording(calibrated) == (
        f"vacuum: {n} readings of the reference deviate from their neighbours: ignored as spikes",
    )
    assert np.allclose(calibrated.fit.residual_pa, plain.fit.residual_pa, rtol=0.05)


def test_the_reference_of_the_other_foot_is_refused(tasks: dict[str, Path], edited: Edit) -> None:
    """Standing on one foot unloads the other, so its reference falls when this foot's load rises."""

    def other(rows: list[Row]) -> list[Row]:
        most = max(float(row["fz_n"]) for row in rows)
        return [{**row, "fz_n": repr(most - float(row["fz_n"])), "mx_nm": repr(-float(row["mx_nm"]))} for row in rows]

    message = refusal(edited(tasks["t3"], other))
    assert "t3: the force of the reference does not grow with what the left insole reads" in message
    assert "is it that of the other foot?" in message


def test_moments_about_other_axes_are_refused(tasks: dict[str, Path], edited: Edit) -> None:
    message = refusal(edited(tasks["t3"], lambda rows: with_changed(rows, "my_nm", lambda m: -m)))
    assert "t3: the sign of the reference's m_y is opposite to what the left insole reads" in message
    assert "x forward, y to the wearer's left, z up" in message


@pytest.mark.parametrize(("setting", "value"), [("shift", 2), ("no_load", 200)])
def test_recordings_with_other_settings_are_refused(
    setting: str, value: int, chamber: Path, tasks: dict[str, Path], tmp_path: Path
) -> None:
    copy = tmp_path / "t1"
    shutil.copytree(tasks["t1"], copy)
    path = copy / "recording.yaml"
    before = {"shift": "shift: 3", "no_load": "no_load: 240"}[setting]
    path.write_text(path.read_text().replace(before, f"{setting}: {value}", 1))
    message = refusal(chamber, copy)
    assert f"vacuum and t1: expected one {setting} of board 5" in message
    assert "calibrate each setting separately" in message


def test_a_taxel_that_is_constant_throughout(tmp_path: Path) -> None:
    dead = InjectedFault("dead", 0.0, None, LAYOUT.triangles[0].board, LAYOUT.triangles[0].triangle, 1)
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=2, hold_s=5.0, minor=())
    folder = made(tmp_path / "vacuum", "vacuum", chamber=cycles, faults=(dead,))
    calibrated = calibrate([insole_daemon.load(folder)], "left")
    assert list(calibrated.left_out) == [1]
    assert calibrated.left_out[1].startswith("dead: ")
    assert calibrated.verdicts[1].word == "dead"
    assert calibrated.verdicts[1].detail.startswith("reads 2")


def test_a_taxel_that_gets_stuck_is_used_until_then(tmp_path: Path) -> None:
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=3, hold_s=5.0, minor=())
    stuck = InjectedFault(
        "stuck", 70.0, None, LAYOUT.triangles[0].board, LAYOUT.triangles[0].triangle, 1, level_pa=60e3
    )
    folder = made(tmp_path / "vacuum", "vacuum", chamber=cycles, faults=(stuck,))
    calibrated = calibrate([insole_daemon.load(folder)], "left")
    verdict = calibrated.verdicts[1]
    assert verdict.word == "stuck"
    assert verdict.recording == "vacuum"
    assert verdict.since_s == pytest.approx(70.0, abs=3.0)
    assert 1 in calibrated.slots, "two good cycles are enough for a curve"


def test_a_triangle_that_comes_loose(tmp_path: Path) -> None:
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=3, hold_s=5.0, minor=())
    loose = InjectedFault("loose", 70.0, None, LAYOUT.triangles[2].board, LAYOUT.triangles[2].triangle)
    folder = made(tmp_path / "vacuum", "vacuum", chamber=cycles, faults=(loose,))
    calibrated = calibrate([insole_daemon.load(folder)], "left")
    slots = [24 + taxel for taxel in (0, 1, 2, 3, 4, 5, 7, 8, 9, 11)]
    assert {calibrated.verdicts[slot].word for slot in slots} == {"loose"}
    assert calibrated.verdicts[24].since_s == pytest.approx(70.0, abs=1.0)
    assert set(slots) <= set(calibrated.slots.tolist()), "what it said before is used"


def test_a_single_ramp_is_refused(tmp_path: Path) -> None:
    cycles = ChamberCycles(speeds_pa_s=(3e3,), cycles=1, hold_s=5.0, minor=())
    message = refusal(made(tmp_path / "ramp", "vacuum", 30.0, chamber=cycles))
    assert "ramp: expected the pressure to go up and down at least once, found one ramp" in message


def test_a_loaded_start_is_refused(chamber: Path, tmp_path: Path) -> None:
    copy = tmp_path / "late"
    shutil.copytree(chamber, copy)
    log = next(copy.glob("can.log"))
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(lines[len(lines) // 8 :]))
    message = refusal(copy)
    assert "late: expected no load at its start, on which it is zeroed" in message
    assert "record from before the load begins" in message


def test_too_short_a_shoe_trial_alone_is_refused(tmp_path: Path) -> None:
    message = refusal(made(tmp_path / "t1", "t1", 12.0))
    assert "numbers of the shoe for" in message
    assert "add a chamber trial, or longer slow movements" in message


def test_a_foot_that_was_not_recorded_is_refused(chamber: Path) -> None:
    with pytest.raises(CalibrationError, match="vacuum: expected the right foot with its reference, found left foot"):
        prepare_trials([insole_daemon.load(chamber)], "right")


def test_a_refused_calibration_writes_no_file(chamber: Path, edited: Edit, tmp_path: Path) -> None:
    bad = edited(chamber, lambda rows: with_changed(rows, "pressure_pa", lambda p: 0.0))
    out = tmp_path / "calibration.json"
    done = CliRunner().invoke(app, ["calibrate", str(bad), "--out", str(out)])
    assert isinstance(done.exception, CalibrationError)
    assert done.exception.exit_status == 4
    assert not out.exists()


def test_an_interrupted_calibration_keeps_the_old_file(
    chamber: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "calibration.json"
    out.write_text("before")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("insole_daemon.calibration.fused.fit_fused", interrupted)
    CliRunner().invoke(app, ["calibrate", str(chamber), "--out", str(out)])
    assert out.read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["calibration.json"]


def test_the_command_writes_calibration_and_report(chamber: Path, tmp_path: Path) -> None:
    out, report = tmp_path / "calibration.json", tmp_path / "calibration.html"
    done = CliRunner().invoke(app, ["calibrate", str(chamber), "--out", str(out), "--report", str(report)])
    assert done.exit_code == 0, done.output
    assert f"{10 * len(LAYOUT)} taxels, 0 left out" in done.output
    text = report.read_text()
    assert "Calibration of the left insole" in text
    assert text.count("<svg") >= 7
