"""Times of events are refined before the search, beside the term that explains most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.select.events import refine_events, refine_events_beside
from insole_daemon.diagnosis.select.refined_settings import with_refined

AT_S, SHIFT_COUNT = 12.6, 6.0  # the grid has 10.5 and 15.5 s here


def number(design, word: str, scope: str = "insole") -> int:
    """Return the number of the first candidate with this word at this scope."""
    return next(k for k, c in enumerate(design.candidates) if c.word == word and c.where.scope == scope)


def with_effect(design, k: int, share: float):
    """Return the design of rows in which candidate `k` acts, with `share` for each of its columns."""
    candidate = design.candidates[k]
    return replace(design, y=design.y + design.contribution(candidate, np.full(len(candidate.columns), share)))


def test_noise_has_no_event_whose_time_is_worth_refining(design):
    assert refine_events(design) == {}


def test_a_step_between_times_of_the_grid_is_refined(design):
    k = number(design, "rezero", "board")
    stepped = with_effect(design.with_settings([(k, {"t_s": AT_S})]), len(design.candidates), SHIFT_COUNT)
    where = stepped.candidates[k].where
    settings = refine_events(replace(design, y=stepped.y))
    assert settings["rezero", where]["t_s"] == pytest.approx(AT_S, abs=0.3)
    offered = with_refined(design, settings).candidates[len(design.candidates) :]
    assert {(one.word, one.where): one.settings[0] for one in offered} == settings


def test_events_that_a_strong_memory_imitates_are_not_refined(design):
    loop = with_effect(design, number(design, "hysteresis"), 0.02)
    assert refine_events_beside(loop, [])
    assert refine_events(loop) == {}


def test_a_drift_of_the_reference_is_no_step_of_the_grid(design):
    where = design.candidates[number(design, "reference_fault")].where
    (offered,) = with_refined(design, {("reference_fault", where): {"t_s": AT_S}}).candidates[len(design.candidates) :]
    assert [setting["t_s"] for setting in offered.settings] == [AT_S]


def test_the_first_terms_of_a_set_may_keep_their_parameters(design):
    snap, step = number(design, "snap"), number(design, "rezero", "board")
    off = {name: 1.03 * value for name, value in design.candidates[snap].settings[0].items()}
    acting = with_effect(design.with_settings([(snap, off)]), len(design.candidates), 30.0)
    acting = replace(with_effect(acting, step, SHIFT_COUNT), candidates=design.candidates)
    kept, moved = refine(acting, (snap, step), 1), refine(acting, (snap, step))
    assert kept.design.candidates[0].settings == design.candidates[snap].settings
    assert kept.design.candidates[1].settings != design.candidates[step].settings
    assert moved.design.candidates[0].settings != design.candidates[snap].settings
