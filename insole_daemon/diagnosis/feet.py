"""Choose the foot to diagnose, and check that all recordings are of one insole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..config import Foot
from ..errors import DiagnosisError
from ..recording.loading import FootRecording, Recording


def choose(recordings: Sequence[Recording], asked: Foot | None = None, simulated: bool = False) -> list[FootRecording]:
    """Return the foot with a known load of every recording: `asked`, or the only one. DiagnosisError if there is none.

    If the load is `simulated`, no reference is needed.
    """
    feet = [_foot(recording, asked, simulated) for recording in recordings]
    first = feet[0].layout
    for recording, foot in zip(recordings, feet, strict=True):
        if foot.foot != feet[0].foot:
            raise DiagnosisError(
                f"{recording.folder}: expected the {feet[0].foot} foot as in {recordings[0].folder}, "
                f"found the {foot.foot}: diagnose the feet one by one"
            )
        same = np.array_equal(foot.layout.identities, first.identities)
        if not same or not np.allclose(foot.layout.xy_m, first.xy_m, atol=1e-6):
            raise DiagnosisError(
                f"{recording.folder}: its layout is not that of {recordings[0].folder}: these are two insoles, "
                "or one of the maps is wrong; diagnose them one by one"
            )
    return feet


def _foot(recording: Recording, asked: Foot | None, simulated: bool) -> FootRecording:
    feet = [foot for foot in recording.feet if asked in (None, foot.foot)]
    if not feet:
        raise DiagnosisError(f"{recording.folder}: expected the {asked} foot, found only the other one")
    known = [foot for foot in feet if simulated or foot.reference is not None]
    if not known:
        raise DiagnosisError(
            f"{recording.folder}: expected a reference (kind chamber or shoe), found none: what was the load? Record "
            "it, or give a simulated recording of the trial with --simulation"
        )
    if len(known) > 1:
        raise DiagnosisError(
            f"{recording.folder}: expected one foot with a reference, found both: say --foot left or --foot right"
        )
    return known[0]
