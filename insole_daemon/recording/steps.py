"""The steps in a recording: what the daemon would have told while it was made."""

from __future__ import annotations

from collections.abc import Sequence

from ..mechanics.gait import Gait, GaitEvent
from .loading import FootRecording


def steps(feet: Sequence[FootRecording]) -> list[GaitEvent]:
    """The gait events of both feet in the order in which they are noticed; of a foot without calibration, none."""
    known = [foot for foot in feet if foot.wrench is not None]
    gait = Gait([foot.layout for foot in known])
    cycles = sorted(
        (int(t_ns), number, at)
        for number, foot in enumerate(known)
        for at, t_ns in enumerate(foot.t_ns)
        if not foot.repeated[at]
    )
    found = []
    for t_ns, number, at in cycles:
        foot = known[number]
        assert foot.wrench is not None
        assert foot.pressure_pa is not None
        f_z_n = float(foot.wrench.f_z_n[at])
        event = gait.update(
            foot.foot, t_ns, t_ns, None if f_z_n != f_z_n else f_z_n, foot.pressure_pa[at], foot.valid[at]
        )
        if event is not None:
            found.append(event)
    return found
