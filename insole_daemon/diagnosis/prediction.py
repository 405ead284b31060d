"""What a model says the insole would read: `model.json` run forward on the load of a recording."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..physics import calibration as calibrations
from ..physics.calibration import BEGAN, Calibration
from ..physics.chain import Chain
from ..physics.law import Array
from ..recording.loading import FootRecording, Recording, as_configured, load
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from .audit import Audit, audit
from .observations.chamber import ChamberObservation, observe_chamber
from .observations.paired import load_at as simulated_load
from .observations.paired import observe_paired

_MOST_ALIGNED = 12  # times that the clock is moved by what the model leaves
_ALIGNED_S = 5e-4  # by less it is not moved again
MOST_LATER_S = 0.5  # in one go: edges tell a clock more nearly
_FAR_S = 86_400.0  # a recording of another day: its times have nothing to do with the model's


def of_folder(model: Path, recording: Path, simulation: Path | None) -> dict[str, Array]:
    """`counts` of the recording in a folder, for programs that know files alone."""
    return counts(model, load(recording), None if simulation is None else load(simulation))


def counts(model: str | PathLike[str], recording: Recording, simulation: Recording | None = None) -> dict[str, Array]:
    """By foot, (n, n_triangles, 12) mean counts that `model` expects in every cycle; NaN on thermal pads alone.

    Of a taxel that the model leaves out the recording's own calibration tells the curve, and of one that says nothing
    to believe all through the recording, its usual count. Nothing is read beyond 0 and 255. The load is the
    reference's, or that of a `simulation` of the same trial; a clock of its own is aligned by the edges, and then by
    what the model itself says. DocumentError where the model is wrong.
    """
    found: dict[str, Array] = {}
    for foot in recording.feet:
        if foot.reference is None and simulation is None:
            continue
        layout = foot.layout
        calibration = _completed(calibrations.load(model, layout), foot.calibration)
        chain = Chain(calibration.effects, layout, calibration, [as_configured(board) for board in foot.boards])
        audited = audit(foot, recording.folder.name, simulation is not None)
        t_s = np.maximum.accumulate((foot.t_ns - foot.t_ns[0]) * 1e-9)
        began = (foot.t_ns[0] - int(calibration.provenance.get(BEGAN, foot.t_ns[0]))) * 1e-9
        origin = began if abs(began) < _FAR_S else 0.0
        # Each triangle was read as long ago as it is old.
        read_s = t_s[:, None] - foot.behind_ns * 1e-9
        own_clock, warm = True, None
        if simulation is not None:
            paired = observe_paired(recording, foot, foot.calibration or calibration, simulation)
            load_at = simulated_load(paired, chain.xy_m)
        else:
            seen = observe_chamber(recording, foot, foot.calibration or calibration)
            own_clock = seen.declared_offset_s is None
            warm = None if seen.temperature_c is None else np.interp(t_s, seen.t_s, seen.temperature_c)
            load_at = partial(_everywhere, seen)
        late_s = np.zeros(len(t_s))
        for _ in range(_MOST_ALIGNED if own_clock else 1):
            expected = chain.forward()(load_at(read_s + late_s[:, None]), t_s + origin, warm)
            later_s = _later_s(expected, foot, audited.kept, t_s)
            late_s += later_s
            if np.abs(later_s).max() < _ALIGNED_S:
                break
        found[foot.foot] = np.clip(np.where(_silent(audited, calibration), _usual(foot), expected), 0.0, 255.0)
    return found


def _completed(model: Calibration, calibration: Calibration | None) -> Calibration:
    """`model` with the curves of `calibration` for the taxels that it does not list."""
    if calibration is None:
        return model
    coefficients = [each.coefficients_pa for each in (model, calibration)]
    k = max(each.shape[-1] for each in coefficients)
    own, other = (np.pad(each, ((0, 0), (0, 0), (0, k - each.shape[-1]))) for each in coefficients)
    listed = model.usable
    return replace(
        model,
        baseline_count=np.where(listed, model.baseline_count, calibration.baseline_count),
        coefficients_pa=np.where(listed[..., None], own, other),
        usable=listed | calibration.usable,
        covariance_pa2=None,
        highest_count=None,
    )


def _silent(audited: Audit, calibration: Calibration) -> NDArray[np.bool_]:
    """(n_triangles, 12) taxels of which no curve tells what they read."""
    found: NDArray[np.bool_] = PRESSURE_TAXELS & ~(calibration.usable & audited.believed.any(axis=0))
    return found


def _usual(foot: FootRecording) -> Array:
    """(n_triangles, 12) the count that each taxel says most of the time."""
    return np.asarray(np.median(foot.counts, axis=0), np.float64)


def _everywhere(seen: ChamberObservation, read_s: Array) -> Array:
    """(n, n_triangles, 12) Pa of a load that is the same on all taxels."""
    reference_s = seen.offset_s + (1.0 + seen.rate) * read_s.ravel()
    pressure = seen.reference.at(reference_s)[:, 0].reshape(read_s.shape)
    return np.repeat(pressure[..., None], N_TAXELS, axis=2)


def _later_s(expected: Array, foot: FootRecording, kept: NDArray[np.bool_], t_s: Array) -> Array:
    """(n,) how much later in the load's time the readings are than `expected`, by the mean of the taxels kept.

    One time for all and one that grows: what is not in the model bends the edges by which clocks are told first.
    """
    asked = kept & ~np.isnan(expected[0])
    said, model = foot.counts[:, asked].mean(axis=1), expected[:, asked].mean(axis=1)
    slope = np.gradient(model, t_s + 1e-9 * np.arange(len(t_s)))
    grows = np.stack([np.ones_like(t_s), t_s / max(float(t_s[-1]), 1e-9) - 0.5], axis=1)
    moves = slope[:, None] * grows
    design = np.concatenate([np.ones_like(grows[:, :1]), moves], axis=1)
    shares = np.linalg.lstsq(design, said - model, rcond=None)[0]
    return np.asarray(np.clip(grows @ shares[1:], -MOST_LATER_S, MOST_LATER_S))
