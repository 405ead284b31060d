"""Find the steps in a recording, as a table and as the events a daemon would have published."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..config import Contact
from ..mechanics.gait import Gait, GaitEvent
from ..mechanics.gait.figures import FootCourse
from ..mechanics.gait.steps import Steps, find_steps
from ..mechanics.region_map import RegionSpan, load_regions, map_regions
from ..physics.calibration import Calibration
from ..physics.static_curve import StaticCurve
from .loading import FootRecording
from .time_alignment import AlignedFoot, align


def step_table(feet: Sequence[FootRecording], regions: tuple[RegionSpan, ...] | None = None) -> Steps:
    """Return the steps of the feet that have a calibration.

    `regions` None: heel, midfoot, metatarsals, hallux and toes.
    """
    spans = load_regions() if regions is None else regions
    start_ns = min((int(foot.t_ns[0]) for foot in feet if len(foot)), default=0)
    courses, remarks = [], []
    for foot in feet:
        if foot.calibration is None:
            remarks.append(
                f"the {foot.foot} foot has no calibration: its counts give no force to detect steps by; calibrate it, "
                "and read the recording with that file"
            )
        elif not len(foot):
            remarks.append(f"the {foot.foot} foot has no cycles")
        else:
            courses.append(_foot_course(foot, spans, start_ns))
    if len(feet) == 1:
        remarks.append(f"only the {feet[0].foot} foot is recorded")
    return find_steps(courses, start_ns, remarks, [span.name for span in spans])


def _foot_course(foot: FootRecording, regions: tuple[RegionSpan, ...], start_ns: int) -> FootCourse:
    """Return the aligned course of one foot, from which steps are found."""
    assert foot.calibration is not None
    aligned = align(foot)
    return FootCourse(
        foot=foot.foot,
        t_s=np.asarray((aligned.t_ns - start_ns) * 1e-9, np.float64),
        wrench=aligned.wrench,
        pressure_pa=aligned.pressure_pa,
        valid=aligned.valid,
        variance_pa2=partial(_variance_pa2, foot, aligned),
        regions=map_regions(regions, foot.layout),
        taxel_area_m2=foot.layout.taxel_area_m2,
        min_pressure_pa=Contact().min_pressure_pa,
        calibration=_digest(foot.calibration),
    )


def _digest(calibration: Calibration) -> str:
    """Return a digest of curves and effects: feet with the same have the same errors."""
    digest = hashlib.sha256(calibration.coefficients_pa.tobytes())
    for effect in calibration.effects:
        digest.update(f"{effect.law.word} {effect.where}".encode())
        for name, value in effect.values.items():
            digest.update(name.encode() + value.tobytes())
    return digest.hexdigest()


def _variance_pa2(foot: FootRecording, aligned: AlignedFoot, rows: slice) -> NDArray[np.float64] | None:
    assert foot.calibration is not None
    curve = StaticCurve(foot.calibration, Contact().activation_threshold_count)
    return curve.variance_pa2(foot.counts[aligned.cycle[rows]])


def replay_gait_events(feet: Sequence[FootRecording]) -> list[GaitEvent]:
    """Return the gait events of both feet in the order of detection; none for a foot without calibration."""
    calibrated = [foot for foot in feet if foot.wrench is not None]
    gait = Gait([foot.layout for foot in calibrated])
    cycles = sorted(
        (int(t_ns), number, row)
        for number, foot in enumerate(calibrated)
        for row, t_ns in enumerate(foot.t_ns)
        if not foot.repeated[row]
    )
    events = []
    for t_ns, number, row in cycles:
        foot = calibrated[number]
        assert foot.wrench is not None
        assert foot.pressure_pa is not None
        f_z_n = float(foot.wrench.f_z_n[row])
        event = gait.update(
            foot.foot, t_ns, t_ns, None if f_z_n != f_z_n else f_z_n, foot.pressure_pa[row], foot.valid[row]
        )
        if event is not None:
            events.append(event)
    return events
