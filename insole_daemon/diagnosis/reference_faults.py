"""Faults of the reference itself: it stepped, or it drifted, and no taxel knows of it.

A reference that says too much by Δ moves the readings of all taxels at once, each by Δ times the slope of its curve at
the load of that moment. What happens to a sensor moves counts, whatever the slope: `rezero`, `drift`. Only where the
slopes differ enough with the load do the two leave different residuals. A fault is taken out of the load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..physics.law import Array
from . import jumps as jumping
from .candidate import Candidate
from .candidates.drift import knots_s
from .evidence import Taxels, gather
from .fit import Evidence, Fitted, Hypothesis
from .groups import LEAST_EXCESS, Located
from .observed import Observed

SIGMAS = 4.0
MOST_STEPS = 3
TAKES = 0.85  # of the mismatch, that a step has to take away: else it comes again, and is physics
SETTLES = 0.1  # of it, that a drift may leave
AS_WELL = 1.2  # times what a drift of the counts leaves, that one of the reference may leave: it has one course for all
HIDDEN = 0.01  # of the mismatch: where noise alone says as much, the two are not told apart
MOST_OF = 0.75  # of the taxels: a reference is the same for all
NEAR_S = 0.3  # how far a step may be from where it was seen first
KNOT_S, MOST_KNOTS = 5.0, 60
WORD = "reference_fault"


@dataclass(frozen=True, slots=True)
class Fault:
    """What the reference of one recording did."""

    recording: str
    kind: str  # step | drift
    when_s: tuple[tuple[float, float], ...]
    size_pa: float  # of the step; from the lowest to the highest of a drift
    explains_count2: float  # mean square of a reading that it takes away


def without_steps(observed: Sequence[Observed], noise_count: Array) -> tuple[list[Observed], list[Fault]]:
    """The recordings with the steps of their references taken out of the load, and what these were."""
    found = list(observed)
    faults: list[Fault] = []
    for i in range(len(found)):
        for _ in range(MOST_STEPS):
            stepped = _step(found[i], noise_count)
            if stepped is None:
                break
            found[i], fault = stepped
            faults.append(fault)
    return found, faults


def without_drift(
    observed: Sequence[Observed], noise_count: Array, located: Located
) -> tuple[list[Observed], list[Fault]]:
    """The recordings with the drift of their references taken out, where that explains what else is named a drift."""
    nothing: tuple[list[Observed], list[Fault]] = (list(observed), [])
    main = max(located.named, key=lambda each: len(each.group.slots), default=None)
    if main is None or len(main.group.slots) < MOST_OF * len(located.slots) or main.naming.best.words != ("drift",):
        return nothing  # memory beside it: a free course of the reference takes the place of either
    evidence, naming = main.group.evidence, main.naming
    alone = next((each for each in naming.tried if each.words == ("drift",)), naming.best)
    wandering, fitted = _wandering(evidence, naming.null.fitted.theta, knots_s)
    # Judged where both were fitted, which flatters the drift: it has a course for every taxel. One course, by the slope
    # of each taxel's curve, leaves as little only where the load is off: taxels answer differently to a load.
    left = (fitted.mean_square() - naming.floor) / naming.excess
    chance = SIGMAS * naming.floor * float(np.sqrt(2.0 / evidence.y.size)) / naming.excess
    if left > min(AS_WELL * alone.left, SETTLES) or chance > HIDDEN:
        return nothing
    wandering, fitted = _wandering(evidence, fitted.theta[: len(naming.null.fitted.theta)], _closer)
    explains = main.group.per_taxel((1.0 - max(left, 0.0)) * naming.excess) * float(np.mean(noise_count**2))
    corrected, faults = [], []
    for each, candidate, theta in zip(observed, wandering, fitted.values(), strict=True):
        assert candidate.act is not None
        pressure = candidate.act(each.load.pressure_pa, each.load.step_s, theta)
        corrected.append(replace(each, load=replace(each.load, pressure_pa=pressure)))
        faults.append(Fault(each.name, "drift", (), float(np.ptp(np.append(0.0, theta))), explains))
    return corrected, faults


def _wandering(evidence: Evidence, clocks: Array, knots: Callable[[float], Array]) -> tuple[list[Candidate], Fitted]:
    """The drift of every reference, and the fit of all of them together."""
    found = [_wander(each, knots(float(each.cycle_s[-1])), i) for i, each in enumerate(evidence.observed)]
    start = np.concatenate([clocks, *(each.starts[0] for each in found)])
    return found, Hypothesis(evidence, found).fit(start)


def _closer(seconds: float) -> Array:
    """Knots as close as one course for all taxels affords, where each taxel's own would need more readings."""
    return np.linspace(0.0, seconds, int(np.clip(round(seconds / KNOT_S) + 1, 3, MOST_KNOTS)))


