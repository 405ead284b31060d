"""Sessions that differ by a planted amount, and sessions that do not."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.errors import InsoleError
from insole_daemon.mechanics.gait.comparison import (
    compare_curves,
    compare_paired_curves,
    difference_of_sessions,
    paired_difference,
)
from insole_daemon.mechanics.gait.steps import Steps

PERCENT = np.arange(101)


def session(random, n=24, more_n=0.0, person_n=0.0, calibration="first"):
    """n steady steps whose second peak is `more_n` higher."""
    bump = np.exp(-(((PERCENT - 75) / 6.0) ** 2))
    shape = 600 * np.sin(np.pi * PERCENT / 100) + person_n + more_n * bump
    curves = shape + 12 * random.standard_normal((n, 1)) + 8 * random.standard_normal((n, 101))
    columns = {
        "foot": np.full(n, "left"),
        "label": np.full(n, "steady"),
        "contact_s": np.arange(n) * 1.1,
        "peak_force_n": curves.max(axis=1),
        "peak_force_std_n": np.full(n, 5.0),
    }
    return Steps(columns, {"f_z_n": curves}, 0, (), {"left": calibration})


def test_a_simulated_difference_is_detected_at_its_place():
    random = np.random.default_rng(0)
    test = compare_curves(session(random), session(random, more_n=40.0))
    assert test.p_whole < 0.01
    (span,) = test.spans_percent
    assert 60 <= span[0] <= 75 <= span[1] <= 90
    assert test.difference[75] == pytest.approx(40.0, abs=12)


def test_equal_sessions_differ_in_5_percent(monkeypatch):
    monkeypatch.setattr("insole_daemon.mechanics.gait.comparison.PERMUTATIONS", 199)
    random = np.random.default_rng(1)
    p = [compare_curves(session(random, 12), session(random, 12), seed=seed).p_whole for seed in range(200)]
    assert 0.01 <= np.mean(np.array(p) < 0.05) <= 0.10


def test_intervals_of_differences_hold():
    random = np.random.default_rng(2)
    inside = [0.0 in difference_of_sessions(session(random), session(random), "peak_force_n") for _ in range(400)]
    assert 0.92 <= np.mean(inside) <= 0.98
    wide = difference_of_sessions(session(random), session(random, calibration="second"), "peak_force_n")
    narrow = difference_of_sessions(session(random), session(random), "peak_force_n")
    assert wide.high - wide.low > narrow.high - narrow.low


def test_conditions_are_compared_within_each_person():
    random = np.random.default_rng(3)
    persons_n = 80 * random.standard_normal(10)
    pairs = [(session(random, person_n=p), session(random, more_n=30.0, person_n=p)) for p in persons_n]
    test = compare_paired_curves(pairs)
    assert test.p_whole < 0.01
    assert test.n_permutations == 2**10
    assert all(span[0] > 50 for span in test.spans_percent)
    interval = paired_difference(pairs, "peak_force_n")
    assert interval.n == 10
    assert interval.high - interval.low < 30, "less than the persons differ from each other"


def test_too_few_steps_or_persons_are_reported():
    random = np.random.default_rng(4)
    with pytest.raises(InsoleError, match="needs 3 steady steps a session, found 2 and 24"):
        compare_curves(session(random, 2), session(random))
    with pytest.raises(InsoleError, match="needs 3 persons, found 1"):
        compare_paired_curves([(session(random), session(random))])
    assert np.isnan(difference_of_sessions(session(random, 2), session(random), "peak_force_n").value)
    with pytest.raises(InsoleError, match="f_z_n"):
        compare_curves(session(random), session(random), "f_x_n")


def test_a_result_is_described_in_one_line():
    random = np.random.default_rng(0)
    described = repr(compare_curves(session(random), session(random, more_n=40.0)))
    assert "differs" in described
    assert "%" in described
    assert "\n" not in described


def test_persons_without_any_scatter_are_compared_without_a_warning():
    """One recording listed for each person, by mistake: the difference is the same in all of them."""
    random = np.random.default_rng(0)
    pair = session(random), session(random, more_n=40.0)
    test = compare_paired_curves([pair] * 3)
    assert test.p_whole == pytest.approx(1 / 3), "of 8 signs, two are as large, and the measured one counts once more"
