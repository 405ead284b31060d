"""Steps of a recorded walk, with boards, bus and noise, compared with the load that was simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.recording.steps import replay_gait_events
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import START_NS, Trial

CONFIG = Config()
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]
BEGIN_S, END_S = 4.0, 27.5  # all the weight is on the ground


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    trial = Trial("t5", CONFIG, LAYOUTS, seed=3)
    return trial, insole_daemon.load(trial.write(tmp_path_factory.mktemp("trial") / "walk", 28.0))


def test_detected_steps_match_the_true_times(walk):
    trial, recording = walk
    events = replay_gait_events(recording.feet)
    t_s = np.arange(BEGIN_S, END_S, 0.001)
    n_true, errors_s = 0, []
    for foot in ("left", "right"):
        changes = np.diff((trial.load.force_n(foot, t_s) > 0).astype(int))
        for kind, change in (("initial_contact", 1), ("toe_off", -1)):
            detected_s = np.array([(e.t_ns - START_NS) * 1e-9 for e in events if (e.foot, e.kind) == (foot, kind)])
            true_s = t_s[1:][changes == change]
            n_true += len(true_s)
            errors_s += [float(np.abs(detected_s - time_s).min()) for time_s in true_s]
            within = (detected_s > BEGIN_S + 0.1) & (detected_s < END_S - 0.1)
            assert all(np.abs(true_s - time_s).min() < 0.1 for time_s in detected_s[within]), "none that is not there"
    assert n_true > 80
    assert np.mean(np.array(errors_s) < 0.1) >= 0.98
    assert np.median(errors_s) <= 0.02


def test_a_foot_without_calibration_has_no_steps(walk):
    _, recording = walk
    blind = [replace(foot, wrench=None, pressure_pa=None, calibration=None) for foot in recording.feet]
    assert replay_gait_events(blind) == []
