"""What a diagnosis looks at: the clock of the reference, whatever the sensor remembers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.observing import observe
from insole_daemon.recording.loading import load

from . import chamber


def test_a_strong_loop_bends_no_clock(tmp_path: Path) -> None:
    recording = load(chamber.write(tmp_path / "bent", chamber.bouc_wen(0.5, 80e3), clock="own"))
    foot = recording.feet[0]
    audited = audit(foot, "bent")
    observed, _ = observe(recording, foot, audited.kept, audited)
    # The first frame is 50 ms after the reference's beginning. Powers of the readings alone are 0.17 s off.
    middle_s = float(observed.cycle_s[-1]) / 2
    assert abs(observed.reference_s(np.array(middle_s)) - middle_s - 0.05) < 0.08


def test_what_warms_up_and_cools_down_bends_no_clock(tmp_path: Path) -> None:
    def warm(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts -= 20.0 * np.sin(t_s / 15.0)[:, None] * (240.0 - counts).clip(0.0) / 60.0

    recording = load(chamber.write(tmp_path / "warm", touch=warm, clock="own"))
    foot = recording.feet[0]
    audited = audit(foot, "warm")
    observed, _ = observe(recording, foot, audited.kept, audited)
    assert abs(observed.rate) < 3e-4
    assert abs(float(observed.reference_s(np.array(45.0))) - 45.05) < 0.02
