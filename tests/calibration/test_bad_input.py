"""What people get wrong with recordings, each with the words they get; and that no file is left then."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import Edit
from small_insole import LAYOUT, made
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.calibration.calibrating import calibrate
from insole_daemon.calibration.trials import trials
from insole_daemon.cli import app
from insole_daemon.errors import CalibrationError
from insole_daemon.simulation.conditions import ChamberCycles
from insole_daemon.simulation.faults import InjectedFault

Row = dict[str, str]


def refusal(*folders: Path) -> str:
    with pytest.raises(CalibrationError) as caught:
        calibrate([insole_daemon.load(folder) for folder in folders], "left")
    return str(caught.value)


def each(rows: list[Row], name: str, change: object) -> list[Row]:
    return [{**row, name: repr(change(float(row[name])))} for row in rows]  # type: ignore[operator]


def test_a_reference_in_bar(chamber: Path, edited: Edit) -> None:
    said = refusal(edited(chamber, lambda rows: each(rows, "pressure_pa", lambda p: p * 1e-5)))
    assert said.startswith("vacuum: expected pressure_pa to change by about")
    assert "is that bar? Convert it" in said


def about_the_recording(calibrated) -> tuple[str, ...]:
    """Return the remarks but those about what one chamber trial of one speed cannot cover."""
    coverage = [
        remark for remark in calibrated.remarks if remark.startswith(("the pressure changes", "the curves are"))
    ]
    assert len(coverage) == 2
    return tuple(remark for remark in calibrated.remarks if remark not in coverage)


def test_a_force_in_kilonewtons(tasks: dict[str, Path], edited: Edit) -> None:
    said = refusal(edited(tasks["t3"], lambda rows: each(rows, "fz_n", lambda f: f * 1e-3)))
    assert "t3: expected fz_n to change by about" in said
    assert "kN" in said


def test_a_reference_that_is_all_zero(chamber: Path, edited: Edit) -> None:
    said = refusal(edited(chamber, lambda rows: each(rows, "pressure_pa", lambda p: 0.0)))
    assert "vacuum: expected a reference that moves with the load" in said
    assert "was the instrument switched on" in said


def test_a_reference_shorter_than_the_counts(chamber: Path, edited: Edit) -> None:
    shorter = edited(chamber, lambda rows: rows[: round(len(rows) * 0.7)])
    found = calibrate([insole_daemon.load(shorter)], "left")
    assert about_the_recording(found) == ("vacuum: the reference covers 70% of the cycles; the others are left out",)
    assert found.samples[0].t_s[-1] < 0.72 * found.samples[0].trial.t_s[-1]


def test_a_reference_much_shorter_than_the_counts(chamber: Path, edited: Edit) -> None:
    said = refusal(edited(chamber, lambda rows: rows[: round(len(rows) * 0.3)]))
    assert said.startswith("vacuum: ")
    assert "of the time of the taxels" in said


def test_a_reference_longer_than_the_counts(chamber: Path, edited: Edit) -> None:
    def longer(rows: list[Row]) -> list[Row]:
        step, last = 0.02, float(rows[-1]["time_s"])
        return rows + [{**rows[-1], "time_s": f"{last + step * (n + 1):.6f}"} for n in range(1500)]

    found = calibrate([insole_daemon.load(edited(chamber, longer))], "left")
    assert not found.left_out
    assert about_the_recording(found) == ()


def test_spikes_are_left_out_and_said(chamber: Path, edited: Edit) -> None:
    def spiky(rows: list[Row]) -> list[Row]:
        return [{**row, "pressure_pa": "900000"} if n % 400 == 100 else row for n, row in enumerate(rows)]

    plain = calibrate([insole_daemon.load(chamber)], "left")
    found = calibrate([insole_daemon.load(edited(chamber, spiky))], "left")
    n = len(range(100, len(plain.samples[0].trial.readings.values), 400))
    assert about_the_recording(found) == (
        f"vacuum: {n} readings of the reference stand out of their neighbours: left out as spikes",
    )
    assert np.allclose(found.fit.residual_pa, plain.fit.residual_pa, rtol=0.05)


def test_the_reference_of_the_other_foot(tasks: dict[str, Path], edited: Edit) -> None:
    """Who stands on one foot lifts the other: its reference falls when this one's load grows."""

    def other(rows: list[Row]) -> list[Row]:
        most = max(float(row["fz_n"]) for row in rows)
        return [{**row, "fz_n": repr(most - float(row["fz_n"])), "mx_nm": repr(-float(row["mx_nm"]))} for row in rows]

    said = refusal(edited(tasks["t3"], other))
    assert "t3: the force of the reference does not grow with what the left insole reads" in said
    assert "is it that of the other foot?" in said


