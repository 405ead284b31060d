"""Files of other programs are imported, and invented items are never marked as recorded."""

from __future__ import annotations

import re
from pathlib import Path

import can
import numpy as np
import pytest
import scipy.io

import insole_daemon
from insole_daemon.bus.candump import read
from insole_daemon.errors import InsoleError
from insole_daemon.recording.importing import import_recording
from insole_daemon.recording.writer import write
from insole_daemon.skin.geometry import PRESSURE_TAXELS

from .conftest import DATA, PUBLISHED

T_S = 1000 + np.arange(40) * 0.0204


def published(path: Path, columns: int, **more: np.ndarray) -> np.ndarray:
    """Write a MATLAB file of the published form and return its counts (40, columns)."""
    counts = np.random.default_rng(columns).integers(1, 255, (40, columns))
    c = np.column_stack([np.arange(40), T_S, counts]).astype(float)
    scipy.io.savemat(path, {"experiment": {"C": c, "P": np.linspace(0, 3, 37)[:, None], **more}})
    return counts


def test_280_published_columns_map_to_their_taxels(tmp_path):
    counts = published(tmp_path / "x.mat", 280)
    recording = insole_daemon.load(import_recording(tmp_path / "x.mat", tmp_path / "out", "left", None, None))
    foot = recording["left"]
    assert (recording.kind, recording.can_origin) == ("chamber", "reencoded")
    np.testing.assert_array_equal(foot.counts[:, :, PRESSURE_TAXELS].reshape(40, -1), counts)
    np.testing.assert_allclose(foot.t_ns * 1e-9, T_S)
    assert not foot.valid[:, :, [6, 10]].any()
    assert foot.reference.time_s is None
    assert foot.reference.clock == "own"
    np.testing.assert_allclose(foot.reference["pressure_pa"], np.linspace(0, 3e5, 37))
    assert foot.pressure_pa is None
    assert all(board.no_load is None and board.shift is None and board.interface is None for board in foot.boards)
    for what in ("times", "board addresses", "thermal pads", "layout"):
        assert any(what in line for line in recording.invented)


def test_576_published_columns_map_to_their_slots(tmp_path, left):
    rows = left.layout.rows
    counts = published(tmp_path / "x.mat", 576)
    with pytest.raises(InsoleError, match=r"slots that are not in the layout .* have readings .*5\.2.*--layout"):
        import_recording(tmp_path / "x.mat", tmp_path / "out", "left", None, None)
    slots = counts.reshape(40, 3, 16, 12)
    populated = np.zeros((3, 16), bool)
    for board, triangle in rows:
        populated[board - 5, triangle] = True
    slots[:, ~populated] = 240
    c = np.column_stack([np.arange(40), T_S, counts]).astype(float)
    scipy.io.savemat(tmp_path / "x.mat", {"experiment": {"C": c}})
    recording = insole_daemon.load(import_recording(tmp_path / "x.mat", tmp_path / "out", "left", None, None))
    assert recording.kind == "free"
    for (board, triangle), row in rows.items():
        np.testing.assert_array_equal(recording["left"].counts[:, row], slots[:, board - 5, triangle])
    assert not any("thermal pads" in line for line in recording.invented)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"experiment": {"P": np.ones((4, 1))}}, "expected a struct experiment with C and P, found P"),
        ({"data": np.ones(3)}, "expected a struct experiment with C and P, found no such struct"),
        (
            {"experiment": {"C": np.ones((4, 100))}},
            "expected 10 or 12 columns for each of the 28 triangles .* found 98",
        ),
        ({"experiment": {"C": np.full((4, 282), 300.0)}}, "expected counts, whole numbers from 0 to 255, found 300"),
        ({"experiment": {"C": np.full((4, 282), 240.5)}}, "are these filtered, or pressures"),
        ({"experiment": {"C": np.ones((4, 282)), "P": np.full((4, 1), 2e5)}}, "expected bar, up to 50, found 200000"),
    ],
)
def test_other_matlab_files_are_refused(tmp_path, content, words):
    scipy.io.savemat(tmp_path / "x.mat", content)
    with pytest.raises(InsoleError, match=words) as caught:
        import_recording(tmp_path / "x.mat", tmp_path / "out", "left", None, None)
    assert caught.value.exit_status == 4
    assert not (tmp_path / "out").exists()