def _step(seen: Observed, noise_count: Array) -> tuple[Observed, Fault] | None:
    """The largest step of the reference, taken out; None where there is none that stays."""
    group = gather(Taxels((seen,), seen.slots, noise_count), np.empty((len(seen.first), 0)))
    evidence = group.evidence
    hypothesis = Hypothesis(evidence, ())
    null = hypothesis.fit()
    above = null.mean_square() - group.floor
    if group.per_taxel(above) < LEAST_EXCESS**2:
        return None
    slope = hypothesis.slope(null)
    error_pa = np.sum(slope * null.residual, axis=1) / np.maximum(np.sum(slope**2, axis=1), 1e-30)
    at = jumping.abrupt(seen.t_s, error_pa)
    if at is None:
        return None
    first = _stepped(evidence, null, seen, at)
    if null.mean_square() - first[1].mean_square() < TAKES / 2 * above:
        return None
    near = np.arange(-NEAR_S, NEAR_S, seen.load.step_s).tolist()
    tried = [_stepped(evidence, first[1], seen, at + off) for off in near]
    t_s, fitted = min(tried, key=lambda each: each[1].cost)
    took = (null.mean_square() - fitted.mean_square()) / above
    moved = replace(evidence, jumps=(seen.t_s >= t_s).astype(float)[:, None])
    of_counts = Hypothesis(moved, ()).fit(null.theta)
    chance = SIGMAS * group.floor * float(np.sqrt(2.0 / evidence.y.size))
    if took < TAKES or fitted.mean_square() > of_counts.mean_square() + chance:
        return None
    size = float(fitted.theta[-1])
    later = seen.load.t_s >= seen.reference_s(np.array(t_s))
    load = replace(seen.load, pressure_pa=seen.load.pressure_pa - size * later[:, None])
    explains = group.per_taxel(took * above) * float(np.mean(noise_count**2))
    return replace(seen, load=load), Fault(seen.name, "step", ((t_s, float(seen.t_s[-1])),), size, explains)


def _stepped(evidence: Evidence, near: Fitted, seen: Observed, t_s: float) -> tuple[float, Fitted]:
    """The static model with a step of the reference at `t_s`, fitted from `near` on, with a step or without."""
    later = (seen.load.t_s >= seen.reference_s(np.array(t_s)))[:, None]
    span = float(np.ptp(seen.load.pressure_pa))

    def act(x: Array, step_s: float, theta: Array) -> Array:
        moved: Array = x - theta[0] * later
        return moved

    low, high = np.array([-span]), np.array([span])
    start = near.theta if near.candidates else np.append(near.theta, 0.0)
    candidate = Candidate(word=WORD, order=0, names=("step_pa",), low=low, high=high, starts=np.zeros((1, 1)), act=act)
    return t_s, Hypothesis(evidence, [candidate]).fit(start, most_steps=4)


def _wander(seen: Observed, knots: Array, recording: int) -> Candidate:
    """The drift of one reference: linear between knots, 0 at the first."""
    t_s = (seen.load.t_s - seen.offset_s) / (1.0 + seen.rate)
    hats = np.stack([np.interp(t_s, knots, hat) for hat in np.eye(len(knots))[1:]], axis=-1)
    span = float(np.ptp(seen.load.pressure_pa))

    def act(x: Array, step_s: float, theta: Array) -> Array:
        moved: Array = x - (hats @ theta)[:, None]
        return moved

    n = hats.shape[1]
    return Candidate(
        word=WORD, order=0, names=tuple(f"at_{t:.0f}_s" for t in knots[1:]), low=np.full(n, -span),
        high=np.full(n, span), starts=np.zeros((1, n)), act=act, recordings=frozenset({recording}),
    )  # fmt: skip
