"""Remainder of a load before the recording in a memory; it decays from the first row on. A companion of creep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns, needs_known_load

TAUS_S = (3.0, 12.0, 48.0)
SCALE_PA = 1e3


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: a pressure of 1 kPa that decays with each time constant."""
    t_s = load.observation.t_s - load.observation.t_s[0]
    wrench = load.wrench_of(np.full_like(load.pressure_pa, SCALE_PA))
    columns = np.stack([wrench * np.exp(-t_s / tau_s)[:, None, None] for tau_s in TAUS_S], axis=-1)
    return [TermColumns(tuple({"tau_s": tau_s} for tau_s in TAUS_S), by_triangle=columns, joint=True)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return no parameters: the term is never reported."""
    return {}


TERM = Term(
    word="earlier_load",
    scopes=("insole", "board", "triangle"),
    share="free",
    columns=_columns,
    parameters=_parameters,
    needs=needs_known_load,
    is_internal=True,
)
