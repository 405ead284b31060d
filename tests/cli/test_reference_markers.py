"""`insole reference --markers`: the clock of another system aligned by moments that both have recorded."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import yaml

import insole_daemon
from insole_daemon.cli import main
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import START_NS, Trial

OFFSET_S, RATE = 0.8, 80e-6
START_S = START_NS * 1e-9
SECONDS = 8.0


@pytest.fixture
def walk(tmp_path, monkeypatch):
    """A recording, the forces of another system and its mapping, in the working folder."""
    monkeypatch.chdir(tmp_path)
    layouts = [load_layout(insole) for insole in Config().insoles]
    Trial("t5", Config(), layouts, seed=3).write(tmp_path / "walk", SECONDS)
    foot = insole_daemon.load(tmp_path / "walk")["left"]
    columns = by_other(foot.t_ns * 1e-9), foot.wrench.f_z_n, foot.wrench.cop_x_m, foot.wrench.cop_y_m
    rows = (",".join("" if v != v else f"{v:.6f}" for v in row) for row in zip(*columns, strict=True))
    (tmp_path / "forces.csv").write_text("t,F,X,Y\n" + "\n".join(rows) + "\n")
    columns = {"time": "t", "force": "F", "cop_x": "X", "cop_y": "Y"}
    units = {"time": "s", "force": "N", "cop_x": "m", "cop_y": "m"}
    mapping = {name: {"column": column, "unit": units[name]} for name, column in columns.items()}
    (tmp_path / "mapping.yaml").write_text(yaml.safe_dump({"format": "insole-table/1", "foot": "left", **mapping}))
    return tmp_path / "walk"


def by_other(t_s):
    """What the other system's clock says at t_s (CLOCK_REALTIME), which it counts from the start of the recording."""
    return OFFSET_S + (1 + RATE) * (np.asarray(t_s) - START_S)


def moments(n, seconds=600.0):
    """Moments (n,) in ten minutes, as both systems stamp them with 1 ms of jitter."""
    random = np.random.default_rng(n)
    true_s = START_S + np.sort(random.uniform(0, seconds, n))
    own_s, other_s = (true_s + 0.001 * random.standard_normal(n) for _ in range(2))
    return own_s, by_other(other_s)


def reference(monkeypatch, capsys, *words):
    command = ["insole", "reference", "walk", "forces.csv", "--mapping", "mapping.yaml", "--force", *words]
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit) as ended:
        main()
    output = capsys.readouterr()
    return ended.value.code or 0, output.out + output.err


def test_an_offset_of_800_ms_and_80_ppm_is_taken_off_within_2_ms(walk, monkeypatch, capsys):
    own_s, other_s = moments(60)
    (walk.parent / "ours.txt").write_text("".join(f"{moment_s:.6f}\n" for moment_s in np.delete(own_s, [3, 20])))
    lines = "".join(f"{moment_s:.6f};sync\n" for moment_s in np.delete(other_s, [7, 31]))
    (walk.parent / "theirs.csv").write_text("moment;what\n" + lines)
    status, text = reference(monkeypatch, capsys, "--markers", "theirs.csv", "--own-markers", "ours.txt")
    assert status == 0, text
    assert float(text.partition(" ppm")[0].split()[-3]) == pytest.approx(80.0, abs=5.0)
    foot = insole_daemon.load(walk)["left"]
    assert foot.reference.clock == "can"
    known = np.isfinite(foot.reference["fz_n"])
    assert np.abs(foot.reference.time_s - foot.t_ns * 1e-9)[known].max() < 0.002


def test_marks_of_the_recording_itself_are_used_where_no_file_is_named(walk, monkeypatch, capsys):
    own_s, other_s = moments(12)
    document = yaml.safe_load((walk / "recording.yaml").read_text())
    marks = [{"t_ns": round(moment_s * 1e9), "text": "sync"} for moment_s in own_s]
    (walk / "recording.yaml").write_text(yaml.safe_dump(document | {"extensions": {"markers": marks}}))
    np.savetxt(walk.parent / "theirs.txt", other_s, fmt="%.6f")
    status, text = reference(monkeypatch, capsys, "--markers", "theirs.txt")
    assert status == 0, text
    foot = insole_daemon.load(walk)["left"]
    assert np.abs(foot.reference.time_s - foot.t_ns * 1e-9).max() < 0.004


@pytest.mark.parametrize(
    ("theirs", "words", "message"),
    [
        ("1\n2\n3\n", (), "expected markers in recording.yaml, found none"),
        ("t\n1\n2\nthree\n", ("--own-markers", "ours.txt"), "theirs.txt: line 4: expected a moment in seconds"),
        ("1\n2\n", ("--own-markers", "ours.txt"), "the clocks cannot be aligned"),
        ("", ("--own-markers", "ours.txt"), "the clocks cannot be aligned"),
        ("1\n", ("--own-markers", "nowhere.txt"), "nowhere.txt"),
    ],
)
def test_markers_that_cannot_align_are_refused_in_one_line(walk, theirs, words, message, monkeypatch, capsys):
    (walk.parent / "theirs.txt").write_text(theirs)
    (walk.parent / "ours.txt").write_text("1\n5\n7\n")
    before = {path.name: path.read_bytes() for path in walk.iterdir()}
    status, text = reference(monkeypatch, capsys, "--markers", "theirs.txt", *words)
    assert status in (3, 4)
    assert message in text
    assert {path.name: path.read_bytes() for path in walk.iterdir()} == before
