"""Nothing that is handed out says what is concealed, but the data."""

import json

import numpy as np
import pytest
import yaml

from benchmarks.blind import plan, seal
from benchmarks.blind.chamber_case import chamber_case
from benchmarks.blind.effect import SOLVED
from benchmarks.blind.faults import FAULTS
from benchmarks.blind.generate import generate, names
from benchmarks.blind.writing import truth


def test_folders_look_alike(made):
    found = sorted(made.cases.iterdir())
    assert len(found) == 3
    shapes = set()
    for case in found:
        document = yaml.safe_load((case / "recording" / "recording.yaml").read_text())
        shapes.add((tuple(document), document["can_origin"], tuple(sorted(p.name for p in case.rglob("*")))))
    with_reference = [s for s in shapes if "reference.csv" in s[2]]
    assert len(with_reference) <= 1
    assert len({p.stat().st_mtime for p in made.cases.rglob("*")}) == 1


def test_no_word_of_the_truth_is_written(made):
    words = [*SOLVED, *FAULTS, *plan.UNKNOWN, "null", "pair", "triple", "seed", "unknown"]
    for file in made.cases.rglob("*"):
        if file.suffix in (".yaml", ".json", ".csv"):
            text = file.read_text()
            if file.name == "calibration.json":  # `effects` is a key of the format, and empty
                assert json.loads(text)["effects"] == []
                text = ""
            # The contract has a key `clock` and a column temperature_c in every case.
            assert not [w for w in words if w in text and w not in ("temperature", "clock")], file.name
        assert not [w for w in words if w in file.name]


def test_the_seed_decides_what_is_concealed(made):
    sealed = json.loads((made.sealed / "truth.json").read_text())["cases"]
    spec = plan.cases(11, "bench", 3)[2]
    again = truth(chamber_case(11, 2, spec))
    assert seal.document(again["effects"]) in [seal.document(c["effects"]) for c in sealed.values()]
    assert names(11, 40) == names(11, 40)
    assert names(11, 40) != names(12, 40)
    assert names(11, 40) != sorted(names(11, 40))


def test_cases_are_never_overwritten(made, tmp_path):
    with pytest.raises(SystemExit, match="does not exist yet"):
        generate(seed=1, suite="bench", n=1, out=made.cases, sealed=tmp_path / "other", jobs=1)


def test_a_suite_holds_every_kind_in_an_order_that_depends_on_the_seed():
    first, second = plan.cases(1, "chamber", 120), plan.cases(2, "chamber", 120)
    assert len(first) == 120
    assert [s.kind for s in first] != [s.kind for s in second]
    count = {kind: sum(s.kind == kind for s in first) for kind in {s.kind for s in first}}
    assert set(count) == {"null", "single", "faint", "pair", "triple", "outside", "undecidable", "fault"}
    singles = {w for s in first if s.kind == "single" for w in s.words}
    assert singles == set(plan.SINGLES)
    assert {w for s in first if s.kind == "fault" for w in s.words} == set(FAULTS)
    assert all(len(set(s.words)) == 3 for s in first if s.kind == "triple")


def test_a_null_is_as_noisy_as_it_says(made):
    """An independent look at the data kept back: residuals about the true mean are the noise, a count or more."""
    sealed = json.loads((made.sealed / "truth.json").read_text())
    for name in sealed["cases"]:
        with np.load(made.sealed / name / "scoring.npz") as scoring:
            with np.load(made.sealed / name / "recording" / "counts.npz") as recording:
                counts = recording["counts"][scoring["untouched"]].astype(float)
            left = (counts - scoring["mean"])[:, scoring["usable"]]
        assert 1.0 <= left.std() <= 1.5
        assert abs(left.mean()) < 0.03