def test_moments_about_other_axes(tasks: dict[str, Path], edited: Edit) -> None:
    said = refusal(edited(tasks["t3"], lambda rows: each(rows, "my_nm", lambda m: -m)))
    assert "t3: m_y of the reference turn against what the left insole reads" in said
    assert "x forward, y to the wearer's left, z up" in said


@pytest.mark.parametrize(("setting", "value"), [("shift", 2), ("no_load", 200)])
def test_recordings_of_other_settings(
    setting: str, value: int, chamber: Path, tasks: dict[str, Path], tmp_path: Path
) -> None:
    copy = tmp_path / "t1"
    shutil.copytree(tasks["t1"], copy)
    path = copy / "recording.yaml"
    before = {"shift": "shift: 3", "no_load": "no_load: 240"}[setting]
    path.write_text(path.read_text().replace(before, f"{setting}: {value}", 1))
    said = refusal(chamber, copy)
    assert f"vacuum and t1: expected one {setting} of board 5" in said
    assert "calibrate each setting by itself" in said


def test_a_taxel_that_is_constant_throughout(tmp_path: Path) -> None:
    dead = InjectedFault("dead", 0.0, None, LAYOUT.triangles[0].board, LAYOUT.triangles[0].triangle, 1)
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=2, hold_s=5.0, minor=())
    folder = made(tmp_path / "vacuum", "vacuum", chamber=cycles, faults=(dead,))
    found = calibrate([insole_daemon.load(folder)], "left")
    assert list(found.left_out) == [1]
    assert found.left_out[1].startswith("dead: ")
    assert found.verdicts[1].word == "dead"
    assert found.verdicts[1].detail.startswith("reads 2")


def test_a_taxel_that_gets_stuck_is_used_until_then(tmp_path: Path) -> None:
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=3, hold_s=5.0, minor=())
    stuck = InjectedFault(
        "stuck", 70.0, None, LAYOUT.triangles[0].board, LAYOUT.triangles[0].triangle, 1, level_pa=60e3
    )
    folder = made(tmp_path / "vacuum", "vacuum", chamber=cycles, faults=(stuck,))
    found = calibrate([insole_daemon.load(folder)], "left")
    verdict = found.verdicts[1]
    assert verdict.word == "stuck"
    assert verdict.recording == "vacuum"
    assert verdict.since_s == pytest.approx(70.0, abs=3.0)
    assert 1 in found.slots, "two good cycles are enough for a curve"


def test_a_triangle_that_comes_loose(tmp_path: Path) -> None:
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=3, hold_s=5.0, minor=())
    loose = InjectedFault("loose", 70.0, None, LAYOUT.triangles[2].board, LAYOUT.triangles[2].triangle)
    folder = made(tmp_path / "vacuum", "vacuum", chamber=cycles, faults=(loose,))
    found = calibrate([insole_daemon.load(folder)], "left")
    slots = [24 + taxel for taxel in (0, 1, 2, 3, 4, 5, 7, 8, 9, 11)]
    assert {found.verdicts[slot].word for slot in slots} == {"loose"}
    assert found.verdicts[24].since_s == pytest.approx(70.0, abs=1.0)
    assert set(slots) <= set(found.slots.tolist()), "what it said before is used"


def test_one_ramp_only(tmp_path: Path) -> None:
    cycles = ChamberCycles(speeds_pa_s=(3e3,), cycles=1, hold_s=5.0, minor=())
    said = refusal(made(tmp_path / "ramp", "vacuum", 30.0, chamber=cycles))
    assert "ramp: expected the pressure to go up and down at least once, found one ramp" in said


def test_no_start_without_load(chamber: Path, tmp_path: Path) -> None:
    copy = tmp_path / "late"
    shutil.copytree(chamber, copy)
    log = next(copy.glob("can.log"))
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(lines[len(lines) // 8 :]))
    said = refusal(copy)
    assert "late: expected no load at its start, on which it is zeroed" in said
    assert "record from before the load begins" in said


def test_too_little_of_a_shoe_alone(tmp_path: Path) -> None:
    said = refusal(made(tmp_path / "t1", "t1", 12.0))
    assert "numbers of the shoe for" in said
    assert "add a chamber trial, or longer slow movements" in said


def test_a_foot_that_was_not_recorded(chamber: Path) -> None:
    with pytest.raises(CalibrationError, match="vacuum: expected the right foot with its reference, found left foot"):
        trials([insole_daemon.load(chamber)], "right")


def test_a_refused_calibration_leaves_no_file(chamber: Path, edited: Edit, tmp_path: Path) -> None:
    bad = edited(chamber, lambda rows: each(rows, "pressure_pa", lambda p: 0.0))
    out = tmp_path / "calibration.json"
    done = CliRunner().invoke(app, ["calibrate", str(bad), "--out", str(out)])
    assert isinstance(done.exception, CalibrationError)
    assert done.exception.exit_status == 4
    assert not out.exists()


def test_an_interrupted_calibration_leaves_the_file_that_was_there(
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
