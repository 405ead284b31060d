"""Predict the readings of an insole: run `model.json` forward on the load of a recording."""

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

_MOST_ALIGNED = 12  # iterations of the alignment of the clock by the residual
_ALIGNED_S = 5e-4  # the alignment ends at a smaller correction
MOST_LATER_S = 0.5  # largest correction of one iteration: the edges have aligned the clock better than that
_FAR_S = 86_400.0  # a recording of another day: its times are unrelated to those of the model


def of_folder(model: Path, recording: Path, simulation: Path | None) -> dict[str, Array]:
    """Return `counts` of the recording in a folder, for programs that pass files."""
    return counts(model, load(recording), None if simulation is None else load(simulation))


def counts(model: str | PathLike[str], recording: Recording, simulation: Recording | None = None) -> dict[str, Array]:
    """Return the mean counts (n, n_triangles, 12) that `model` expects, by foot; NaN on thermal pads only.

    A taxel that the model leaves out gets its curve from the recording's calibration. A taxel without a usable reading
    in the whole recording gets its usual count. Counts are limited to 0 … 255. The load is that of the reference, or of
    a `simulation` of the same trial. A reference on its own clock is aligned by the edges, then by the residual of the
    model. Raises DocumentError if the model is not valid.
    """
    counts_by_foot: dict[str, Array] = {}
    for foot in recording.feet:
        if foot.reference is None and simulation is None:
            continue
        layout = foot.layout
        calibration = _completed(calibrations.load(model, layout), foot.calibration)
        chain = Chain(calibration.effects, layout, calibration, [as_configured(board) for board in foot.boards])
        audited = audit(foot, recording.folder.name, simulation is not None)
        t_s = np.maximum.accumulate((foot.t_ns - foot.t_ns[0]) * 1e-9)
        began_s = (foot.t_ns[0] - int(calibration.provenance.get(BEGAN, foot.t_ns[0]))) * 1e-9
        origin_s = began_s if abs(began_s) < _FAR_S else 0.0
        # Each triangle was read at the time of the cycle less its age.
        read_s = t_s[:, None] - foot.behind_ns * 1e-9
        own_clock, temperature_c = True, None
        if simulation is not None:
            paired = observe_paired(recording, foot, foot.calibration or calibration, simulation)
            load_at = simulated_load(paired, chain.xy_m)
        else:
            seen = observe_chamber(recording, foot, foot.calibration or calibration)
            own_clock = seen.declared_offset_s is None
            temperature_c = None if seen.temperature_c is None else np.interp(t_s, seen.t_s, seen.temperature_c)
            load_at = partial(_everywhere, seen)
        delay_s = np.zeros(len(t_s))
        for _ in range(_MOST_ALIGNED if own_clock else 1):
            expected = chain.forward()(load_at(read_s + delay_s[:, None]), t_s + origin_s, temperature_c)
            later_s = _later_s(expected, foot, audited.usable_taxels, t_s)
            delay_s += later_s
            if np.abs(later_s).max() < _ALIGNED_S:
                break
        counts_by_foot[foot.foot] = np.clip(np.where(_silent(audited, calibration), _usual(foot), expected), 0.0, 255.0)
    return counts_by_foot


def _completed(model: Calibration, calibration: Calibration | None) -> Calibration:
    """Return `model` with the curves of `calibration` for the taxels that it does not list."""
    if calibration is None:
        return model
    coefficients = [table.coefficients_pa for table in (model, calibration)]
    k = max(table.shape[-1] for table in coefficients)
    model_coefficients, other_coefficients = (
        np.pad(table, ((0, 0), (0, 0), (0, k - table.shape[-1]))) for table in coefficients
    )
    listed = model.usable
    return replace(
        model,
        baseline_count=np.where(listed, model.baseline_count, calibration.baseline_count),
        coefficients_pa=np.where(listed[..., None], model_coefficients, other_coefficients),
        usable=listed | calibration.usable,
        covariance_pa2=None,
        highest_count=None,
    )


def _silent(audited: Audit, calibration: Calibration) -> NDArray[np.bool_]:
    """Return the taxels whose readings no curve predicts, (n_triangles, 12)."""
    is_silent: NDArray[np.bool_] = PRESSURE_TAXELS & ~(calibration.usable & audited.usable_readings.any(axis=0))
    return is_silent


def _usual(foot: FootRecording) -> Array:
    """Return the median count of each taxel, (n_triangles, 12)."""
    return np.asarray(np.median(foot.counts, axis=0), np.float64)


def _everywhere(seen: ChamberObservation, read_s: Array) -> Array:
    """Return the pressure (n, n_triangles, 12) in Pa of a uniform load at times `read_s` (n, n_triangles)."""
    reference_s = seen.offset_s + (1.0 + seen.rate) * read_s.ravel()
    pressure = seen.reference.at(reference_s)[:, 0].reshape(read_s.shape)
    return np.repeat(pressure[..., None], N_TAXELS, axis=2)


def _later_s(expected: Array, foot: FootRecording, used_taxels: NDArray[np.bool_], t_s: Array) -> Array:
    """Return the delay of the readings against `expected` on the load's clock (n,), by the mean of `used_taxels`.

    The delay is a constant plus a linear term. It is estimated after the alignment by edges, because effects that are
    not in the model distort edges.
    """
    used = used_taxels & ~np.isnan(expected[0])
    read, model = foot.counts[:, used].mean(axis=1), expected[:, used].mean(axis=1)
    slope = np.gradient(model, t_s + 1e-9 * np.arange(len(t_s)))
    basis = np.stack([np.ones_like(t_s), t_s / max(float(t_s[-1]), 1e-9) - 0.5], axis=1)
    delay_columns = slope[:, None] * basis
    design = np.concatenate([np.ones_like(basis[:, :1]), delay_columns], axis=1)
    shares = np.linalg.lstsq(design, read - model, rcond=None)[0]
    return np.asarray(np.clip(basis @ shares[1:], -MOST_LATER_S, MOST_LATER_S))
