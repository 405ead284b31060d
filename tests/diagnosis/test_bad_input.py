"""Bad input gives one sentence and the exit status of the format, and no file is written."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from insole_daemon.cli import app
from insole_daemon.errors import InsoleError
from insole_daemon.recording import counts as counts_file

from .chamber import KEPT, LAYOUT, WHOLE, write


def refused(status: int, *arguments: object, out: Path) -> str:
    """Return the message of `insole diagnose` when it refuses."""
    done = CliRunner().invoke(app, ["diagnose", *map(str, arguments), "--out", str(out)])
    assert isinstance(done.exception, InsoleError), done.output
    assert done.exception.exit_status == status
    assert not out.exists()
    return str(done.exception)


def with_effects(path: Path, effects: list[dict]) -> Path:
    """The calibration in `path`, with `effects`."""
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "effects": effects}))
    return path


MAGIC = {"effect": "magic", "where": {"scope": "insole", "ids": []}, "parameters": {}}
CREEP = {
    "effect": "creep", "where": {"scope": "insole", "ids": []},
    "parameters": {"a": {"value": [0.1], "unit": "1"}, "tau_s": {"value": [9.0], "unit": "s"}},
}  # fmt: skip


@pytest.mark.parametrize("own", [True, False])
def test_a_calibration_with_unknown_effects_is_refused(tmp_path, own):
    folder = write(tmp_path / "trial", seconds=40.0)
    if own:
        with_effects(folder / "calibration.json", [MAGIC])
        said = refused(4, folder, out=tmp_path / "out")
    else:
        other = tmp_path / "other.json"
        other.write_text((folder / "calibration.json").read_text())
        said = refused(4, folder, "--calibration", with_effects(other, [MAGIC]), out=tmp_path / "out")
    assert "magic" in said
    assert "effects" in said


def test_a_calibration_with_effects_is_refused(tmp_path):
    folder = write(tmp_path / "trial", seconds=40.0)
    other = tmp_path / "other.json"
    other.write_text((folder / "calibration.json").read_text())
    said = refused(4, folder, "--calibration", with_effects(other, [CREEP]), out=tmp_path / "out")
    assert "creep" in said
    assert "static" in said


def test_a_calibration_of_another_insole_is_refused(tmp_path):
    folder = write(tmp_path / "trial", seconds=40.0)
    document = json.loads((folder / "calibration.json").read_text())
    board = int(LAYOUT.identities[0, 0])
    for taxel in document["taxels"]:
        taxel["board"] += 6 if taxel["board"] == board else 0
    other = tmp_path / "other.json"
    other.write_text(json.dumps(document))
    assert "board" in refused(4, folder, "--calibration", other, out=tmp_path / "out")


def test_a_reference_that_never_moves(tmp_path):
    folder = write(tmp_path / "flat", seconds=40.0)
    rows = [f"{1_750_000_000 + 0.5 * i},0.0" for i in range(80)]
    (folder / "reference.csv").write_text("\n".join(["time_s,pressure_pa", *rows]) + "\n")
    assert "expected one that rises and falls" in refused(4, folder, out=tmp_path / "out")


@pytest.mark.parametrize("unit_s", [1e3, 1e-3, 1e-12])
def test_a_reference_whose_times_are_not_in_seconds(tmp_path, unit_s):
    folder = write(tmp_path / "trial", seconds=40.0)
    head, *rows = (folder / "reference.csv").read_text().splitlines()
    assert head.startswith("time_s,")
    cells = [row.split(",", 1) for row in rows]
    rows = [f"{float(time) / unit_s!r},{others}" for time, others in cells]
    (folder / "reference.csv").write_text("\n".join([head, *rows]) + "\n")
    assert "are the values of time_s in seconds" in refused(4, folder, out=tmp_path / "out")


def test_recordings_of_two_insoles_are_refused(tmp_path):
    folders = [write(tmp_path / name, seconds=30.0) for name in ("first", "second")]
    layout = folders[1] / "layout.yaml"
    layout.write_text(re.sub(r"x_mm: ([0-9.]+)", lambda found: f"x_mm: {float(found[1]) + 5}", layout.read_text()))
    assert "these are two insoles" in refused(4, *folders, out=tmp_path / "out")


def test_a_recording_of_two_feet_needs_the_foot_stated(tmp_path):
    right = replace(LAYOUT, foot="right")
    folders = [write(tmp_path / "left", seconds=30.0), write(tmp_path / "right", seconds=30.0, layout=right)]
    for path in folders[1].iterdir():
        if path.suffix in (".yaml", ".json"):
            path.write_text(path.read_text().replace("left", "right"))
    table = counts_file.read(folders[1] / "counts.npz", {"left": len(LAYOUT)})["left"]
    (folders[1] / "counts.npz").unlink()
    counts_file.write(folders[1] / "counts.npz", {"right": table})
    assert "diagnose the feet one by one" in refused(4, *folders, out=tmp_path / "out")


def test_a_simulation_of_another_layout(tmp_path):
    folder = write(tmp_path / "trial", seconds=30.0)
    rows = [row + 2 for row in KEPT]
    others = replace(LAYOUT, triangles=tuple(WHOLE.triangles[row] for row in rows), xy_m=WHOLE.xy_m[rows])
    other = write(tmp_path / "simulated", seconds=30.0, layout=others)
    said = refused(4, folder, "--simulation", other, out=tmp_path / "out")
    assert "simulated" in said
    assert "layout" in said


def test_a_simulation_of_another_duration_is_refused(tmp_path):
    folder = write(tmp_path / "trial", seconds=30.0)
    said = refused(4, folder, "--simulation", write(tmp_path / "longer", seconds=70.0), out=tmp_path / "out")
    assert "no stretch of it goes with" in said
    assert "kPa on a triangle" in said


def test_a_recording_without_a_reference_is_refused(tmp_path):
    folder = write(tmp_path / "free", seconds=40.0)
    document = (folder / "recording.yaml").read_text()
    (folder / "recording.yaml").write_text(document[: document.index("reference:")].replace("chamber", "free"))
    assert "expected a reference" in refused(4, folder, out=tmp_path / "out")


def test_fewer_than_three_cycles_are_refused(tmp_path):
    folder = write(tmp_path / "short", seconds=9.0)
    assert "at least 3 cycles" in refused(3, folder, out=tmp_path / "out")


def test_a_log_whose_clock_was_set_during_the_recording_is_refused(tmp_path):
    folder = write(tmp_path / "bag", seconds=40.0)
    table = counts_file.read(folder / "counts.npz", {"left": len(LAYOUT)})["left"]
    t_ns = table.t_ns.copy()
    t_ns[len(t_ns) // 3 :] += 10**18
    counts_file.write(folder / "counts.npz", {"left": replace(table, t_ns=t_ns)})
    assert "stamped over 11574 days" in refused(4, folder, out=tmp_path / "out")


def test_a_log_whose_clock_stood_still_is_refused(tmp_path):
    folder = write(tmp_path / "bag", seconds=40.0)
    table = counts_file.read(folder / "counts.npz", {"left": len(LAYOUT)})["left"]
    t_ns = table.t_ns.copy()
    t_ns[len(t_ns) // 3 : -len(t_ns) // 10] = t_ns[len(t_ns) // 3]
    counts_file.write(folder / "counts.npz", {"left": replace(table, t_ns=t_ns)})
    assert "the clock of the log stood still" in refused(4, folder, out=tmp_path / "out")


def test_a_folder_with_a_diagnosis_is_not_overwritten(tmp_path):
    folder = write(tmp_path / "trial", seconds=40.0)
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("mine")
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out)])
    assert "a diagnosis is already there (report.html)" in str(done.exception)
    assert (out / "report.html").read_text() == "mine"


def test_a_missing_recording_is_refused(tmp_path):
    assert "nowhere" in refused(4, tmp_path / "nowhere", out=tmp_path / "out")
