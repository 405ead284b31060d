"""Cross-validated errors of the wrench with the model as handed in and with the selected set of terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..model.curves import CurveShares
from ..model.design import Design
from ..model.refine import Refined
from ..model.regression import Timing
from ..model.solve import MOST_ABSORBED, absorbed_std
from ..model.wrench_nuisance import UNKNOWN_TAXEL_STD
from .residual_tests import LackOfFit, lack_of_fit

FOLD_S = 4.0  # length of a held-out block
N_FOLDS = 5
SHARES = ("gain_", "like_")  # beginnings of the names of nuisance columns for taxels that do not work


@dataclass(frozen=True, slots=True, eq=False)
class HeldoutErrors:
    """Held-out RMS errors (c,), and the errors of all rows (N, c).

    If only the wrench is known, the c = 3 channels are f_z (N), m_x and m_y (N·m). If the load of every taxel is known
    (`count_errors`), there is c = 1 channel in counts: the RMS over all taxels, and the mean error of a row.
    """

    before: Array  # of the model as handed in
    after: Array  # of the selected set
    floor: Array  # of a correct model
    course_before: Array  # (N, c) errors of the rows
    course_after: Array
    known: NDArray[np.bool_]  # (N,) rows with a known reference
    lack_of_fit: LackOfFit  # of the residual of the selected set
    gains: tuple[
        float, ...
    ]  # reduction of the mean square by each candidate, added in `order`: of f_z in N², or counts²
    timing_gain: float  # reduction of the mean square by delay and lag of the whole insole, which enter first
    base_shares: Array  # (b,) of the nuisance columns in the fit of the selected set
    recalibrated: CurveShares | None = None  # errors of a chamber's curves that contain the mean curve of a memory

    @property
    def of_the_model_handed_in(self) -> HeldoutErrors:
        """Return the errors of a model without any effect: those after are those before."""
        return replace(
            self, after=self.before, course_after=self.course_before, floor=np.minimum(self.floor, self.before)
        )

    @property
    def residual_fraction(self) -> float:
        """Return the fraction, 0 to 1, of the mean square beyond the floor that the set leaves, of f_z or counts."""
        before, after, floor = (float(each[0]) for each in (self.before, self.after, self.floor))
        if before <= floor:
            return 0.0
        return min(max(after**2 - floor**2, 0.0) / (before**2 - floor**2), 1.0)


def wrench_errors(
    design: Design,
    refined: Refined[Design],
    order: Sequence[int],
    timing: Timing,
    nuisances: Sequence[int] = (),
    uncertain_s: float = 0.0,
) -> HeldoutErrors:
    """Return the held-out errors of the wrench by a refined set whose candidates are added in `order`.

    `timing`: delay and lag of the whole insole. `before` has the model as handed in, after the alignment that the
    tolerance of the clocks permits: a free offset, the candidates `nuisances`, and a delay of `uncertain_s`.
    """
    seen, base = design.load.observation, design.base
    weights = design.weights
    n, known = len(seen.t_s), weights[:, 0] > 0
    size = np.where(weights > 0, 1.0 / np.maximum(weights, 1e-300), 0.0)
    # A free clock is aligned in the model as handed in, too: its offset is no effect.
    aligned_s = seen.reference_s - (timing.delay_s if seen.offset_is_free else uncertain_s)
    as_read = ((seen.reference.at(aligned_s) - seen.wrench) * weights).ravel()
    late = seen.reference.at(seen.reference_s - timing.delay_s, timing.lag_s)
    y = ((late - seen.wrench) * weights).ravel()
    aligning = np.array([name in ("offset_s", "rate") or name.startswith("time_") for name in base.names])
    substituted = (base.prior_std >= UNKNOWN_TAXEL_STD) & np.array([each.startswith(SHARES) for each in base.names])
    raw = refined.design.raw.astype(np.float64)
    fit, law = _Columns.of(refined), _Columns.of(refined.of_laws)
    columns = np.concatenate([base.matrix, fit.free], axis=1)
    prior = np.concatenate([base.prior_std, fit.prior_std])
    kept = np.concatenate([aligning | substituted, np.ones(fit.free.shape[1], bool)])
    of_law = np.concatenate([base.matrix, law.free], axis=1)
    law_prior = np.concatenate([base.prior_std, law.prior_std])
    law_kept = np.concatenate([aligning | substituted, np.ones(law.free.shape[1], bool)])
    fold = np.repeat((np.arange(n) * seen.step_s // FOLD_S).astype(int) % N_FOLDS, 3)
    after = np.empty_like(y)
    for k in range(N_FOLDS):
        held = fold == k
        shares = _within_bounds(of_law[~held], law_prior, (y - law.fixed)[~held], len(law.companions))
        # Recalibration within its prior is a nuisance and is not in the exported model.
        after[held] = (y - law.fixed - of_law[:, law_kept] @ shares[law_kept])[held]
    fixed, every = fit.fixed, ridge(columns, prior, y - fit.fixed)
    for i in nuisances:
        as_read = as_read - raw[:, refined.design.candidates[i].columns] @ refined.shares[i]
    before = as_read - base.matrix[:, aligning] @ ridge(base.matrix[:, aligning], base.prior_std[aligning], as_read)
    b = len(base.names)
    moved = y - base.matrix[:, aligning] @ ridge(base.matrix[:, aligning], base.prior_std[aligning], y)
    started, previous = (float(np.mean((each.reshape(n, 3) * size)[known, 0] ** 2)) for each in (before, moved))
    timing_gain, gains = max(started - previous, 0.0), []
    for m in range(1, len(order) + 1):
        part = np.concatenate([refined.design.candidates[i].columns for i in order[:m]])
        shares = np.concatenate([refined.shares[i] for i in order[:m]])
        left = y - raw[:, part] @ shares
        shift = ridge(base.matrix, base.prior_std, left)
        left = left - base.matrix[:, aligning | substituted] @ shift[aligning | substituted]
        square = float(np.mean((left.reshape(n, 3) * size)[known, 0] ** 2))
        gains.append(max(previous - square, 0.0))
        previous = min(previous, square)
    whole_fit = (y - fixed - columns @ every).reshape(n, 3)
    lack = lack_of_fit(whole_fit[known], seen.step_s)
    courses = [each.reshape(n, 3) * size for each in (before, after)]
    rms = [np.sqrt(np.mean(course[known] ** 2, axis=0)) for course in courses]
    # The floor contains the noise and the error of a calibration within its prior, but not the lack of fit.
    settled = (y - fixed - columns[:, kept] @ every[kept]).reshape(n, 3) * size
    unexplained = np.minimum(lack.excess / np.maximum(np.mean(whole_fit[known] ** 2, axis=0), 1e-12), 0.95)
    floor = np.sqrt(np.mean(settled[known] ** 2, axis=0) * (1.0 - unexplained))
    return HeldoutErrors(
        rms[0], rms[1], np.minimum(floor, rms[1]), courses[0], courses[1], known, lack, tuple(gains), timing_gain,
        every[:b],
    )  # fmt: skip


def _within_bounds(columns: Array, prior_std: Array, y: Array, n_companions: int) -> Array:
    """Return the coefficients of `ridge`, in which the last `n_companions` are at most MOST_ABSORBED deviations.

    What exceeds its bound is held there, and the rest is fitted again, as in the search (`model.solve`).
    """
    shares = ridge(columns, prior_std, y)
    bound = np.full(len(shares), np.inf)
    bound[len(shares) - n_companions :] = MOST_ABSORBED * prior_std[len(shares) - n_companions :]
    held = np.zeros(len(shares), bool)
    while np.any(over := ~held & (np.abs(shares) > bound)):
        held |= over
        shares[held] = np.clip(shares[held], -bound[held], bound[held])
        shares[~held] = ridge(columns[:, ~held], prior_std[~held], y - columns[:, held] @ shares[held])
    return shares


@dataclass(frozen=True, slots=True, eq=False)
class _Columns:
    """Columns of a refined set: the sum of those with a fixed share, and those with a free one."""

    fixed: Array  # (3N,)
    free: Array  # (3N, k), companions last
    prior_std: Array  # (k,)
    companions: NDArray[np.intp]  # numbers in the design

    @staticmethod
    def of(refined: Refined[Design]) -> _Columns:
        raw, candidates = refined.design.raw.astype(np.float64), refined.design.candidates
        own = np.concatenate([each.columns for each in candidates] or [np.empty(0, np.intp)])
        companions = np.setdiff1d(np.arange(raw.shape[1]), own)
        active = np.concatenate([*refined.shares, np.empty(0)]) != 0
        is_fixed = np.concatenate(
            [np.full(len(each.columns), each.term.share == "whole") for each in candidates] or [np.empty(0, bool)]
        )
        free = own[active & ~is_fixed]
        absorbed = absorbed_std(candidates, [float(np.abs(each).sum()) for each in refined.shares], companions)
        return _Columns(
            raw[:, own[active & is_fixed]].sum(axis=1),
            raw[:, np.concatenate([free, companions]).astype(np.intp)],
            np.concatenate([np.full(len(free), np.inf), absorbed]),
            companions,
        )


def ridge(columns: Array, prior_std: Array, y: Array) -> Array:
    """Return the coefficients θ (k,) that minimise |y − X·θ|² + Σ (θ/σ)², with X (N, k) and prior_std σ (k,)."""
    if not columns.shape[1]:
        return np.empty(0)
    gram = columns.T @ columns + np.diag(prior_std**-2.0)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inner = gram / scale[:, None] / scale + 1e-12 * np.eye(len(gram))
    return np.asarray(np.linalg.solve(inner, columns.T @ y / scale) / scale)
