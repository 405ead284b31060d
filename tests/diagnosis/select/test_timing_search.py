"""A lag that is too short to be identified is no word of a timing hypothesis."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from insole_daemon.diagnosis.model.regression import Timing
from insole_daemon.diagnosis.select.timing_search import TimingFit, without_short_lag

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
