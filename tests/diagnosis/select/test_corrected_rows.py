"""Rows for another search: a reading tells nothing while the taxels of a triangle snap one after the other."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insole_daemon.diagnosis.model.regression import Timing
from insole_daemon.diagnosis.search_result import SearchResult
from insole_daemon.diagnosis.searching import _rows_while_switching
from insole_daemon.diagnosis.select.search import SubsetSearch
from insole_daemon.diagnosis.select.timing_search import TimingFit

STEP_PA = 30e3
LATE_ROWS = 3  # by which half of the taxels switch later


def rows_after(design, late_rows: int, pa: float) -> Any:
    """Return the rows for the search after one that found a snap, half of whose taxels switch `late_rows` later."""
    k = next(k for k, c in enumerate(design.candidates) if c.word == "snap" and c.where.scope == "insole")
    step = design.contribution(design.candidates[k], np.array([pa / 1e3]))
    blurred = 0.5 * (step + np.roll(step, late_rows, axis=1)) * (design.weights.T > 0.0)
    search = SubsetSearch(replace(design, y=design.y + blurred))
    result = SearchResult(TimingFit((), Timing(), 0.0, 0.0, 1, search, search.fit((k,))), ())
    faults: Any = SimpleNamespace(weights_of=lambda seen: design.weights)
    return _rows_while_switching(result, faults)


def test_rows_while_taxels_switch_at_different_times_get_a_larger_variance(design):
    rows = rows_after(design, LATE_ROWS, STEP_PA)
    uncertain = rows.switching_pa > 0.25 * STEP_PA
    assert 0.0 < uncertain.mean() < 0.3
    assert rows.switching_pa.max() == pytest.approx(0.5 * STEP_PA, rel=0.2)


def test_rows_stay_as_they_are_if_all_taxels_switch_at_once(design):
    assert rows_after(design, 0, STEP_PA) is None
