"""`reference_fault`: the reference has an offset, a step or a drift, independent of the load.

Its spikes are detected in its rows, not here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.paired import PairedObservation
from .term import Setting, Term, TermColumns, moments_s

IN_AIR = 0.05  # of the force's range above its minimum: below it the foot is in the air
ZERO = 1.5  # times the noise of a row: an offset below it is none


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return joint columns: a step of 1 in each channel of the reference (N and N·m, or Pa)."""
    channels = len(load.observation.reference.noise)
    since = (load.observation.t_s >= setting["t_s"]).astype(float)
    return TermColumns((setting,) * channels, whole=since[:, None, None] * np.eye(channels), joint=True)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return columns of steps at all moments, of a drift and, if the load is not known, of a constant offset.

    The drift is a cubic in time (Legendre polynomials), with its mean unless the reference is zero in the air, or free
    curves contain it.
    """
    t_s, channels = load.observation.t_s, len(load.observation.reference.noise)
    steps = [_column(load, {"t_s": float(at)}) for at in moments_s(load)]
    x = (t_s - t_s.mean()) / (np.ptp(t_s) / 2)
    powers = np.stack([np.ones_like(x), x, 1.5 * x**2 - 0.5, 2.5 * x**3 - 1.5 * x], axis=-1)
    has_offset = not (load.observation.has_free_curves if load.is_known else _is_zero_in_air(load))
    if not has_offset:
        powers = powers[:, 1:]
    drift = (powers[:, None, :, None] * np.eye(channels)[None, :, None, :]).reshape(len(t_s), channels, -1)
    blocks = [*steps, TermColumns(({"t_s": np.nan},) * drift.shape[-1], whole=drift, joint=True)]
    if load.is_known or not has_offset:
        return blocks
    constant = np.broadcast_to(np.eye(channels), (len(t_s), channels, channels))
    return [TermColumns(({"always": 1.0},) * channels, whole=constant, joint=True, is_recalibration=True), *blocks]


def _is_zero_in_air(load: LoadEstimate) -> bool:
    """Return whether the reference is zero while the foot is in the air, so that it has no offset."""
    reference = load.observation.reference
    wrench = reference.at(load.observation.reference_s)
    low, high = np.quantile(wrench[:, 0], (0.01, 0.99))
    in_air = wrench[:, 0] < low + IN_AIR * (high - low)
    return bool(np.all(np.abs(np.median(wrench[in_air], axis=0)) < ZERO * reference.noise))


def _needs(load: LoadEstimate) -> str | None:
    """Return the reason why a recording cannot show the effect."""
    return "a simulation takes the place of the reference" if isinstance(load.observation, PairedObservation) else None


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return time and size of a step, or the offset; a drift has no parameters."""
    if "always" in settings[0]:
        return {"offset": [float(share) for share in shares]}
    if np.isnan(settings[0]["t_s"]):
        return {}
    return {"t_s": float(settings[0]["t_s"]), "step": [float(share) for share in shares]}


TERM = Term(
    word="reference_fault",
    scopes=("insole",),
    share="free",
    columns=_columns,
    parameters=_parameters,
    yields_to=("drift",),
    misfit=0.015,
    needs=_needs,
    refine=("t_s",),
    column=_column,
)
