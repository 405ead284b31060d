"""Bursts of noise in the readings of triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from insole_daemon.diagnosis.observations.noise_bursts import biased_in_bursts, detect_noise_bursts
from insole_daemon.diagnosis.observing import observed
from insole_daemon.recording.loading import load

from .. import chamber


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """A bag whose rows have no noise of their own."""
    recording = load(chamber.write(tmp_path_factory.mktemp("bag") / "bag", seconds=60.0))
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, ())
    return replace(seen, activation_count=np.full_like(seen.activation_count, 20.0))


def with_noise(seen, sd_count, phase_of_period):
    """`seen` with white noise of `sd_count` (k, T, 12) in readings that come `phase_of_period` (k,) after rows."""
    n = len(seen.t_s)
    read_s = seen.t_s + phase_of_period[:n] * seen.step_s
    noise = np.random.default_rng(5).standard_normal((n, *seen.usable.shape)) * sd_count
    rows = CubicSpline(read_s, noise)(np.clip(seen.t_s, read_s[0], read_s[-1]))
    readings = tuple(replace(each, t_s=read_s) for each in seen.readings)
    return replace(seen, activation_count=seen.activation_count + rows, readings=readings)


def test_rows_that_come_nearer_to_readings_are_no_burst(still):
    """The noise of the readings rises by a fifth, which is no burst; that of the rows more than doubles."""
    n = len(still.t_s)
    is_later = np.arange(n) > 0.7 * n
    phase, noise = np.where(is_later, 0.0, 0.5), np.where(is_later, 1.2, 1.0)
    ratio, findings = detect_noise_bursts(with_noise(still, noise[:, None, None], phase))
    assert findings == []
    assert np.all(ratio == 1.0)


@pytest.mark.parametrize("load_is_known", [True, False])
def test_noise_that_is_common_to_taxels_weighs_their_rows_as_the_noise_of_their_load(still, load_is_known, monkeypatch):
    """Of a triangle if the load is known, of a board if only the wrench is."""
    monkeypatch.setattr(type(still), "load_is_known", load_is_known)
    n = len(still.t_s)
    is_burst = (np.arange(n) > 0.4 * n) & (np.arange(n) < 0.6 * n)
    board = still.layout.identities[:, 0] == still.layout.identities[0, 0]
    seen = with_noise(still, np.where(is_burst[:, None, None] & board[:, None], 5.0, 1.0), np.zeros(n))
    common = 2.0 * np.random.default_rng(6).standard_normal(n) * is_burst
    both = replace(seen, activation_count=seen.activation_count + common[:, None, None] * board[:, None])
    middle, square = n // 2, 25.0 + 4.0
    of_wrench = 1.0 if load_is_known else (25.0 + 4.0 * still.usable[board].sum()) / square
    for burst, expected in ((seen, 5.0), (both, np.sqrt(square * of_wrench))):
        ratio, (finding,) = detect_noise_bursts(burst)
        assert finding.where.ids == ((still.layout.identities[0, 0],),)
        assert ratio[middle, board] == pytest.approx(expected, rel=0.25)
        assert np.all(ratio[middle, ~board] == 1.0)


def test_rows_of_a_burst_whose_noise_is_cut_off_at_one_side_are_not_used(still):
    """The load lifts the readings from the end of their range for three seconds of every six."""
    n = len(still.t_s)
    is_burst = (np.arange(n) > 0.4 * n) & (np.arange(n) < 0.6 * n)
    board = still.layout.identities[:, 0] == still.layout.identities[0, 0]
    is_loaded = still.t_s % 6.0 < 3.0
    top = np.where(still.usable, still.calibration.baseline_count - 255.0, 0.0)  # activation of the largest count
    seen = replace(still, activation_count=top + np.where(is_loaded, 60.0, 3.0)[:, None, None])
    seen = with_noise(seen, np.where(is_burst[:, None, None] & board[:, None], 8.0, 0.5), np.zeros(n))
    seen = replace(seen, activation_count=np.maximum(seen.activation_count, top))
    ratio, _ = detect_noise_bursts(seen)
    is_biased = biased_in_bursts(seen, ratio)
    middle = (np.arange(n) > 0.45 * n) & (np.arange(n) < 0.55 * n)
    is_far = np.abs((still.t_s + 1.5) % 3.0 - 1.5) > 0.2  # from a change of the load
    assert is_biased[middle & ~is_loaded & is_far][:, board].all()
    assert not is_biased[middle & is_loaded & is_far][:, board].any()
    assert not is_biased[:, ~board].any()


@pytest.mark.parametrize(("shift", "word"), [(0, "unknown"), (1, "noise_burst")])
def test_noise_that_comes_whenever_the_load_is_high_is_no_burst(still, shift, word):
    """With `shift` the noise comes in every second half of a load and of the pause after it."""
    n = len(still.t_s)
    quarter = (np.arange(n) * 20 // n + shift) % 4
    is_loaded = (quarter - shift) % 4 < 2
    triangle = np.arange(len(still.layout)) == 2
    noise = np.where((quarter < 2)[:, None, None] & triangle[:, None], 5.0, 1.0)
    seen = replace(still, activation_count=still.activation_count + 30.0 * is_loaded[:, None, None])
    _, (finding,) = detect_noise_bursts(with_noise(seen, noise, np.zeros(n)))
    assert finding.effect == word
    assert {tuple(each) for each in finding.where.ids} == {tuple(still.layout.identities[2].tolist())}
