"""What a model says the insole would read: `model.json` run forward on the load of a recording."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from ..documents import Reading
from ..physics import calibration as calibrations
from ..physics import effects_document
from ..physics.chain import Chain
from ..physics.effects import laws
from ..physics.law import Array
from ..recording.loading import Recording, as_configured, load
from ..skin.geometry import N_TAXELS
from .audit import audit
from .observing import BEGAN, observe

_FAR_S = 86_400.0  # a recording of another day: its times have nothing to do with the model's


def of_folder(model: Path, recording: Path, simulation: Path | None) -> dict[str, Array]:
    """`counts` of the recording in a folder, for programs that know files alone; `simulation` is not asked."""
    return counts(model, load(recording))


def counts(model: str | PathLike[str], recording: Recording) -> dict[str, Array]:
    """By foot, (n, n_triangles, 12) mean counts that `model` expects in every cycle; NaN where it knows no taxel.

    The recording's clock is aligned by its edges, as in a diagnosis. DocumentError where the model is wrong.
    """
    found: dict[str, Array] = {}
    for foot in recording.feet:
        if foot.reference is None:
            continue
        layout = foot.layout
        calibration = calibrations.load(model, layout, laws())
        effects = effects_document.parse(Reading(Path(model)), calibration.effects, layout)
        audited = audit(foot, recording.folder.name)
        seen, _ = observe(recording, foot, audited.kept, audited.cycles)
        boards: list[Board] = [as_configured(board) for board in foot.boards]
        run = Chain(effects, layout, calibration, boards).forward()
        t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
        began = (foot.t_ns[0] - int(calibration.provenance.get(BEGAN, foot.t_ns[0]))) * 1e-9
        t_s = np.maximum.accumulate(t_s)
        # Each triangle was read as long ago as it is old.
        read_s = t_s[:, None] - np.maximum(foot.age_ns, 0) * 1e-9
        load = np.interp(seen.reference_s(read_s), seen.load.t_s, seen.load.pressure_pa[:, 0])
        warm: NDArray[np.float64] | None = None
        if seen.temperature_c is not None:
            warm = np.interp(t_s, seen.t_s, seen.temperature_c)
        shape = (len(foot), len(layout), N_TAXELS)
        origin = began if abs(began) < _FAR_S else 0.0
        found[foot.foot] = run(np.broadcast_to(load[..., None], shape), t_s + origin, warm)
    return found
