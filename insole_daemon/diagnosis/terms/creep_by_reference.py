"""`creep` of the whole insole on a walk, computed from the wrench of the reference.

A linear law that is the same on all taxels holds for the sum of their loads: F_read = F − Σ a_k·(F − z_k), with F the
reference and z_k its low pass. This is exact for any a_k, whereas the inverse on readings amplifies their errors. The
static part that a calibration has absorbed is computed from the reference, too, because a share of the readings could
describe any error.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..load_estimate import LoadEstimate
from . import creep
from .term import Term, TermColumns

CALIBRATED = "calibrated_creep"
ABSORBED = 0.5  # prior standard deviation of the absorbed static part, per share that creeps


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: F − z for time constants from half a second to the length of the recording."""
    if load.is_known:
        return []
    seen = load.observation
    longest_s = float(np.ptp(seen.t_s))
    n = np.ceil(np.log(longest_s / creep.FASTEST_S) / np.log(creep.RATIO))
    taus_s = [*(creep.FASTEST_S * creep.RATIO ** np.arange(n)).tolist(), longest_s]
    wrench = seen.reference.smooth_at(seen.reference_s)
    late = [wrench - seen.reference.smooth_at(seen.reference_s, tau_s) for tau_s in taus_s]
    return [TermColumns(tuple({"tau_s": tau_s} for tau_s in taus_s), whole=np.stack(late, axis=-1), joint=True)]


def _share(load: LoadEstimate) -> list[TermColumns]:
    """Return one column: the reference."""
    if load.is_known:
        return []
    return [TermColumns(({},), whole=load.observation.reference.smooth_at(load.observation.reference_s)[..., None])]


TERM = replace(
    creep.TERM,
    scopes=("insole",),
    columns=_columns,
    absorbs={CALIBRATED: ABSORBED},
    is_of_load=True,
    is_of_reference=True,
    is_possible=creep.is_possible_on_walks,
)
SHARE = Term(
    word=CALIBRATED,
    scopes=("insole",),
    share="free",
    columns=_share,
    parameters=lambda settings, shares: {},
    is_of_reference=True,
    is_internal=True,
)
