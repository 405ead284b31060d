"""`clock`: the clock of the reference deviates from the declared one. t_reference = offset + (1 + rate)·t_can."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.wrench import WrenchObservation
from .term import LEAST_SIZE, Setting, Term, TermColumns

LEAST_RATE = 1e-4  # smallest rate that is a finding (formats.md)
RATES = (-3e-3, -1e-3, -3e-4, 3e-4, 1e-3, 3e-3)
EARLY_S = (0.005, 0.015, 0.04)  # by which readings are early


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return joint columns of a rate: the reference, minus itself at times whose deviation grows from the middle.

    If the offset is declared, a second column is the reference minus itself 10 ms later, because a rate that is wrong
    from the start of the recording gives an offset in the middle. For readings that are early, the rate is 0 and the
    single column is that of a wrong offset.
    """
    seen = load.observation
    now = seen.reference.smooth_at(seen.reference_s)
    away_s = (seen.t_s - seen.t_s.mean()) * setting["rate"] + setting["early_s"]
    columns = [now - seen.reference.smooth_at(seen.reference_s + away_s)]
    shifts_s = [-away_s]
    if setting["rate"] and not seen.offset_is_free:
        columns.append(now - seen.reference.smooth_at(seen.reference_s + 0.01))
        shifts_s.append(np.full_like(away_s, -0.01))
    if seen.load_is_known:  # such a reference is smooth, so its noise has no echo
        # The pace of a person differs from that of a simulated trial by as much as the smallest rate.
        is_chamber_rate = seen.is_uniform and setting["rate"]
        least = _least_in_means(seen, columns[0] * (LEAST_RATE / setting["rate"])) if is_chamber_rate else 1.0
        return TermColumns((setting,) * len(columns), whole=np.stack(columns, axis=-1), joint=True, in_means=least)
    variance = np.broadcast_to(seen.reference.noise**2, now.shape)
    echoes = [seen.reference.echo(shift_s) for shift_s in shifts_s]
    products, squares = (np.stack([variance * each[i][:, None] for each in echoes], axis=-1) for i in (0, 1))
    return TermColumns(
        (setting,) * len(columns), whole=np.stack(columns, axis=-1), joint=True, echo=(products, squares)
    )


def _least_in_means(seen: WrenchObservation, moved_pa: Array) -> float:
    """Return the mean square of `moved_pa` (N, 1) relative to that of the smallest effect, at most 1.

    The effect of a rate grows with the duration of the recording. This factor lowers the required size, so that the
    smallest rate is a finding in a short recording, too.
    """
    known = np.isfinite(seen.weight_variance)
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    variance = np.where(known, seen.weight_variance, 1.0) * taxels  # of one taxel
    square = float(np.mean(np.broadcast_to(moved_pa, known.shape) ** 2 / variance, where=known))
    return min(square / LEAST_SIZE**2, 1.0)


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Return whether a rate is large enough for a finding, if the load is known."""
    rate = settings[0]["rate"]
    return not (load_is_known and rate) or abs(rate * float(shares[0])) > LEAST_RATE


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return the columns of each rate and, if the offset is declared, of readings that are early."""
    if load.observation.rate_is_free:
        return []
    columns = [_column(load, {"rate": rate, "early_s": 0.0}) for rate in RATES]
    if not load.observation.offset_is_free:
        columns += [_column(load, {"rate": 0.0, "early_s": early_s}) for early_s in EARLY_S]
    return columns


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return the rate, and the offset in the middle of the recording relative to that of the alignment, s."""
    offset_s = settings[0]["early_s"] * shares[0] + (0.01 * shares[1] if len(shares) > 1 else 0.0)
    return {"offset_s": float(offset_s), "rate": float(settings[0]["rate"] * shares[0])}


TERM = Term(
    word="clock",
    scopes=("insole",),
    share="free",
    columns=_columns,
    parameters=_parameters,
    plausible=1.0,
    limit=30.0,
    misfit=0.0005,
    refine=("rate",),
    column=_column,
    is_possible=_is_possible,
)
