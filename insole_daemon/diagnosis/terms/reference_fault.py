"""`reference_fault`: the reference is off, steps or wanders, whatever the insole bears.

Spikes are found apart, in its rows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.paired import PairedObservation
from .term import Setting, Term, TermColumns, moments_s

IN_AIR = 0.05  # of the force's range above its least: the foot is lifted
NOTHING = 1.5  # times the noise of a row


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Joint columns: a step of 1 in each channel of the reference (N and N·m, or Pa)."""
    channels = len(load.observation.reference.noise)
    since = (load.observation.t_s >= setting["t_s"]).astype(float)
    return TermColumns((setting,) * channels, whole=since[:, None, None] * np.eye(channels), joint=True)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Columns of steps at every moment, of a reference that wanders, and, where readings tell the load, a constant.

    Where the load is known, a reference that wanders begins anywhere.
    """
    t_s, channels = load.observation.t_s, len(load.observation.reference.noise)
    steps = [_column(load, {"t_s": float(at)}) for at in moments_s(load)]
    x = (t_s - t_s.mean()) / (np.ptp(t_s) / 2)
    powers = np.stack([np.ones_like(x), x, 1.5 * x**2 - 0.5, 2.5 * x**3 - 1.5 * x], axis=-1)
    if not load.is_known:
        powers = powers[:, 1:]
    wander = (powers[:, None, :, None] * np.eye(channels)[None, :, None, :]).reshape(len(t_s), channels, -1)
    found = [*steps, TermColumns(({"t_s": np.nan},) * wander.shape[-1], whole=wander, joint=True)]
    if load.is_known or _is_zero_in_air(load):
        return found
    constant = np.broadcast_to(np.eye(channels), (len(t_s), channels, channels))
    return [TermColumns(({"always": 1.0},) * channels, whole=constant, joint=True, is_recalibration=True), *found]


def _is_zero_in_air(load: LoadEstimate) -> bool:
    """Whether the reference says nothing while the foot is lifted: then no constant is wrong with it."""
    reference = load.observation.reference
    said = reference.at(load.observation.reference_s)
    low, high = np.quantile(said[:, 0], (0.01, 0.99))
    in_air = said[:, 0] < low + IN_AIR * (high - low)
    return bool(np.all(np.abs(np.median(said[in_air], axis=0)) < NOTHING * reference.noise))


def _needs(load: LoadEstimate) -> str | None:
    """Why a recording cannot show it."""
    return "a simulation stands for the reference" if isinstance(load.observation, PairedObservation) else None


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """When it stepped, and by how much; nothing where it wandered."""
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
