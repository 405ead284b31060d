"""Outliers of single taxels, in contrast to load and effects."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.diagnosis.observations.outliers import MOST_FRACTION, interpolated, outliers
from insole_daemon.skin.geometry import N_TAXELS

Array = NDArray[np.float64]
N = 2000
NOISE_COUNT = 0.8


def read(load: Array | float = 0.0, noise: Array | float = NOISE_COUNT, seed: int = 0) -> Array:
    """Return readings (N, 12) under a load (N, 12), counts."""
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(240.0 - load + noise * rng.normal(size=(N, N_TAXELS))), 0, 255)


def steps(period_s: float = 0.02) -> Array:
    """Return the load (N, 12) of steps, up to 60 counts; every other taxel is loaded later."""
    t_s = np.arange(N) * period_s
    phase = (t_s[:, None] - 0.1 * (np.arange(N_TAXELS) % 2)) % 1.1 / 0.6
    return np.where(phase < 1, 60.0 * np.minimum(1.0, 10 * np.minimum(phase, 1 - phase)), 0.0)


def found_in(counts: Array, period_s: float = 0.02) -> NDArray[np.bool_]:
    return outliers(np.arange(N) * period_s, counts, np.ones(counts.shape, bool))


@pytest.mark.parametrize("period_s", [0.02, 0.05])
def test_random_readings_one_in_a_hundred_are_outliers_and_interpolated(period_s):
    rng = np.random.default_rng(1)
    right, struck = read(steps(period_s)), rng.random((N, N_TAXELS)) < 0.01
    counts = np.where(struck, rng.integers(0, 256, struck.shape), right)
    found = found_in(counts, period_s)
    far = np.abs(counts - right) > 40.0
    assert found[far].mean() > 0.9
    assert found[~struck].mean() < 1e-3
    left = interpolated(np.arange(N) * period_s, counts, ~found, found) - right
    assert np.sqrt(np.mean(left**2)) < (1.0 if period_s == 0.02 else 3.0)


@pytest.mark.parametrize("period_s", [0.02, 0.05])
def test_steps_have_no_outliers(period_s):
    assert not found_in(read(steps(period_s)), period_s).any()


@pytest.mark.parametrize("wrong", [[90.0, 140.0], [90.0, 90.0], [90.0, 255.0]])
def test_two_adjacent_wrong_readings_are_both_outliers(wrong):
    counts = read()
    counts[[700, 701], 2] = wrong
    assert set(zip(*np.nonzero(found_in(counts)), strict=True)) == {(700, 2), (701, 2)}


def test_a_change_of_half_of_a_triangle_is_load():
    load = np.zeros((N, N_TAXELS))
    load[500::55, :5] = 50.0
    assert not found_in(read(load)).any()


def test_taxels_that_snap_are_no_outliers():
    load = np.zeros((N, N_TAXELS))
    load[(np.arange(N) // 40) % 2 == 1, 4] = 30.0
    assert not found_in(read(load)).any()


def test_a_burst_of_noise_is_no_outlier():
    noise = np.where((np.arange(N) > 800) & (np.arange(N) < 1100), 8.0, NOISE_COUNT)[:, None]
    assert not found_in(read(noise=noise)).any()


def test_a_load_beyond_the_range_is_no_outlier():
    load = np.zeros((N, N_TAXELS))
    load[:, :] = 239.5 + 3.0 * np.sin(np.arange(N) / 30.0)[:, None]
    assert not found_in(read(load)).any()


def test_a_taxel_with_frequent_deviations_has_no_outliers():
    counts = read()
    counts[::10, 6] = 100.0
    assert MOST_FRACTION < 0.1
    assert not found_in(counts).any()


def test_readings_a_tenth_of_a_second_apart_have_no_outliers():
    counts = read()
    counts[300, 5] = 20.0
    assert not found_in(counts, 0.1).any()


def test_a_live_taxel_of_a_dead_triangle_has_no_outliers():
    counts = read()
    counts[:, 1:] = 240.0
    counts[300, 0] = 120.0
    assert not found_in(counts).any()


def test_a_triangle_without_readings_has_no_outliers():
    nothing = np.zeros((0, N_TAXELS))
    assert outliers(np.zeros(0), nothing, nothing.astype(bool)).shape == nothing.shape
