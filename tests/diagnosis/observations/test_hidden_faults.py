"""Faults without an effect word: a bit that never changes, and pick-up of all taxels of a triangle."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.hidden_faults import (
    common_variance_ratios,
    detect_pick_up,
    is_bit_constant,
    stuck_bit,
)
from insole_daemon.diagnosis.observations.readings import TriangleReadings, _without_frozen
from insole_daemon.skin.geometry import PRESSURE_TAXELS

USABLE = np.broadcast_to(PRESSURE_TAXELS, 12)


def walking(seed: int = 1, n: int = 3000) -> TriangleReadings:
    """Readings every 20 ms of taxels that are pressed once a second, 60 counts deep, with noise of 1 count."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(n) * 0.02
    pressed = np.maximum(np.sin(2 * np.pi * t_s), 0.0)[:, None] * rng.normal(60.0, 6.0, 12)
    counts = np.rint(230.0 + rng.normal(0.0, 3.0, 12) - pressed + rng.normal(0.0, 1.0, (n, 12)))
    return TriangleReadings(t_s, counts, np.ones(counts.shape, bool), 0.02)


@pytest.mark.parametrize("bit", [0, 2, 3, 4])
@pytest.mark.parametrize("value", [0, 1])
def test_a_stuck_bit_is_detected(bit, value):
    own = walking()
    counts = own.counts.astype(int)
    stuck = counts | 1 << bit if value else counts & ~(1 << bit)
    spoiled = TriangleReadings(own.t_s, stuck.astype(float), own.valid, own.period_s)
    assert stuck_bit(spoiled, USABLE) == bit
    assert stuck_bit(own, USABLE) is None


def test_a_bit_beyond_the_range_of_counts_is_constant_and_one_that_changes_is_not():
    own = walking()  # between 150 and 240 counts: the highest bit is always there
    assert is_bit_constant(own, USABLE, 7)
    assert not is_bit_constant(own, USABLE, 4)


def test_pick_up_of_one_triangle_is_detected_and_a_walk_is_none():
    every = [walking(seed) for seed in range(6)]
    hum = 3.0 * np.sin(2 * np.pi * 13.0 * every[2].t_s)[:, None]
    own = every[2]
    every[2] = TriangleReadings(own.t_s, np.rint(own.counts + hum), own.valid, own.period_s)
    shares = np.array([common_variance_ratios(each, USABLE)[0] for each in every])
    assert detect_pick_up(shares).tolist() == [False, False, True, False, False, False]
    assert not detect_pick_up(np.delete(shares, 2)).any()


def test_a_triangle_whose_load_changes_most_of_the_time_has_no_pick_up():
    """At 50 ms the load itself moves all taxels of a triangle at once in all windows but those of a foot in the air."""
    rng = np.random.default_rng(3)
    t_s = np.arange(2000) * 0.05
    is_unloaded = ((t_s % 1.2) < 0.36) | ((t_s % 12.0) < 2.4)  # between steps, and in pauses of several steps
    course = np.where(is_unloaded, 0.0, np.sin(2 * np.pi * t_s / 0.45) ** 2)
    pressed = course[:, None] * rng.normal(40.0, 4.0, 12)
    counts = np.rint(240.0 - pressed + rng.normal(0.0, 1.0, (2000, 12)))
    every = [walking(seed) for seed in range(5)]
    every.append(TriangleReadings(t_s, counts, np.ones(counts.shape, bool), 0.05))
    calm, usual = np.array([common_variance_ratios(each, USABLE) for each in every]).T
    assert usual[-1] > 6.0
    assert not detect_pick_up(calm).any()


def test_a_conversion_repeated_while_others_move_is_dropped():
    every = [walking(seed) for seed in range(4)]
    counts = every[1].counts.copy()
    counts[1000:1060] = counts[999]
    own = every[1]
    every[1] = TriangleReadings(own.t_s, counts, own.valid, own.period_s)
    found = _without_frozen(every)
    assert len(found[1].t_s) == 2940
    assert found[1].held_fraction == pytest.approx(0.02)
    assert [each.held_fraction for k, each in enumerate(found) if k != 1] == [0.0] * 3


def test_conversions_of_most_triangles_repeated_while_the_others_move_are_dropped():
    """A board that repeats its frames may bear most triangles of the insole."""
    every = [walking(seed) for seed in range(6)]
    for k in range(4):
        counts = every[k].counts.copy()
        counts[1000:1060] = counts[999]
        every[k] = TriangleReadings(every[k].t_s, counts, every[k].valid, every[k].period_s)
    assert [len(each.t_s) for each in _without_frozen(every)] == [2940] * 4 + [3000] * 2


def test_repeats_while_the_wearer_stands_still_are_dropped_if_other_taxels_show_noise():
    every = [walking(seed) for seed in range(4)]
    rng = np.random.default_rng(7)
    for k, own in enumerate(every):
        counts = own.counts.copy()
        counts[1000:1200] = np.rint(counts[999] + (k != 1) * rng.normal(0.0, 1.0, (200, 12)))
        every[k] = TriangleReadings(own.t_s, counts, own.valid, own.period_s)
    assert [len(each.t_s) for each in _without_frozen(every)] == [3000, 2800, 3000, 3000]


def test_constant_readings_of_standing_still_without_noise_are_kept():
    every = [walking(seed) for seed in range(4)]
    for k, own in enumerate(every):
        counts = own.counts.copy()
        counts[1000:1200] = counts[999]
        counts[1100 + 10 * k] += 1.0
        every[k] = TriangleReadings(own.t_s, counts, own.valid, own.period_s)
    assert all(len(each.t_s) == 3000 for each in _without_frozen(every))


def test_an_unloaded_triangle_with_less_noise_than_a_count_is_kept():
    """Whether its readings change depends on how near they are to the edge of a count."""
    every = [walking(seed) for seed in range(4)]
    own, rng = every[1], np.random.default_rng(7)
    counts = np.full((3000, 12), 240.0)
    counts[:2000] += rng.random((2000, 12)) < 0.02
    every[1] = TriangleReadings(own.t_s, counts, own.valid, own.period_s)
    assert all(len(each.t_s) == 3000 for each in _without_frozen(every))


def test_constant_readings_at_an_end_of_the_range_are_kept():
    every = [walking(seed) for seed in range(4)]
    counts = every[1].counts.copy()
    counts[1000:1060] = 0.0
    own = every[1]
    every[1] = TriangleReadings(own.t_s, counts, own.valid, own.period_s)
    assert all(len(each.t_s) == 3000 for each in _without_frozen(every))
