"""Hypotheses on delay and lag of the whole insole."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from insole_daemon.diagnosis.model.regression import Timing
from insole_daemon.diagnosis.select.timing_search import TimingFit, TimingHypothesis, without_short_lag

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
    fitted: Any = TimingFit(words, Timing(0.02, lag_s), 1.0, 1.0, len(words), search, None)
    shortened = without_short_lag(fitted)
    assert shortened.words == left
    assert shortened.timing == fitted.timing


@pytest.mark.parametrize(("left", "n_terms", "criterion"), [(105.0, 3, 131.0), (97.0, 3, 121.0), (105.0, 1, 121.0)])
def test_more_terms_that_leave_more_are_no_better_than_one_lag(left, n_terms, criterion):
    """The smallest effects of boards and triangles have smaller penalties than one of the insole."""
    boards = TimingHypothesis((), Timing(), 121.0, left, n_terms)
    lag = TimingHypothesis(("lag",), Timing(0.0, 0.009), 124.0, 98.0, 1)
    assert boards.beside(lag).criterion == criterion
    assert lag.beside(boards) is lag
