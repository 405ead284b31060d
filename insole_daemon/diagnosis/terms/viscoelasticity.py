"""`viscoelasticity`: a part of the response is delayed. q = (1 − a)·P + a·z, τ·dz/dt = P − z.

The inverse, from readings: P = q + b·(q − z′), τ′·dz′/dt = q − z′, with a = b/(1 + b) and τ = τ′·(1 + b).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...physics.law import MOST_SHARED, Array
from ..load_estimate import LoadEstimate
from ..operators import low_pass
from .term import ABSORBED, Setting, Term, TermColumns, geometric

TAUS_S = geometric(0.04, 4.0, 6)
FAST_S, MOST_FAST = 0.3, 0.8  # the part of the response that is delayed by less than FAST_S is below MOST_FAST


def _columns(load: LoadEstimate) -> Iterator[TermColumns]:
    """Yield joint columns q − z′ for each pair of neighbouring time constants, which describe those in between.

    If the load is known, also for all time constants together: real materials have more than one.
    """
    wrench = load.by_triangle
    settings = load.wanted([{"tau_s": tau_s} for tau_s in TAUS_S])
    late = [wrench - low_pass(wrench, load.step_s, setting["tau_s"]) for setting in settings]
    spans = [(k, k + 2) for k in range(max(len(settings) - 1, 1))] + [(0, len(settings))] * load.is_known
    for a, b in spans:
        yield TermColumns(tuple(settings[a:b]), by_triangle=np.stack(late[a:b], axis=-1), joint=True)


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return a and τ, s, of the law: the sum of the shares, at their geometric mean time constant."""
    b = np.maximum(np.asarray(shares, float), 0.0)
    taus_s = np.array([setting["tau_s"] for setting in settings])
    total = float(b.sum())
    tau_s = float(np.exp(np.sum(b * np.log(taus_s)) / total)) if total > 0 else float(taus_s[0])
    return {"a": total / (1.0 + total), "tau_s": tau_s * (1.0 + total)}


def _known_parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return a and τ, s, if the load is known: the sum of the shares, at their geometric mean time constant."""
    a = np.maximum(np.asarray(shares, float), 0.0)
    total = max(float(a.sum()), 1e-9)
    tau_s = float(np.exp(np.sum(a * np.log([setting["tau_s"] for setting in settings])) / total))
    return {"a": total, "tau_s": tau_s}


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Return whether enough of the response is immediate, if the load is known: otherwise it is a lag or a delay."""
    fast = np.array([setting["tau_s"] for setting in settings]) < FAST_S
    return not load_is_known or float(np.asarray(shares)[fast].sum()) < MOST_FAST


TERM = Term(
    word="viscoelasticity",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    known_parameters=_known_parameters,
    plausible=0.1,
    limit=2.0,
    known_sum_bound=MOST_SHARED,
    absorbs=ABSORBED,
    is_possible=_is_possible,
    misfit=0.02,
    known_misfit=0.01,
)
