"""What a model, live and causal, would have made of the force in a recorded walk."""

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
    """By foot, when (s of the epoch, as the daemon stamps it) f_z was how much (N), of every cycle of the recording.

    It is what `insole run` publishes with `model` as calibration: its masks of faults, its curves, effects and wrench.
    Feet that the model is not of are left out; DocumentError where it is wrong.
    """
    of_foot = Reading(Path(model)).document.get("foot")
    found: dict[str, tuple[Array, Array]] = {}
    for foot in load(recording).feet:
        if foot.foot != of_foot:
            continue
        calibration = calibrations.load(model, foot.layout)
        valid, _ = screened(foot)
        boards = [as_configured(board) for board in foot.boards]
        said = estimate(foot.layout, calibration, boards, foot.t_ns, foot.counts, valid, zeroed=False)
        found[foot.foot] = said.t_ns.astype(np.float64) * 1e-9, said.wrench.f_z_n
    return found
