"""Planted offsets and rates are fitted from markers and from forces."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.calibration.clock import fit_clock
from insole_daemon.calibration.marker_clock import fit_marker_clock
from insole_daemon.errors import CalibrationError

OFFSET_S, RATE = 0.8, 80e-6


def markers(random, n=60, seconds=600.0, jitter_s=0.001):
    """Return the times of events by both clocks, with 1 ms of jitter each."""
    true_s = np.sort(random.uniform(0, seconds, n))
    own_s = true_s + jitter_s * random.standard_normal(n)
    return own_s, OFFSET_S + (1 + RATE) * true_s + jitter_s * random.standard_normal(n)


@pytest.mark.parametrize("seed", range(20))
def test_a_simulated_clock_is_estimated_within_2_ms_and_5_ppm(seed):
    random = np.random.default_rng(seed)
    own_s, other_s = markers(random)
    own_s = np.delete(own_s, [3, 20])  # missed by us
    other_s = np.sort(np.append(np.delete(other_s, [7, 31, 50]), random.uniform(0, 600, 4)))  # missed, and false ones
    clock = fit_marker_clock(own_s, other_s)
    assert clock.offset_s == pytest.approx(OFFSET_S, abs=0.002)
    assert clock.rate == pytest.approx(RATE, abs=5e-6)
    assert clock.offset_std_s < 0.002


def test_three_markers_align_clocks_an_hour_apart():
    random = np.random.default_rng(3)
    own_s, other_s = markers(random, n=8)
    clock = fit_marker_clock(own_s, other_s + 3600.0)
    assert clock.offset_s == pytest.approx(3600.0 + OFFSET_S, abs=0.003)


@pytest.mark.parametrize(
    ("own_s", "other_s"),
    [
        (np.arange(20.0), 3.3 + np.arange(15.0)),  # regular, and some missing: every whole second fits
        (np.array([1.0, 2.0]), np.array([1.5, 2.5])),
        (np.empty(0), np.arange(3.0)),
        (np.arange(29.0), np.arange(1.0, 30.0)),  # regular: the first of one side, the last of the other are missed
        (np.array([10.0, 10.2, 200.0, 400.0]), np.array([10.8, 200.8])),  # two pairs: no marker counts twice
    ],
)
def test_ambiguous_markers_are_refused(own_s, other_s):
    with pytest.raises(CalibrationError, match="cannot be aligned"):
        fit_marker_clock(own_s, other_s)


def test_markers_that_are_too_close_for_a_rate_are_refused():
    own_s = np.array([10.0, 10.2, 10.5])
    with pytest.raises(CalibrationError, match=r"3 markers agree .* on a rate of .* ppm"):
        fit_marker_clock(own_s, own_s + np.array([0.5, 0.5, 0.502]))


def test_forces_of_a_force_plate_give_the_same_planted_clock():
    """Without markers: f_z of the insole at 50 Hz and of a plate at 1 kHz, both with noise."""
    random = np.random.default_rng(9)
    t_s = np.arange(0, 120, 0.02) + 0.0003 * random.standard_normal(6000)

    def force(at_s):
        stride_s, stance = 1.1 + 0.05 * np.sin(at_s / 7), 0.62
        part = (at_s / stride_s) % 1.0 / stance
        return np.where(part < 1, 650 * np.sin(np.pi * np.clip(part, 0, 1)) ** 0.7, 0.0)

    plate_s = np.arange(-1, 125, 0.001)
    reference_s = OFFSET_S + (1 + RATE) * plate_s
    insole_n = force(t_s) + 8 * random.standard_normal(len(t_s))
    plate = force(plate_s) + 3 * random.standard_normal(len(plate_s))
    clock = fit_clock(t_s, insole_n[:, None], reference_s, plate[:, None])
    assert clock.offset_s == pytest.approx(OFFSET_S, abs=0.002)
    assert clock.rate == pytest.approx(RATE, abs=5e-6)
