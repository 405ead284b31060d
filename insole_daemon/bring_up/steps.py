"""The steps of a bring-up that need a person: the zero, a minute of recording, the force of one foot."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..bus.source import FrameSource, collect
from ..errors import InsoleError
from ..physics import zero as zeros
from ..physics.zeroing import Zeroing
from ..recording.copies import InsoleContents
from ..recording.estimate import estimate
from ..recording.live import LiveRecorder
from ..recording.recorder import Progress, Session
from ..service.doctor.finding import CheckResult, ok, problem, warning
from ..service.foot_setup import FootSetup
from ..service.state import zero_path
from ..skin.cycles import Cycles
from ..skin.validity import Validity
from .judgement import judge_force
from .observation import Observation

_LOOK_NS = 50_000_000
ZERO_S, FORCE_S = 3.0, 5.0


def listen(
    source: FrameSource,
    setups: Sequence[FootSetup],
    seconds: float,
    stop: threading.Event,
    report_share: Callable[[float], None],
) -> Observation:
    """Observe the bus for `seconds`, or until `stop`; call `report_share` with the elapsed share, 0 to 1."""
    boards = {board.address: board for setup in setups for board in setup.insole.boards}
    observation = Observation([setup.layout for setup in setups], boards)
    begin_ns = source.clock_ns()
    end_ns = begin_ns + round(seconds * 1e9)
    while source.clock_ns() < end_ns and not stop.is_set():
        batch, polled_ns = collect(source, 1 << 30, source.clock_ns() + _LOOK_NS)
        observation.feed(batch, polled_ns)
        report_share((polled_ns - begin_ns) / (end_ns - begin_ns))
    return observation


def take_zero(observation: Observation, setups: Sequence[FootSetup]) -> tuple[list[FootSetup], list[CheckResult]]:
    """Take the zero of every foot from an observation without load, and store it for the daemon.

    Returns the setups with the new zeros, and a finding for each foot.
    """
    findings: list[CheckResult] = []
    new_setups: list[FootSetup] = []
    for setup, cycles in zip(setups, observation.cycles, strict=True):
        zeroing = Zeroing(setup.layout, setup.zeroed_calibration, _validity(setup))
        for portion in cycles:
            zeroing.add(portion)
        outcome = zeroing.outcome(time.time_ns())
        subject = f"{setup.insole.foot} zero"
        if outcome.zero is None:
            findings.append(
                problem(subject, "; ".join(outcome.refusals), "lift the foot, keep it still, and try again")
            )
            new_setups.append(setup)
            continue
        path = zero_path(setup.config.rig, setup.insole.foot)
        try:
            zeros.save(path, outcome.zero, setup.layout)
        except OSError as error:
            raise InsoleError(f"{path}: cannot be written: {error.strerror or error}") from error
        new_setups.append(setup.with_zero(outcome.zero, str(path)))
        findings.append(
            ok(
                subject,
                f"moved by {outcome.shift_count or 0:+.2f} counts on average, noise {outcome.noise_count or 0:.2f} "
                f"counts, stored in {path}",
            )
        )
    return new_setups, findings


def record_trial(
    source: FrameSource,
    setups: Sequence[FootSetup],
    out: Path,
    seconds: float,
    stop: threading.Event,
    report_progress: Callable[[Progress], None],
) -> list[CheckResult]:
    """Record `seconds` into the folder `out`; return the verdict on each foot."""
    insoles = [
        InsoleContents(
            setup.insole.foot,
            setup.insole.boards,
            setup.layout,
            setup.insole.calibration or setup.calibration,
            setup.zero,
        )
        for setup in setups
    ]
    recorder = LiveRecorder(out, "free", insoles, 0, source.interfaces)
    try:
        progress = Session(recorder, stop, seconds, report_progress).from_bus(source)
    finally:
        recorder.close()
    findings = []
    for foot, quality in progress.quality.items():
        subject = f"{foot} recording"
        if quality.verdict == "good":
            findings.append(ok(subject, quality.sentence))
        else:
            level = warning if quality.verdict == "usable" else problem
            findings.append(
                level(subject, quality.sentence, "insole doctor   # CPU, receive buffer and bus; then insole status")
            )
    return findings


def stand_on_one_foot(
    observation: Observation, setups: Sequence[FootSetup], at: int, body_mass_kg: float
) -> CheckResult:
    """Judge the force on the foot `setups[at]` on which the person stood alone while `observation` was made."""
    setup = setups[at]
    cycles = Cycles.concatenate(observation.cycles[at], len(setup.layout))
    subject = f"{setup.insole.foot} force"
    if not len(cycles):
        return problem(subject, "no cycle arrived while you stood on it", "insole doctor")
    valid = _validity(setup)(cycles.counts, cycles.status, cycles.age_ns)
    estimated = estimate(
        setup.layout, setup.zeroed_calibration, setup.insole.boards, cycles.t_ns, cycles.counts, valid,
        zeroed=setup.zero is not None,
    )  # fmt: skip
    wrench = estimated.wrench
    if not np.isfinite(wrench.f_z_n).any():
        return problem(
            subject, "no taxel is valid", "insole status   # lists the boards and triangles that are left out"
        )
    std_n = float(np.nanmean(wrench.f_z_std_n)) if np.isfinite(wrench.f_z_std_n).any() else float("nan")
    return judge_force(
        setup.insole.foot, float(np.nanmean(wrench.f_z_n)), std_n, body_mass_kg, setup.calibration.builtin
    )


def _validity(setup: FootSetup) -> Validity:
    boards = {board.address: board for board in setup.insole.boards}
    return Validity(setup.layout, boards, round(setup.config.publish.stale_after_ms * 1e6))
