"""Published chamber recordings of an uncalibrated insole, without concealed effects."""

from pathlib import Path

import pytest

import insole_daemon
from insole_daemon.diagnosis.observations.fitted_curves import observe_uncalibrated
from insole_daemon.diagnosis.observations.reading_faults import reading_faults
from insole_daemon.diagnosis.pipeline import diagnose
from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.import_matlab import import_matlab
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.layout import Layout

NAME = "experiment_Inf_15September_dynamic_1"
FILES = Path(__file__).parents[3] / "shared" / "data" / "belli2023"
FILE = FILES / "left_insole" / f"{NAME}.mat"
RIGHT = "experiment_2September_allTaxels_dynamic_pink_good"  # most triangles say one number for ever

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not FILES.is_dir(), reason=f"the whole published files are not in {FILES}"),
]


def test_the_published_recording_is_diagnosed(tmp_path):
    recording = insole_daemon.load(import_matlab(FILE, tmp_path / NAME, "left", None))
    diagnosis = diagnose([recording], None, lambda text: None)
    by_word = {}
    for each in diagnosis.findings:
        by_word.setdefault(each.effect, []).append(each)
    # Board 6 reads 22 counts more from 40 kPa on, until the load falls below 23: to be seen with bare eyes.
    (snap,) = by_word["snap"]
    assert snap.where.ids == ((6,),)
    assert snap.parameters["up_pa"].value == pytest.approx(40e3, rel=0.15)
    assert snap.parameters["down_pa"].value == pytest.approx(23e3, rel=0.2)
    assert "creep" in by_word or "hysteresis" in by_word  # one rise and one fall cannot tell which
    open_boards = {ids[0] for each in by_word["open_triangle"] for ids in each.where.ids}
    assert 7 in open_boards
    assert diagnosis.heldout["after"] < 0.9 * diagnosis.heldout["before"]


def thin_out(folder: Path, of_cycles: int, of_triangles: int) -> None:
    """Keep one of so many cycles of the counts and of the reference, and one of so many triangles."""
    whole = layouts.load(folder / "layout.yaml", "left")
    counts = counts_file.read(folder / "counts.npz", {"left": len(whole)})["left"]
    thinned = CountsTable(counts.t_ns[::of_cycles], counts.counts[::of_cycles, ::of_triangles])
    counts_file.write(folder / "counts.npz", {"left": thinned})
    kept = whole.triangles[::of_triangles], whole.xy_m[::of_triangles]
    layouts.write(folder / "layout.yaml", Layout("left", whole.taxel_area_m2, whole.area_meaning, *kept))
    head, *rows = (folder / "reference.csv").read_text().splitlines()
    (folder / "reference.csv").write_text("\n".join([head, *rows[::of_cycles]]) + "\n")


def test_a_snap_of_a_board_is_reported_beside_the_memory_of_the_others(tmp_path):
    """The pressure changes by 2 kPa in a second: cycles every 60 ms, of every second triangle, have all of it."""
    folder = import_matlab(FILES / "left_insole" / "calibration_dataset.mat", tmp_path / "dataset", "left", None)
    thin_out(folder, of_cycles=3, of_triangles=2)  # with fewer, the rounding of sums decides about the clock
    diagnosis = diagnose([insole_daemon.load(folder)], None, lambda text: None)
    # One slow rise and fall cannot tell which memory.
    assert {"creep", "hysteresis"}.intersection(each.effect for each in diagnosis.findings)
    (snap,) = [each for each in diagnosis.findings if each.effect == "snap"]
    assert snap.where.ids == ((6,),)
    # By the mean of its readings: up at 34.6 to 40.6 kPa.
    assert snap.parameters["up_pa"].value == pytest.approx(37e3, rel=0.15)


def test_the_connected_part_of_a_mostly_unconnected_insole_is_diagnosed(tmp_path):
    recording = insole_daemon.load(
        import_matlab(FILES / "right_insole" / f"{RIGHT}.mat", tmp_path / RIGHT, "right", None)
    )
    foot = recording.feet[0]
    (seen,) = observe_uncalibrated([recording], [foot], lambda text: None)
    faults = reading_faults(foot, seen)
    told = {each.where.ids: each.effect for each in faults.findings}
    assert {len(ids) for ids, effect in told.items() if effect == "open_triangle"} >= {22}
    # The clock that the calibration finds with smoothed counts of all that move.
    assert seen.offset_s == pytest.approx(-2.12, abs=0.3)
    assert seen.rate == pytest.approx(0.0061, abs=0.001)
