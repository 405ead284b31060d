"""`creep` of the whole insole on a walk, by the wrench of its reference.

A linear law that is the same everywhere makes of the sum what it makes of each part: F_read = F − Σ a_k·(F − z_k), with
z_k the reference after a low pass. That is exact however much comes late, where undoing the law on readings amplifies
all they are wrong by. What a calibration has absorbed of it is a share of the reference, too: a share of the readings
beside it would stand for any error at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from . import creep
from .term import Setting, Term, TermColumns

CALIBRATED = "calibrated_creep"
LEAST_SLOW = 0.3  # of the shares
ABSORBED = 0.5  # of a share that creeps: what a calibration had of it


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Whether a good part goes on for longer than a viscoelasticity does: a little may be a calibration's error."""
    slow = np.array([setting["tau_s"] for setting in settings]) > creep.SLOW_S
    return bool(shares[slow].sum() > LEAST_SLOW * shares.sum())


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Joint columns: F − z for time constants from half a second to the length of the recording."""
    if load.is_known:
        return []
    seen = load.observation
    longest_s = float(np.ptp(seen.t_s))
    n = np.ceil(np.log(longest_s / creep.FASTEST_S) / np.log(creep.RATIO))
    taus_s = [*(creep.FASTEST_S * creep.RATIO ** np.arange(n)).tolist(), longest_s]
    said = seen.reference.smooth_at(seen.reference_s)
    late = [said - seen.reference.smooth_at(seen.reference_s, tau_s) for tau_s in taus_s]
    return [TermColumns(tuple({"tau_s": tau_s} for tau_s in taus_s), whole=np.stack(late, axis=-1), joint=True)]


def _share(load: LoadEstimate) -> list[TermColumns]:
    """One column: the reference."""
    if load.is_known:
        return []
    return [TermColumns(({},), whole=load.observation.reference.smooth_at(load.observation.reference_s)[..., None])]


TERM = replace(
    creep.TERM,
    scopes=("insole",),
    columns=_columns,
    absorbs={CALIBRATED: ABSORBED},
    is_of_load=True,
    is_possible=_is_possible,
)
SHARE = Term(
    word=CALIBRATED,
    scopes=("insole",),
    share="free",
    columns=_share,
    parameters=lambda settings, shares: {},
    is_internal=True,
)
