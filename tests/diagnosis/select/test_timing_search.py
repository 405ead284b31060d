"""What a timing hypothesis keeps: no lag that is too short, and no memory that compensates a wrong lag."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.regression import Timing
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.select.search import SubsetSearch
from insole_daemon.diagnosis.select.timing_search import TimingFit, without_compensation, without_short_lag

from ..chamber import relaxing, write

LEAST_LAG_S = 0.01


@pytest.mark.parametrize(
    ("words", "lag_s", "left"),
    [
        (("delay", "lag"), 0.009, ("delay",)),
        (("lag",), 0.009, ()),
        (("delay", "lag"), 0.011, ("delay", "lag")),
        (("delay",), 0.0, ("delay",)),
    ],
)
def test_only_a_short_lag_loses_its_word_and_the_times_stay(words, lag_s, left):
    observation = SimpleNamespace(least_lag_s=LEAST_LAG_S)
    search: Any = SimpleNamespace(design=SimpleNamespace(load=SimpleNamespace(observation=observation)))
    fitted: Any = TimingFit(words, Timing(0.02, lag_s), 1.0, search, None)
    shortened = without_short_lag(fitted)
    assert shortened.words == left
    assert shortened.timing == fitted.timing


def test_a_memory_that_compensates_a_wrong_lag_goes_and_the_lag_is_fitted(tmp_path):
    """A term and the lag beside it are fitted in turn, and each holds the other where it is."""
    recording = insole_daemon.load(write(tmp_path / "bag", relaxing(1.0, 0.2), seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    design = block_design(KnownLoad(seen.timed(lag_s=0.19)), seen.weight_variance**-0.5)
    wrong = Timing(lag_s=0.19)
    search = SubsetSearch(design.retimed(wrong))
    memories = [
        search.fit([k]) for k, each in enumerate(design.candidates)
        if each.word == "viscoelasticity" and each.where.scope == "insole"
    ]  # fmt: skip
    best = max(memories, key=lambda fitted: fitted.score)
    fewer = without_compensation(design, search, best, wrong, (False, True), (0.0, 0.0))
    assert fewer is not None
    timing, rest = fewer
    assert rest == ()
    assert timing.lag_s == pytest.approx(0.2, abs=0.002)


def test_a_memory_stays_if_no_lag_explains_it(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", relaxing(0.4, 0.5), seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    design = block_design(KnownLoad(seen), seen.weight_variance**-0.5)
    search = SubsetSearch(design)
    best = search.run()[0]
    assert [design.candidates[k].word for k in best.chosen] == ["viscoelasticity"]
    assert without_compensation(design, search, best, Timing(lag_s=0.01), (False, True), (0.0, 0.0)) is None
