"""Triangles brought to common moments: slow converters and delays that a calibration states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from benchmarks.gait.walk import compare, with_effects
from insole_daemon.config import Config
from insole_daemon.physics.effect import effect
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.recording.steps import step_table
from insole_daemon.recording.time_alignment import align
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial

CONFIG = Config()
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]
SECONDS = 12.0


def walked(folder, *effects):
    trial = Trial("t4", CONFIG, LAYOUTS, effects={layout.foot: effects for layout in LAYOUTS}, seed=8)
    return insole_daemon.load(trial.write(folder / "walk", SECONDS)), trial.load


def test_contacts_are_within_10_ms_although_converters_are_slower_than_messages(tmp_path):
    recording, person = walked(tmp_path, effect("sample_and_hold", rate_hz=CDC_HZ))
    errors_s, _ = compare(recording.steps, person, SECONDS)
    assert len(errors_s) >= 20
    assert np.sqrt(np.mean(np.square(errors_s))) < 0.010


def test_a_delay_that_the_calibration_states_is_taken_off(tmp_path):
    recording, person = walked(tmp_path, effect("delay", delay_s=0.05))
    late_s, _ = compare(recording.steps, person, SECONDS)
    stated = step_table([with_effects(foot, [effect("delay", delay_s=0.05)]) for foot in recording.feet])
    errors_s, _ = compare(stated, person, SECONDS)
    assert np.mean(late_s) - np.mean(errors_s) == pytest.approx(0.05, abs=1e-6)
    assert np.sqrt(np.mean(np.square(errors_s))) < 0.010


def test_the_hold_is_not_taken_off_twice_where_calibration_and_readings_both_show_it(tmp_path):
    hold = effect("sample_and_hold", rate_hz=CDC_HZ)
    recording, _ = walked(tmp_path, hold)
    foot = recording["left"]
    assert np.array_equal(align(foot).t_ns, align(with_effects(foot, [hold])).t_ns)


def test_a_triangle_that_falls_silent_is_not_valid_and_stays_where_it_was(tmp_path):
    recording, _ = walked(tmp_path)
    foot = recording["left"]
    read_ns, is_new, valid = foot.read_ns.copy(), foot.is_new.copy(), foot.valid.copy()
    silent = (foot.t_ns - foot.t_ns[0]) * 1e-9 > 6.0
    last = np.flatnonzero(~silent)[-1]
    read_ns[silent, 3], is_new[silent, 3], valid[silent, 3] = read_ns[last, 3], False, False
    aligned = align(replace(foot, read_ns=read_ns, is_new=is_new, valid=valid))
    late = (aligned.t_ns - foot.t_ns[0]) * 1e-9 > 6.5
    assert not aligned.valid[late, 3].any()
    assert aligned.valid[late].any()
