"""What a diagnosis looks at: the clock of the reference, whatever the sensor remembers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.observed import Observed
from insole_daemon.diagnosis.observing import observe
from insole_daemon.recording.loading import load
from insole_daemon.recording.reference import text

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


def with_rows(folder: Path, seconds: float, rate: float) -> Observed:
    """What is looked at of the recording in `folder`, its reference in rows without times.

    Against pairing row by row it is 0.3 s late, and fast by `rate`.
    """
    row_s = np.arange(0.0, seconds - 0.1, 0.02)
    pressure_pa = np.interp(0.05 + (row_s - 0.3) / (1.0 + rate), *chamber.load(seconds))
    (folder / "reference.csv").write_text(text({"pressure_pa": pressure_pa}))
    document = folder / "recording.yaml"
    document.write_text(document.read_text().replace("clock: can", "clock: own"))
    recording = load(folder)
    foot = recording.feet[0]
    audited = audit(foot, folder.name)
    observed, _ = observe(recording, foot, audited.kept, audited)
    return observed


def test_a_rate_against_rows_is_found(tmp_path: Path) -> None:
    observed = with_rows(chamber.write(tmp_path / "fast", seconds=60.0), 60.0, rate=0.002)
    assert abs(observed.rate - 0.002) < 2e-4
    assert abs(observed.offset_s - 0.3) < 0.01


def test_one_noisy_rise_and_fall_gives_rows_no_rate(tmp_path: Path) -> None:
    """Any rate would be 3 % slow and the offset 0.17 s too large: the loop's share, and what noise makes of it."""

    def loud(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts += np.random.default_rng(3).normal(0.0, 2.0, len(t_s))[:, None]

    folder = chamber.write(tmp_path / "loop", chamber.bouc_wen(0.3, 80e3), touch=loud, seconds=14.0)
    observed = with_rows(folder, 14.0, rate=0.0)
    assert observed.rate == 0.0
    assert abs(observed.offset_s - 0.3) < 0.1
