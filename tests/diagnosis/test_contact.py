"""Detection of triangles that lost contact."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis import contact
from insole_daemon.skin.geometry import PRESSURE_TAXELS

PERIOD_S, STEP_S, OPEN_CYCLES = 0.02, 1.0, 11
OPEN_LINE = np.array([0, 0, 0, 0, 0, 0, 250, 0, 0, 255, 250, 0], np.uint8)  # thermal pads read on


def walk(n_cycles: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (n,) s and (n, 2, 12) counts of two triangles that are pressed once a second."""
    t_s = PERIOD_S * np.arange(n_cycles)
    pressed = 90.0 * np.clip(np.sin(2 * np.pi * t_s / STEP_S), 0.0, None)
    counts = np.repeat((250.0 - pressed)[:, None, None], 24, axis=1).reshape(n_cycles, 2, 12)
    return t_s, np.round(counts).astype(np.uint8)


def opened(t_s: np.ndarray, counts: np.ndarray) -> list[int]:
    """Return the triangles that are open, of readings whose status is good but for those at both ends."""
    at_ends = contact.at_both_ends(counts)
    silent = np.repeat(at_ends[..., None], 12, axis=2) & PRESSURE_TAXELS
    return contact.opened(silent, at_ends, t_s)


def test_a_line_that_opens_for_a_moment_in_every_step_is_an_open_triangle():
    t_s, counts = walk(500)
    for start in range(5, 500, round(STEP_S / PERIOD_S)):
        counts[start : start + OPEN_CYCLES, 1] = OPEN_LINE
    assert OPEN_CYCLES * PERIOD_S < contact.OPEN_S
    assert opened(t_s, counts) == [1]


def test_single_damaged_readings_are_no_open_triangle():
    t_s, counts = walk(500)
    counts[[40, 41, 300], 1] = OPEN_LINE
    assert opened(t_s, counts) == []


def test_a_load_beyond_the_range_of_all_taxels_is_no_open_triangle():
    t_s, counts = walk(500)
    counts[(t_s % STEP_S > 0.1) & (t_s % STEP_S < 0.4), 1] = 0
    assert not contact.at_both_ends(counts).any()


@pytest.mark.parametrize("steps", [False, True])
@pytest.mark.parametrize("rate", [1e-5, 2e-4, 1e-3, 1e-2])
def test_glitches_of_all_taxels_are_no_loose_contact_but_a_real_one_is_detected(rate, steps):
    rng = np.random.default_rng(3)
    t_s, counts = walk(3000)
    counts = np.tile(counts.reshape(len(t_s), -1), (1, 5)).astype(float) + rng.normal(0.0, 1.0, (len(t_s), 120))
    struck = rng.random(counts.shape) < rate
    counts = np.where(struck, rng.integers(0, 256, counts.shape), counts)
    counts[50::100, 7] = 90.0
    mean = (250.0 - np.median(counts, axis=1)) / 90.0
    found = contact.loose(counts, np.ones(counts.shape, bool), mean, t_s, np.arange(120) // 12, steps)
    assert set(np.flatnonzero(found)) <= {7}
    assert found[7] or rate > 2e-3


def silent_taxels(counts: np.ndarray, t_s: np.ndarray, steps: bool) -> list[int]:
    """Return the taxels (24,) with silent readings, by the load that those of `walk` show."""
    mean = np.clip(np.sin(2 * np.pi * t_s / STEP_S), 0.0, None)
    taxels = counts.reshape(len(t_s), -1).astype(float)
    silent = contact.silent(taxels, np.full(taxels.shape, True), t_s, mean, np.arange(24) // 12, steps)
    return np.flatnonzero(silent.any(axis=0)).tolist()


@pytest.mark.parametrize("steps", [False, True])
def test_a_taxel_that_stays_at_the_end_of_its_range_while_its_triangle_bears_load_is_silent(steps):
    t_s, counts = walk(1000)
    counts[round(10.5 * STEP_S / PERIOD_S) :, 1, 3] = 255  # since an unloaded moment
    assert silent_taxels(counts, t_s, steps) == [15]


def test_a_taxel_that_stays_at_the_end_of_its_range_on_a_walk_may_bear_nothing():
    t_s, counts = walk(1000)
    since = round(10.5 * STEP_S / PERIOD_S)
    counts[since:, 1] = 250 - (np.arange(len(t_s) - since) % 2)[:, None]  # the triangle is in the air
    counts[since:, 1, 3] = 255
    assert silent_taxels(counts, t_s, steps=True) == []


def test_a_taxel_on_a_walk_whose_baseline_is_beyond_its_range_is_not_silent_while_its_triangle_bears_load():
    t_s, counts = walk(1000)
    pressed = 250.0 - counts[:, 1, 3]
    drifted = np.where(t_s < 10.5 * STEP_S, 260.0, 350.0)
    counts[:, 1, 3] = np.minimum(drifted - pressed, 255.0)
    assert silent_taxels(counts, t_s, steps=True) == []


def test_a_taxel_whose_baseline_drifted_beyond_its_range_reads_high_loads_and_is_not_silent():
    t_s, counts = walk(1000)
    rising = np.clip(t_s / 12.0, 0.0, 1.0)  # the load rises from step to step: rest for a while
    pressed = 90.0 * rising * np.clip(np.sin(2 * np.pi * t_s / STEP_S), 0.0, None)
    counts[:, 1, 3] = np.minimum(285.0 - pressed, 255.0)
    assert (counts[:200, 1, 3] == 255).all()
    taxels, mean = counts.reshape(len(t_s), -1).astype(float), pressed / 90.0
    silent = contact.silent(taxels, np.full(taxels.shape, True), t_s, mean, np.arange(24) // 12, False)
    assert not silent[:, 15].any()
