"""Of all that is handed out, only the data show what is concealed."""

import json

import numpy as np
import pytest

from benchmarks.diagnosis.blind import plan, seal
from benchmarks.diagnosis.blind.case import draw_case
from benchmarks.diagnosis.blind.effect import SOLVED, UNKNOWN
from benchmarks.diagnosis.blind.faults import FAULTS
from benchmarks.diagnosis.blind.generate import draw_names, generate
from benchmarks.diagnosis.blind.truth import truth


def test_no_word_of_the_truth_is_written(generated):
    words = [*SOLVED, *FAULTS, *UNKNOWN, "null", "pair", "triple", "seed", "unknown"]
    folders = [p for p in generated.cases.iterdir() if p.is_dir()]
    assert len(folders) == 3
    for file in (f for folder in folders for f in folder.rglob("*")):
        if file.suffix in (".yaml", ".json", ".csv"):
            text = file.read_text()
            if file.name == "calibration.json":  # `effects` is a key of the format, and empty
                assert json.loads(text)["effects"] == []
                text = ""
            # The format has a key `clock` and a column temperature_c in every case.
            assert not [w for w in words if w in text and w not in ("temperature", "clock")], file.name
        assert not [w for w in words if w in file.name]
    assert len({p.stat().st_mtime for p in generated.cases.rglob("*")}) == 1


def test_the_seed_decides_what_is_concealed(generated):
    sealed = json.loads((generated.sealed / "truth.json").read_text())["cases"]
    regenerated = truth(draw_case(11, 0, plan.cases(11, "bench", 3)[0]))
    assert seal.document(regenerated["effects"]) in [seal.document(c["effects"]) for c in sealed.values()]
    assert draw_names(11, 40) == draw_names(11, 40)
    assert draw_names(11, 40) != draw_names(12, 40)
    assert draw_names(11, 40) != sorted(draw_names(11, 40))


def test_cases_are_never_overwritten(generated, tmp_path):
    with pytest.raises(SystemExit, match="does not exist yet"):
        generate(seed=1, suite="bench", n=1, out=generated.cases, sealed=tmp_path / "other")


def test_all_holds_every_kind_in_an_order_that_depends_on_the_seed():
    first, second = plan.cases(1, "all", 360), plan.cases(2, "all", 360)
    assert [s.kind for s in first] != [s.kind for s in second]
    kinds = {"null", "single", "faint", "local", "pair", "triple", "simulation", "unknown", "undecidable"}
    assert {s.kind for s in first} == kinds
    assert sum(s.kind == "null" for s in first) >= 80
    assert all(len(set(s.words)) == 3 for s in first if s.kind == "triple")
    assert {s.recording for s in plan.cases(1, "walking", 60)} == {"walk"}


@pytest.mark.parametrize("recording", plan.RECORDINGS)
def test_singles_hold_every_word_that_such_a_recording_can_show(recording):
    words = {w for s in plan.cases(1, "single", 300) if s.recording == recording for w in s.words}
    assert words == {*plan.SHOWN[recording], *FAULTS}


def test_a_null_is_as_noisy_as_it_should_be(generated):
    """Checks the sealed data independently: residuals about the true mean are noise and rounding."""
    sealed = json.loads((generated.sealed / "truth.json").read_text())
    nulls = [n for n, c in sealed["cases"].items() if c["kind"] == "null" and c["recording"] == "chamber"]
    assert nulls
    for name in nulls:
        with np.load(generated.sealed / name / "scoring.npz") as scoring:
            with np.load(generated.sealed / name / "recording" / "counts.npz") as recording:
                counts = recording["counts"][scoring["untouched"]].astype(float)
            residual = (counts - scoring["oracle"])[:, scoring["usable"]]
            believed = (counts - scoring["handed_out"])[:, scoring["usable"]]
        assert 0.5 <= residual.std() <= 2.0
        assert abs(residual.mean()) < 0.03
        # The handed-out calibration is right: its residual is hardly larger than that of the true mean.
        assert believed.std() < 1.02 * residual.std()
