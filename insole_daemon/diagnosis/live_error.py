"""Error of what the daemon would publish on another day for a recording: pressure in a chamber, f_z of a walk."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..calibration.clock import Clock
from ..calibration.samples import align_by_prediction, usable_slots
from ..calibration.trials import CalibrationTrial, prepare_trials
from ..config import Foot
from ..errors import CalibrationError
from ..physics import calibration as calibrations
from ..physics.dynamic import DynamicModel, LeftOut
from ..physics.law import Array
from ..recording.estimate import estimate
from ..recording.loading import Recording, as_configured

LATER_NS = 2 * 86_400 * 10**9  # after the recording, so that effects of one day (a re-zero, a drift) do not apply


@dataclass(frozen=True, slots=True)
class LiveError:
    """RMS error of the daemon's output with one model."""

    value: float
    unit: str  # kPa of every valid taxel in a chamber; N of f_z
    left_out: tuple[LeftOut, ...]  # effects of the model that the daemon does not undo, and why


def live_error(model: Path, recording: Recording, foot: Foot) -> LiveError:
    """Return the error of the calibration in the file `model`, with its effects, on the clock that fits it best.

    Raises DocumentError if the file is not valid, CalibrationError if the recording has no suitable reference or the
    daemon masks all of it.
    """
    (trial,), _ = prepare_trials([recording], foot)
    if not usable_slots(trial).any():
        raise CalibrationError(
            f"{trial.name}: the daemon masks every taxel for most of the time, because readings without load wander"
        )
    foot_recording, layout = trial.foot, trial.layout
    calibration = calibrations.load(model, layout)
    boards = [as_configured(board) for board in foot_recording.boards]
    t_ns = foot_recording.t_ns + LATER_NS
    live = DynamicModel(layout, calibration, boards, int(t_ns[0]), zeroed=False)
    valid = trial.valid.reshape(foot_recording.counts.shape) & calibration.usable
    output = estimate(layout, calibration, boards, t_ns, foot_recording.counts, valid, zeroed=False)
    late_s = (live.late_ns - live.late_ns.min()) * 1e-9  # of each triangle, behind the stamp of the cycle
    if trial.kind == "shoe":
        wrench = np.stack([output.wrench.f_z_n, output.wrench.m_x_nm, output.wrench.m_y_nm], axis=1).astype(np.float64)
        clock = align_by_prediction(trial, np.nan_to_num(wrench))
        deviation = wrench[:, 0] - _reference(trial, clock, trial.t_s)
        return LiveError(float(np.sqrt(np.nanmean(deviation**2))), "N", live.left_out)
    pressure_pa = np.where(output.valid, output.pressure_pa, np.nan)
    clock = align_by_prediction(trial, np.nan_to_num(np.nanmean(pressure_pa, axis=(1, 2)))[:, None])
    load = np.stack([_reference(trial, clock, trial.t_s - late) for late in late_s.tolist()], axis=1)
    deviation = pressure_pa - load[:, :, None]
    return LiveError(1e-3 * float(np.sqrt(np.nanmean(deviation**2))), "kPa", live.left_out)


def _reference(trial: CalibrationTrial, clock: Clock, t_s: Array) -> Array:
    """Return the first column of the reference at times `t_s` (n,) of the recording, (n,); NaN outside it."""
    read = trial.readings
    is_known = np.isfinite(read.values[:, 0])
    wanted_s = clock.reference_s(t_s)
    return np.asarray(np.interp(wanted_s, read.t_s[is_known], read.values[is_known, 0], left=np.nan, right=np.nan))
