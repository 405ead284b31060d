"""What the models leave of readings that they were not fitted to, block by block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..diagnosing import Diagnosis
from ..fit import Evidence, Fitted, Hypothesis
from ..groups import Named
from ..naming import N_FOLDS, Tried, folds

HOLD = 0.03  # of the span within a second: less is a hold


@dataclass(frozen=True, slots=True, eq=False)
class Untouched:
    """Mean over the taxels of one group, n blocks: activation in counts, and the load that was on them."""

    named: Named | None  # None: all taxels, nothing was named
    recording: NDArray[np.intp]  # (n,)
    t_s: Array  # (n,)
    load_pa: Array  # (n,)
    rate_pa_s: Array  # (n,)
    count: Array  # (n,) below rest
    before: Array  # (n,) what the static model leaves of held-out blocks
    after: Array  # (n,) what the best explanation leaves of them

    @property
    def span_pa(self) -> float:
        """Of the load."""
        return float(np.ptp(self.load_pa))

    @property
    def explained(self) -> bool:
        """Whether there is an explanation to be drawn."""
        return self.named is not None and bool(self.named.naming.best.words)

    @property
    def held_s(self) -> Array:
        """(n,) how long the load has stood still; NaN while it moves."""
        still = np.abs(self.rate_pa_s) < HOLD * self.span_pa
        found, since = np.full(len(self.t_s), np.nan), 0
        for at in range(len(self.t_s)):
            if not still[at] or (at and self.recording[at] != self.recording[at - 1]):
                since = at
            if still[at]:
                found[at] = self.t_s[at] - self.t_s[since]
        return found


def untouched(diagnosis: Diagnosis) -> list[Untouched]:
    """Of every group that was named, the largest mismatch first; of all taxels where none was."""
    located, insole = diagnosis.located, diagnosis.insole
    if not located.named:
        every = Tried((), located.null, 1.0)
        return [_of(diagnosis, None, located.taxels, insole.slots, every, every)]
    ranked = sorted(located.named, key=insole.mean_square, reverse=True)
    return [
        _of(diagnosis, each, each.group.taxels, each.group.slots, each.naming.null, each.naming.best) for each in ranked
    ]


def _of(
    diagnosis: Diagnosis, named: Named | None, taxels: Evidence, slots: NDArray[np.intp], null: Tried, best: Tried
) -> Untouched:
    noise = diagnosis.insole.noise_of(slots)
    plain = Hypothesis(taxels, ())
    n_clock = len(plain.start)
    load_pa = plain.effective_pa(best.fitted.theta[:n_clock]).mean(axis=1)
    t_s = np.concatenate([each.t_s for each in taxels.observed])
    recording = taxels.recording
    rate = np.concatenate(
        [np.gradient(load_pa[recording == i], t_s[recording == i]) for i in range(len(taxels.observed))]
    )
    count = (taxels.y * noise).mean(axis=1)
    resting = load_pa <= load_pa.min() + HOLD * np.ptp(load_pa)
    return Untouched(
        named, recording, t_s, load_pa, rate, count - float(np.median(count[resting])),
        (_held_out(taxels, null) * noise).mean(axis=1), (_held_out(taxels, best) * noise).mean(axis=1),
    )  # fmt: skip


def _held_out(taxels: Evidence, tried: Tried) -> Array:
    """(n, m) each block left by a fit that has not seen it, in units of noise."""
    hypothesis = Hypothesis(taxels, tried.fitted.candidates)
    fold = folds(taxels)
    left = np.empty(taxels.y.shape)
    for i in range(N_FOLDS):
        theta = tried.fitted.theta if tried.thetas is None else tried.thetas[i]
        fitted: Fitted = hypothesis.fit(theta, fold != i, most_steps=0)
        left[fold == i] = fitted.residual[fold == i]
    return left
