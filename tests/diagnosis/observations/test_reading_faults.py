"""Faults of readings and of the reference, detected without a model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insole_daemon.diagnosis.finding import Finding
from insole_daemon.diagnosis.observations.broken_taxels import without_zeroed_taxels
from insole_daemon.diagnosis.observations.reading_faults import reading_faults
from insole_daemon.diagnosis.observations.walk import observe_walk
from insole_daemon.diagnosis.observing import observed
from insole_daemon.errors import DiagnosisError
from insole_daemon.physics.effect import Where
from insole_daemon.recording.loading import load

from .. import chamber
from ..foot.shoe import change_force, write


def faults_of(walk: Path, counts=None):
    recording = load(walk)
    foot = recording.feet[0]
    if counts is not None:
        foot = replace(foot, counts=counts(foot.counts.copy()))
    return reading_faults(foot, observe_walk(recording, foot, foot.calibration))


def test_an_insole_of_which_no_taxel_works_is_refused(tmp_path):
    recording = load(write(tmp_path / "walk"))
    foot = recording.feet[0]
    seen = observe_walk(recording, foot, foot.calibration)
    with pytest.raises(DiagnosisError, match="no taxel of the left foot works"):
        reading_faults(foot, replace(seen, usable=np.zeros_like(seen.usable)))


def test_a_burst_of_one_triangle_is_placed_and_its_rows_weigh_less(tmp_path):
    def loud(counts):
        noise = np.random.default_rng(3).normal(0.0, 6.0, counts[400:700, 2].shape)
        counts[400:700, 2] = np.clip(counts[400:700, 2] + noise, 0, 255)
        return counts

    found = faults_of(write(tmp_path / "walk"), loud)
    (burst,) = [each for each in found.findings if each.effect == "noise_burst"]
    identity = tuple(found.observation.layout.identities[2].tolist())
    assert burst.where.ids == (identity,)
    ((begin, end),) = burst.when_s
    assert begin == pytest.approx(8.0, abs=1.6)
    assert end == pytest.approx(14.0, abs=1.6)
    variance = found.observation.counting_variance[:, 2, 0]
    loaded = found.observation.activation_count[:, 2].sum(axis=1) > 20
    assert np.median(variance[450:650][loaded[450:650]]) > 4 * np.median(variance[800:][loaded[800:]])


def test_readings_at_uneven_times_of_a_fast_load_are_no_burst(tmp_path):
    """They scatter as much as their times times the speed of the load, up to half a period."""

    def fast(t_s, p):
        return np.where((t_s > 20.0) & (t_s < 32.0), 150e3 * (1.0 - np.cos(6.0 * np.pi * t_s)), p)

    def uneven(t_s, counts):
        late_s = np.random.default_rng(5).choice([-0.009, 0.009], len(t_s))
        for slot in range(24, 36):
            counts[:, slot] = np.interp(t_s + late_s, t_s, counts[:, slot])

    recording = load(chamber.write(tmp_path / "bag", fast, touch=uneven, reference=fast))
    (foot,) = recording.feet
    (seen,) = observed([recording], [foot], None, lambda text: None, [])
    assert [each.effect for each in reading_faults(foot, seen).findings] == []


@pytest.mark.parametrize("delay_s", [0.0, 0.06])
def test_spikes_of_the_reference_are_detected_and_a_late_heel_strike_is_none(tmp_path, delay_s):
    assert not faults_of(write(tmp_path / "calm", delay_s=delay_s)).spikes.any()
    walk = write(tmp_path / "walk", delay_s=delay_s)
    change_force(walk, lambda force_n: force_n + 250.0 * (np.arange(len(force_n)) % 200 == 149))
    found = faults_of(walk)
    assert [each.effect for each in found.findings] == ["reference_fault"]


def test_spikes_at_heel_strikes_are_left_out_if_there_are_others(tmp_path):
    walk = write(tmp_path / "walk")
    in_air = 5

    def spike(force_n: np.ndarray) -> np.ndarray:
        begins = np.flatnonzero((force_n[:-1] < 30.0) & (force_n[1:] >= 30.0))
        force_n[[*begins[2::4] + 6, *begins[1 : 1 + in_air] - 40]] += 50.0
        return force_n

    change_force(walk, spike)
    assert faults_of(walk).spikes.sum() > in_air  # a spike lasts 5 ms, and readings are 20 ms apart


def test_taxels_that_a_rezero_moved_beyond_their_range_are_not_dead(tmp_path):
    recording = load(chamber.write(tmp_path / "bag", seconds=60.0))
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, ())
    board, zeroed_s = int(seen.layout.identities[0, 0]), float(seen.t_s[len(seen.t_s) // 2])
    first = seen.readings[0]
    counts = first.counts.copy()
    counts[first.t_s >= zeroed_s, 1] = 255.0
    counts[:, 3] = 255.0
    seen = replace(seen, readings=(replace(first, counts=counts), *seen.readings[1:]))
    triangle = tuple(seen.layout.identities[0].tolist())
    finding = Finding(
        effect="dead_taxels", foot="left", where=Where("taxel", ((*triangle, 1), (*triangle, 3))), sentence="",
        recordings=(seen.name,),
    )  # fmt: skip
    assert without_zeroed_taxels(finding, seen, {board + 1: zeroed_s}) == finding
    remaining = without_zeroed_taxels(finding, seen, {board: zeroed_s})
    assert remaining is not None
    assert remaining.where.ids == ((*triangle, 3),), "a taxel that never worked is dead"
    # As one finding on the board: dead only if most of its taxels never worked.
    rows = np.flatnonzero(seen.layout.identities[:, 0] == board)
    whole = replace(finding, where=Where("board", ((board,),)))
    assert without_zeroed_taxels(whole, seen, {board: zeroed_s}) == whole
    readings = list(seen.readings)
    for row in rows.tolist():
        is_later = readings[row].t_s[:, None] >= zeroed_s
        readings[row] = replace(readings[row], counts=np.where(is_later, 255.0, readings[row].counts))
    assert without_zeroed_taxels(whole, replace(seen, readings=tuple(readings)), {board: zeroed_s}) is None


def test_a_triangle_whose_constant_readings_pass_for_repeats_has_lost_contact_not_frames(tmp_path):
    recording = load(chamber.write(tmp_path / "bag", seconds=60.0))
    foot = recording.feet[0]
    (seen,) = observed([recording], [foot], None, lambda text: None, ())
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    counts, valid = foot.counts.copy(), foot.valid.copy()
    is_open = (t_s > 20.0) & (t_s < 30.0)
    counts[is_open, 2], counts[is_open, 2, 3], valid[is_open, 2] = 0, 255, False
    read = seen.readings[2]
    new = (read.t_s <= 20.0) | (read.t_s >= 30.0)
    read = replace(read, t_s=read.t_s[new], counts=read.counts[new], valid=read.valid[new])
    seen = replace(seen, readings=(*seen.readings[:2], read, *seen.readings[3:]))
    found = reading_faults(replace(foot, counts=counts, valid=valid), seen)
    assert [(finding.effect, finding.where.ids) for finding in found.findings] == [
        ("open_triangle", (tuple(seen.layout.identities[2].tolist()),))
    ]
