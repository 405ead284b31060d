"""Gaps: a straight line over a few readings, what the others say over a long one."""

from __future__ import annotations

import numpy as np

from insole_daemon.diagnosis.readings import bridged
from insole_daemon.recording.read_times import at_cycles


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
    line = at_cycles(seen.astype(np.uint8), believed, cycle_s, np.zeros(truth.shape))
    filled = bridged(np.where(believed, truth, line), believed, cycle_s)
    assert np.array_equal(filled[believed], truth[believed])
    assert np.std((filled - truth)[~believed]) < 2.0
    assert np.std((line - truth)[~believed]) > 8.0
