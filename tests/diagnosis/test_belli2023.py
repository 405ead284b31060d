"""The published chamber recording of 142 s: nobody planted anything in it."""

from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.diagnosing import diagnose
from insole_daemon.diagnosis.observing import observe
from insole_daemon.recording.import_matlab import import_matlab

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
    diagnosis = diagnose([recording], None, 1.0, lambda text: None)
    boards = recording["left"].layout.identities[:, 0]
    assert set(boards[diagnosis.insole.slots // 12].tolist()) == {5}
    assert len(diagnosis.insole.slots) == 120
    by_place = {(each.effect, each.where.ids): each for each in diagnosis.findings}
    # Its middle board stands on a step, several times as loud, for as long as it is pressed.
    ((began, ended),) = by_place["noise_burst", ((6,),)].when_s
    assert (began, ended) == (pytest.approx(29.8, abs=1.0), pytest.approx(121.5, abs=1.0))
    ((lost, _),) = by_place["open_triangle", ((6, 6),)].when_s
    assert lost == pytest.approx(43.5, abs=1.0)
    # Against pairing row by row; edge by edge the taxels are 0.4 s late all along. With the loud board in the mean the
    # clock ran 3.6 % fast, and with any rate 0.9 % fast or 0.7 % slow, as noise chose.
    ((offset_s, rate),) = diagnosis.clocks.tolist()
    assert offset_s == pytest.approx(-0.4, abs=0.25)
    assert rate == pytest.approx(0.0, abs=0.002)
    # One rise and one fall: any memory could be written as drift, so that is not asked for.
    assert "drift" in {each["effect"] for each in diagnosis.not_identifiable}
    # More than noise is left. Readings that repeat a conversion say nothing of noise: with them the floor was 1.5 times
    # lower.
    assert diagnosis.heldout["before"] > 1.1 * diagnosis.heldout["floor"]


def test_what_is_left_of_an_insole_most_of_which_is_not_there_is_looked_at(tmp_path):
    recording = insole_daemon.load(
        import_matlab(FILES / "right_insole" / f"{RIGHT}.mat", tmp_path / RIGHT, "right", None)
    )
    foot = recording.feet[0]
    audited = audit(foot, RIGHT)
    assert np.flatnonzero(audited.kept.any(axis=1)).tolist() == [12, 13, 14, 15, 16]
    told = {each.where.ids: each.effect for each in audited.findings}
    assert {len(ids) for ids, effect in told.items() if effect == "open_triangle"} >= {22}
    seen, _ = observe(recording, foot, audited.kept, audited)
    # The clock that the calibration finds with smoothed counts of all that move.
    assert seen.offset_s == pytest.approx(-2.12, abs=0.3)
    assert seen.rate == pytest.approx(0.0061, abs=0.001)
