"""`clock`: the reference's clock is not what it is said to be. t_reference = offset + (1 + rate)·t_can."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.wrench import WrenchObservation
from .term import LEAST_SIZE, Setting, Term, TermColumns

LEAST_RATE = 1e-4  # that is a finding, of a declared clock and of the reference's own (formats.md)
RATES = (-3e-3, -1e-3, -3e-4, 3e-4, 1e-3, 3e-3)
EARLY_S = (0.005, 0.015, 0.04)


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Joint columns of a rate: what the reference says, less what it would say at times that run away from the middle.

    Beside it, where the offset is declared, what it would say 10 ms later: a rate that was wrong from the beginning is
    off in the middle, too. Readings that come early have no rate, but say that the declared offset is wrong.
    """
    seen = load.observation
    now = seen.reference.smooth_at(seen.reference_s)
    away_s = (seen.t_s - seen.t_s.mean()) * setting["rate"] + setting["early_s"]
    found = [now - seen.reference.smooth_at(seen.reference_s + away_s)]
    shifts_s = [-away_s]
    if setting["rate"] and not seen.offset_is_free:
        found.append(now - seen.reference.smooth_at(seen.reference_s + 0.01))
        shifts_s.append(np.full_like(away_s, -0.01))
    if seen.load_is_known:  # whose reference is smooth
        is_chamber_rate = seen.is_uniform and setting["rate"]  # beside a trial its own pace may differ as much
        least = _least_in_means(seen, found[0] * (LEAST_RATE / setting["rate"])) if is_chamber_rate else 1.0
        return TermColumns((setting,) * len(found), whole=np.stack(found, axis=-1), joint=True, in_means=least)
    variance = np.broadcast_to(seen.reference.noise**2, now.shape)
    echoes = [seen.reference.echo(shift_s) for shift_s in shifts_s]
    products, squares = (np.stack([variance * each[i][:, None] for each in echoes], axis=-1) for i in (0, 1))
    return TermColumns((setting,) * len(found), whole=np.stack(found, axis=-1), joint=True, echo=(products, squares))


def _least_in_means(seen: WrenchObservation, moved_pa: Array) -> float:
    """Share of the least size of an effect that `moved_pa` (N, 1) has, if it is smaller: a rate is no matter of size.

    What it moves readings by grows with the recording, and a rate that is a finding is one in a short recording, too.
    """
    known = np.isfinite(seen.weight_variance)
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    variance = np.where(known, seen.weight_variance, 1.0) * taxels  # of a taxel
    square = float(np.mean(np.broadcast_to(moved_pa, known.shape) ** 2 / variance, where=known))
    return min(square / LEAST_SIZE**2, 1.0)


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Whether a clock under a known load runs at a rate that is a finding: an offset alone is a delay, or early."""
    rate = settings[0]["rate"]
    return not (load_is_known and rate) or abs(rate * float(shares[0])) > LEAST_RATE


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """For each rate and, where the clock is declared to be that of the CAN frames, for readings too early."""
    if load.observation.rate_is_free:
        return []
    found = [_column(load, {"rate": rate, "early_s": 0.0}) for rate in RATES]
    if not load.observation.offset_is_free:
        found += [_column(load, {"rate": 0.0, "early_s": early_s}) for early_s in EARLY_S]
    return found


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Rate, and the offset in the middle of the recording beside that of the alignment."""
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
