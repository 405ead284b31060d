"""A written recording loads unchanged, and all its problems are reported together."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import zstandard

import insole_daemon
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.config import Publish
from insole_daemon.errors import InsoleError, RecordingError
from insole_daemon.mechanics.wrench import WrenchEstimator
from insole_daemon.physics import zero as zeros
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.counts import write as write_counts
from insole_daemon.recording.writer import write
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.reader import SkinReader

from .conftest import DATA

INVENTED = """invented:
- 'the layout of the left foot: the built-in approximation, not measured on this insole'
"""


def edit(folder: Path, *changes: tuple[str, str]) -> Path:
    path = folder / "recording.yaml"
    text = path.read_text()
    for before, after in changes:
        assert before in text, before
        text = text.replace(before, after)
    path.write_text(text)
    return folder


def problems(folder: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        insole_daemon.load(folder)
    assert caught.value.exit_status == 4
    return str(caught.value)


def test_a_written_recording_loads_unchanged(trial, walk, left, reference):
    loaded = insole_daemon.load(trial)
    assert (loaded.kind, loaded.can_origin) == ("chamber", "simulated")
    assert loaded.warnings == ()
    foot = loaded["left"]
    assert [board.address for board in foot.boards] == [5, 6, 7]
    assert foot.boards[0].no_load == 240
    np.testing.assert_allclose(foot.layout.xy_m, left.layout.xy_m, atol=1e-8)
    np.testing.assert_array_equal(foot.zero.baseline_count, left.zero.baseline_count)
    np.testing.assert_array_equal(foot.calibration.coefficients_pa, left.calibration.coefficients_pa)
    np.testing.assert_array_equal(foot.calibration.covariance_pa2, left.calibration.covariance_pa2)
    assert foot.calibration.provenance == {"by": "a test"}
    assert foot.reference.clock == "can"
    for name in ("pressure_pa", "temperature_c"):
        np.testing.assert_allclose(foot.reference[name], reference.columns[name], rtol=1e-8)
    np.testing.assert_allclose(foot.reference.time_s, reference.columns["time_s"], atol=1e-6)
    with pytest.raises(InsoleError, match=r"expected one of the recorded feet \(left\), found 'right'"):
        loaded["right"]


def test_loaded_cycles_equal_the_live_cycles(trial, walk, left):
    publish = Publish()
    reader = SkinReader([left.layout], round(1e9 / publish.rate_hz), round(publish.slack_ms * 1e6))
    live = [cycles for first in range(0, len(walk), 77) for cycles in reader.feed(walk[first : first + 77])[0]]
    live += reader.advance(int(walk.t_mono_ns[-1]))[0]
    expected = Cycles.concatenate(live, len(left.layout))
    foot = insole_daemon.load(trial)["left"]
    np.testing.assert_array_equal(foot.counts, expected.counts)
    np.testing.assert_array_equal(foot.t_ns, expected.t_ns // 1000 * 1000)
    np.testing.assert_array_equal(foot.missing, expected.missing)
    calibration = zeros.apply(left.calibration, left.zero)
    curve, estimator = StaticCurve(calibration, 0.0), WrenchEstimator(left.layout, 20.0, 20_000.0)
    for row in (0, 40, 149):
        counts = foot.counts[row]
        wrench = estimator(curve.pressure_pa(counts), foot.valid[row], curve.variance_pa2(counts))
        for name in type(foot.wrench).__slots__:
            np.testing.assert_allclose(getattr(foot.wrench, name)[row], getattr(wrench, name), rtol=1e-12)
        np.testing.assert_allclose(foot.pressure_pa[row], curve.pressure_pa(counts), rtol=1e-6)


@pytest.mark.parametrize("ending", [".gz", ".zst"])
def test_a_compressed_log_is_the_same_recording(trial, ending):
    plain = insole_daemon.load(trial)["left"]
    log = trial / "can.log"
    if ending == ".gz":
        subprocess.run(["gzip", log], check=True)
    else:
        log.with_suffix(".log.zst").write_bytes(zstandard.ZstdCompressor().compress(log.read_bytes()))
        log.unlink()
    edit(trial, ("can: can.log", f"can: can.log{ending}"))
    np.testing.assert_array_equal(insole_daemon.load(trial)["left"].counts, plain.counts)


@pytest.mark.parametrize("name", ["chamber", "shoe"])
def test_recordings_of_another_generator_load(name):
    loaded = insole_daemon.load(DATA / "examples" / name)
    foot = loaded["left"]
    assert loaded.can_origin == "simulated"
    assert foot.counts.shape == (400, 28, 12)
    assert foot.reference.clock == {"chamber": "can", "shoe": "own"}[name]
    if name == "chamber":
        at = np.searchsorted(foot.reference.time_s, foot.t_ns[50:350] * 1e-9)
        pressure_pa = np.nanmedian(np.where(foot.valid, foot.pressure_pa, np.nan)[50:350], axis=(1, 2))
        assert np.corrcoef(pressure_pa, foot.reference["pressure_pa"][at])[0, 1] > 0.95
    else:
        assert abs(foot.wrench.f_z_n.max() / np.nanmax(foot.reference["fz_n"]) - 1) < 0.5


def test_all_problems_are_reported_together(trial):
    edit(
        trial,
        ("kind: chamber", "kind: chamberr"),
        ("can_origin: simulated", "can_origin: simulated\nspeed_ms: 3"),
        ("no_load: 240", "no_load: 300"),
        ("file: reference.csv", "file: refrence.csv"),
    )
    (trial / "layout.yaml").write_text("format: insole-layout/1\nfoot: right\n")
    (trial / "can.log").write_text("nonsense\n")
    messages = problems(trial)
    for words in (
        r"recording.yaml: line 2: kind: expected one of chamber, shoe, bench, free, found the text \"chamberr\"",
        r"recording.yaml: line \d+: speed_ms: unknown key",
        r"no_load: expected a whole number from 1 to 255, found 300",
        r"layout.yaml: .*taxel_area_mm2: missing key",
        r"can.log: line 1: this is not candump text",
    ):
        assert re.search(words, messages), (words, messages)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([("can: can.log", "can: gone.log")], "can: the file gone.log is not in the folder"),
        ([("can: can.log\n", "")], "expected one of can .* and counts .*, found neither"),
        ([("can: can.log", "can: can.log\ncounts: can.log")], "found both"),
        ([("calibration: calibration.json", "calibration: gone.json")], "gone.json: .*there is no such file"),
        ([("kind: chamber", "kind: free")], "reference: expected none, since kind is free"),
        ([("simulated", "reencoded"), (INVENTED, "")], "invented: missing key: expected a list of what was invented"),
        (
            [("reference:\n- foot: left", "reference:\n- foot: right")],
            "reference of the right foot, but the recorded foot is",
        ),
        ([("address: 6", "address: 5")], r"two boards on address 5, the other is insoles\[0\].boards\[0\]"),
        ([("clock: can", "clock: utc")], "clock: expected one of own, can"),
        ([("insole-recording/1", "insole-recording/2")], "expected insole-recording/1, found insole-recording/2"),
        ([("insole-recording/1", "insole-layout/1")], "this is another kind of file"),
        ([("- foot: left\n  layout", "- foot: right\n  layout")], "expected the layout of the right foot, found"),
    ],
)  # fmt: skip
def test_contradictions_in_recording_yaml_are_reported(trial, changes, words):
    assert re.search(words, problems(edit(trial, *changes)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "time_s,pressure_bar\n1,2\n",
            r"missing column: expected pressure_pa .*: found pressure_bar; the unit is part",
        ),
        ("time_s,temperature_c\n1,2\n", "missing column: expected pressure_pa in a reference of kind chamber"),
        ("1,2\n3,4\n", "expected a header such as time_s,pressure_pa, found numbers"),
        ("", "expected a header with columns, found an empty file"),
        ("time_s,pressure_pa\n1,2\n3\n4,5\n", r"line 3: \(row\): expected 2 cells, found 1"),
        ("time_s,pressure_pa\n1,2\n2,nan\n3,x\n", r"line 3: pressure_pa: expected a number, or an empty cell.*'nan'"),
        ("time_s,pressure_pa\n1,2\n2,nan\n3,x\n", r"line 4: pressure_pa: .*found 'x'"),
        ("time_s,pressure_pa\n1,2\n0.5,3\n", r"line 3: time_s: time goes backwards, from 1.000000 to 0.500000 s"),
        ("time_s,pressure_pa\n1,2\n,3\n", r"line 3: time_s: expected a time in every row"),
        ("pressure_pa,pressure_pa\n1,2\n", "this column appears twice"),
    ],
)
def test_an_invalid_reference_is_refused(trial, text, words):
    (trial / "reference.csv").write_text(text)
    assert re.search(words, problems(trial))


def test_a_valid_reference_loads(trial):
    path = trial / "reference.csv"
    path.write_text("pressure_pa,more\n1,\n,2\n")
    reference = insole_daemon.load(trial)["left"].reference
    assert reference.time_s is None
    np.testing.assert_array_equal(reference["pressure_pa"], [1, np.nan])
    np.testing.assert_array_equal(reference["more"], [np.nan, 2])
    path.write_text("time_s,pressure_pa\r\n1,2\r\n2,3\r\n3")
    loaded = insole_daemon.load(trial)
    assert len(loaded["left"].reference) == 2
    assert "line 4 is incomplete" in loaded.warnings[0]
    path.write_text("time_s,pressure_pa\n")
    assert "has no readings" in insole_daemon.load(trial).warnings[0]


def test_at_most_ten_problems_of_a_reference_are_reported(trial):
    (trial / "reference.csv").write_text("time_s,pressure_pa\n" + "x,y\n" * 1000)
    messages = problems(trial)
    assert messages.count("\n") < 15
    assert "and 1990 more" in messages


def test_a_folder_without_a_recording_is_refused(tmp_path):
    assert "does not exist" in problems(tmp_path / "gone")
    assert "expected the folder of a recording, which has a recording.yaml, found nothing" in problems(tmp_path)


def test_a_truncated_log_is_read_to_its_last_complete_line(trial):
    log = trial / "can.log"
    log.write_bytes(log.read_bytes()[:-9])
    loaded = insole_daemon.load(trial)
    assert len(loaded["left"]) in (149, 150)
    assert "torn" in loaded.warnings[0]


def test_unknown_settings_are_none_and_unnamed_files_are_reported(trial):
    edit(trial, ("\n    shift: 3", ""), ("  zero: zero.json\n", ""))
    loaded = insole_daemon.load(trial)
    assert [board.shift for board in loaded["left"].boards] == [None] * 3
    assert loaded["left"].zero is None
    assert "zero.json: is there, but recording.yaml does not name it" in loaded.warnings[0]


def test_a_recording_of_counts_loads(tmp_path, left):
    k = len(left.layout)
    random = np.random.default_rng(2)
    t_ns = 1_760_000_000_123_456_789 + np.arange(50) * 20_000_000
    table = CountsTable(t_ns, random.integers(1, 250, (50, k, 12), np.uint8), status=np.ones((50, k), np.uint16))
    folder = write(
        tmp_path / "counted", kind="free", can_origin="reencoded", insoles=[left], counts={"left": table},
        invented=["all of it"],
    )  # fmt: skip
    loaded = insole_daemon.load(folder)
    assert loaded.invented[0] == "all of it"
    assert "built-in approximation" in loaded.invented[1]
    foot = loaded["left"]
    np.testing.assert_array_equal(foot.counts, table.counts)
    assert not foot.valid.any(), "every status says that the triangle does not answer"
    np.testing.assert_array_equal(foot.t_ns, t_ns)


def test_invalid_counts_are_refused(tmp_path, left):
    k = len(left.layout)
    table = CountsTable(np.arange(5), np.ones((5, k, 12), np.uint8))
    folder = write(tmp_path / "counted", kind="free", can_origin="simulated", insoles=[left], counts={"left": table})
    path = folder / "counts.npz"
    np.savez(path, t_s=np.arange(4.0), counts=np.ones((5, k - 1, 12), np.uint8))
    messages = problems(folder)
    assert f"counts: expected (n, {k}, 12) for the {k} triangles of the layout, found (5, {k - 1}, 12)" in messages
    assert "t_s: expected a finite time in seconds for each of the 5 cycles, found float64 (4,)" in messages
    np.savez(path, t_s=np.arange(5.0), counts=np.ones((5, k, 12)))
    assert "expected whole numbers of one byte, found float64" in problems(folder)
    np.savez(path, times=np.arange(5.0))
    assert "t_s: missing array" in problems(folder)
    path.write_bytes(b"nothing that numpy wrote")
    assert "expected arrays that numpy wrote" in problems(folder)
    write_counts(path, {"left": table})
    assert len(insole_daemon.load(folder)["left"]) == 5


def test_a_recording_is_written_completely_or_not_at_all(tmp_path, left, walk):
    def broken():
        yield walk[:100]
        raise RuntimeError("the simulator failed")

    with pytest.raises(RuntimeError, match="the simulator failed"):
        write(tmp_path / "trial", kind="free", can_origin="simulated", insoles=[left], frames=broken())
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "trial").mkdir()
    write(tmp_path / "trial", kind="free", can_origin="simulated", insoles=[left], frames=[walk], can="can.log.gz")
    assert isinstance(walk, FrameBatch)
    assert len(insole_daemon.load(tmp_path / "trial")["left"]) > 140
    with pytest.raises(InsoleError, match="is already there"):
        write(tmp_path / "trial", kind="free", can_origin="simulated", insoles=[left], frames=[walk])