def test_an_ambiguous_table_is_refused(tmp_path):
    published(tmp_path / "x.mat", 280)
    with pytest.raises(InsoleError, match="--foot left or --foot right"):
        import_recording(tmp_path / "x.mat", tmp_path / "out", None, None, None)
    (tmp_path / "y.mat").write_bytes(b"MATLAB 7.3 MAT-file, HDF5")
    with pytest.raises(InsoleError, match="expected a MATLAB file of version 5 to 7"):
        import_recording(tmp_path / "y.mat", tmp_path / "out", "left", None, None)
    with pytest.raises(InsoleError, match="does not exist"):
        import_recording(tmp_path / "z.mat", tmp_path / "out", "left", None, None)


@pytest.mark.parametrize(
    ("name", "foot", "cycles", "readings"),
    [
        ("left_insole/calibration_dataset", "left", 1000, 1000),
        ("left_insole/experiment_Inf_15September_dynamic_1", "left", 1500, 1500),
        ("right_insole/experiment_3September_allTaxels_dynamic_pink_2_just4Testing", "right", 3000, 3000),
    ],
)
def test_excerpts_of_the_published_files_are_imported(tmp_path, name, foot, cycles, readings):
    imported_as_published(DATA / "belli2023" / f"{name}.mat", tmp_path, foot, cycles, readings)


@pytest.mark.long
@pytest.mark.skipif(not PUBLISHED.is_dir(), reason=f"the whole published files are not in {PUBLISHED}")
@pytest.mark.parametrize(
    ("name", "foot", "cycles", "readings"),
    [
        ("left_insole/calibration_dataset", "left", 25435, 25339),
        ("left_insole/validation_dataset_1", "left", 14542, 14658),
        ("left_insole/experiment_Inf_15September_dynamic_1", "left", 6922, 6714),
        ("right_insole/experiment_2September_allTaxels_dynamic_pink_good", "right", 23144, 22745),
        ("right_insole/experiment_3September_allTaxels_dynamic_pink_2_just4Testing", "right", 17887, 17793),
    ],
)
def test_the_whole_published_files_are_imported(tmp_path, name, foot, cycles, readings):
    imported_as_published(PUBLISHED / f"{name}.mat", tmp_path, foot, cycles, readings)


def imported_as_published(source, tmp_path, foot, cycles, readings):
    recording = insole_daemon.load(import_recording(source, tmp_path / "out", foot, None, None))
    foot_recording = recording[foot]
    assert (len(foot_recording), len(foot_recording.reference)) == (cycles, readings)
    assert recording.can_origin == "reencoded"
    assert recording.kind == "chamber"
    assert (
        0
        <= np.nanmin(foot_recording.reference["pressure_pa"])
        < np.nanmax(foot_recording.reference["pressure_pa"])
        < 1e6
    )
    if foot == "right":  # the same two triangles read open in both forms: it is the same order
        open_ = ((foot_recording.counts[:, :, :6] == 0).all(axis=2) & (foot_recording.counts[:, :, 9] == 255)).sum(
            axis=0
        )
        assert set(np.argsort(open_)[-2:].tolist()) == {5, 16}


@pytest.mark.parametrize("stamps", [1, 2])
def test_yarp_dumps_are_imported_or_refused(tmp_path, stamps):
    folder = tmp_path / "dump"
    folder.mkdir()
    counts = np.random.default_rng(3).integers(1, 255, (30, 576))
    lines = [
        " ".join([str(n), *[f"{1.7e9 + n * 0.02:.6f}"] * stamps, *(f"{v}.0" for v in row)])
        for n, row in enumerate(counts.tolist())
    ]
    (folder / "data.log").write_text("\n".join([*lines, "30 17000"]))
    with pytest.raises(InsoleError, match="state which with --foot"):
        import_recording(folder, tmp_path / "out", None, None, None)
    with pytest.raises(InsoleError, match="slots that are not in the layout"):
        import_recording(folder, tmp_path / "out", "left", None, None)
    text = "\n".join(" ".join([*line.split()[: 1 + stamps], *["240"] * 1152]) for line in lines)
    (folder / "data.log").write_text(text.replace(" 240 240", " (240 240)", 1))
    recording = insole_daemon.load(import_recording(folder / "data.log", tmp_path / "out", None, None, None))
    assert [foot.foot for foot in recording.feet] == ["left", "right"]
    assert recording["right"].counts.shape == (30, 28, 12)
    np.testing.assert_allclose(recording["left"].t_ns, (1.7e9 + np.arange(30) * 0.02) * 1e9, atol=1e3)
    assert any("first three of the six boards" in line for line in recording.invented)
    (folder / "data.log").write_text("0 1.0 3\n1 2.0\n2 3.0 5\n")
    with pytest.raises(InsoleError, match="line 2: expected a counter, a time and the same number of values"):
        import_recording(folder, tmp_path / "again", "left", None, None)


