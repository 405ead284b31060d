"""Gaps: a straight line over a few readings, what the others say over a long one."""

from __future__ import annotations

import numpy as np

from insole_daemon.diagnosis.readings import bridged, together


def test_readings_that_are_held_are_replaced_by_lines_between_the_moments_of_those_that_came() -> None:
    cycle_s = np.arange(8) * 0.02
    truth = np.array([10, 20, 30, 40, 50, 60, 70, 80], np.uint8)[:, None]
    held = truth.copy()
    held[[3, 4]] = 30
    believed = np.ones((8, 1), bool)
    believed[[3, 4]] = False
    assert np.array_equal(together(held, believed, cycle_s, 0.0), truth)
    early = together(held, believed, cycle_s, 0.01)  # each was read half a cycle before
    assert np.allclose(early[:-1], truth[:-1] + 5.0)


def test_a_long_gap_is_filled_with_what_the_others_say() -> None:
    rng = np.random.default_rng(1)
    cycle_s = np.arange(2000) * 0.02
    load = np.abs(np.sin(cycle_s * 0.7)) ** 1.5
    lagging = np.convolve(load, np.exp(-np.arange(200) / 40.0) / 40.0)[: len(load)]
    shares = rng.uniform(20.0, 60.0, (2, 30))
    truth = 230.0 - np.stack([load, lagging], axis=1) @ shares + rng.normal(0.0, 1.0, (len(load), 30))
    believed = np.ones(truth.shape, bool)
    believed[500:900, :10] = False
    seen = np.where(believed, truth, 0.0)
    line = together(seen.astype(np.uint8), believed, cycle_s, 0.0)
    filled = bridged(np.where(believed, truth, line), believed, cycle_s)
    assert np.array_equal(filled[believed], truth[believed])
    assert np.std((filled - truth)[~believed]) < 2.0
    assert np.std((line - truth)[~believed]) > 8.0
