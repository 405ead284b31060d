"""The force that the daemon would have published with a model for a recorded walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..calibration.trials import screened
from ..documents import Reading
from ..physics import calibration as calibrations
from ..physics.law import Array
from ..recording.estimate import estimate
from ..recording.loading import as_configured, load


def of_walk(model: Path, recording: Path) -> dict[str, tuple[Array, Array]]:
    """Return (times in s of the epoch as the daemon stamps them, f_z in N) of every cycle of the recording, by foot.

    These are the values that `insole run` publishes with `model` as calibration, including its fault masks. A foot that
    the model is not made for is left out. Raises DocumentError if the model is not valid.
    """
    of_foot = Reading(Path(model)).document.get("foot")
    force_by_foot: dict[str, tuple[Array, Array]] = {}
    for foot in load(recording).feet:
        if foot.foot != of_foot:
            continue
        calibration = calibrations.load(model, foot.layout)
        valid, _ = screened(foot)
        boards = [as_configured(board) for board in foot.boards]
        published = estimate(foot.layout, calibration, boards, foot.t_ns, foot.counts, valid, zeroed=False)
        force_by_foot[foot.foot] = published.t_ns.astype(np.float64) * 1e-9, published.wrench.f_z_n
    return force_by_foot