def test_a_bench_table_is_imported(tmp_path):
    source = tmp_path / "press.csv"
    source.write_text(
        "time_s,reference,count_5_3_0,count_5_3_1,count_6_0_11,humidity\n0.00,1.5,240,239,7,40\n0.02,,,238,8,41\n"
    )
    recording = insole_daemon.load(import_recording(source, tmp_path / "out", "right", None, None))
    foot = recording["right"]
    assert recording.kind == "bench"
    assert foot.layout.identities.tolist() == [[5, 3], [6, 0]]
    assert foot.counts[:, 0, :2].tolist() == [[240, 239], [0, 238]]
    assert foot.counts[:, 1, 11].tolist() == [7, 8]
    assert foot.valid.sum(axis=(1, 2)).tolist() == [3, 2]
    np.testing.assert_array_equal(foot.reference["reference"], [1.5, np.nan])
    assert foot.reference["humidity"].tolist() == [40, 41]
    assert foot.reference.clock == "can"
    assert any("1 empty cells" in line for line in recording.invented)
    source.write_text("time_s,force\n0,1\n")
    with pytest.raises(
        InsoleError,
        match=r"expected the columns time_s and count_<board>_<triangle>_<taxel> and rows of them, found force",
    ):
        import_recording(source, tmp_path / "again", "left", None, None)


@pytest.mark.parametrize("ending", ["asc", "blf", "trc", "csv", "log"])
def test_logs_written_by_python_can_are_imported(tmp_path, walk, ending):
    frames = walk[:3000]
    source = tmp_path / f"x.{ending}"
    with can.Logger(source) as logger:
        for row in range(len(frames)):
            logger.on_message_received(
                can.Message(
                    timestamp=int(frames.t_ns[row]) * 1e-9, arbitration_id=int(frames.can_id[row]), channel="can0",
                    is_extended_id=False, data=frames.data[row].tobytes(),
                )
            )  # fmt: skip
    recording = insole_daemon.load(import_recording(source, tmp_path / "out", None, None, None))
    assert recording.can_origin == "recorded"
    assert len(recording.feet) == 1
    log = read(tmp_path / "out" / "can.log").frames
    np.testing.assert_array_equal(log.can_id, frames.can_id)
    np.testing.assert_array_equal(log.data, frames.data)
    steps_ns = np.diff(log.t_ns) - np.diff(frames.t_ns)
    assert abs(steps_ns).max() < 200_000
    assert all(board.no_load is None for board in recording["left"].boards)


def test_a_candump_log_is_copied_byte_for_byte(tmp_path, walk, left):
    made = write(
        tmp_path / "made", kind="free", can_origin="simulated", insoles=[left], frames=[walk], can="can.log.gz"
    )
    recording = insole_daemon.load(import_recording(made / "can.log.gz", tmp_path / "out", None, None, [left]))
    assert (tmp_path / "out" / "can.log.gz").read_bytes() == (made / "can.log.gz").read_bytes()
    np.testing.assert_array_equal(recording["left"].pressure_pa, insole_daemon.load(made)["left"].pressure_pa)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # python-can leaves what it refuses open
def test_files_that_are_no_logs_are_refused(tmp_path):
    for name, words in (("x.blf", "python-can reads"), ("x.asc", "no frame in it"), ("x.log", "candump")):
        (tmp_path / name).write_bytes(b"nothing of that kind")
        with pytest.raises(InsoleError) as caught:
            import_recording(tmp_path / name, tmp_path / "out", None, None, None)
        assert re.search(words, str(caught.value))
        assert caught.value.exit_status == 4
    (tmp_path / "x.log").write_text("(1.000000) can0 123#00\n")
    with pytest.raises(InsoleError, match="found no skin frames: name the configuration"):
        import_recording(tmp_path / "x.log", tmp_path / "out", None, None, None)
    (tmp_path / "x.log").write_text("(1.000000) can0 421#4000000000000000\n")
    with pytest.raises(InsoleError, match=r"found boards 2: name the configuration"):
        import_recording(tmp_path / "x.log", tmp_path / "out", None, None, None)
