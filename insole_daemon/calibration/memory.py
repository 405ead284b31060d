"""Fit a taxel's curve and its memory (the laws `hysteresis` and `creep`) together to a known pressure.

With the pressure P, and the effective load q that the curve g converts to an activation x = baseline − count,

    q = P − Σ_j w_j·(P − play_rj[P]) − Σ_k a_k·(P − z_k[P])   and   q = g(x), so
    P = g(x) + Σ_j w_j·(P − play_rj[P]) + Σ_k a_k·(P − z_k[P])

This is linear in the coefficients of g, in w and in a, for given radii and time constants. The memory terms are
computed from the clean reference, never from noisy counts; products of w and a are neglected, a hundredth of P. g is 0
at the baseline and increases up to the highest activation seen, since its derivative is a sum of Bernstein polynomials
with coefficients ≥ 0; shares are ≥ 0 too. A share of 1 costs `stiffness` variances of the pressure, which distributes
over the memories what the data do not separate. `Chain.inverse` inverts the result causally.

Sources: play and its inverse, Kuhnen, Eur. J. Control 9 (2003) 407–418; Bernstein's basis keeps signs, Farouki, Comput.
Aided Geom. Des. 29 (2012) 379–419; weights, Beaton & Tukey, Technometrics 16 (1974) 147–185.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ..errors import CalibrationError
from ..physics.calibration import Calibration
from ..physics.chain import Chain
from ..physics.effect import Effect, Where, effect
from ..physics.law import MOST_SHARED
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout
from .clock import TUKEY

Array: TypeAlias = NDArray[np.float64]

_DEGREE = 3
_SHARE = 0.5  # share with which a memory term is computed before it is divided by it
_ROUNDS = 4  # iterations of the weights
_MIN_SAMPLES = 50

# (3, 3) coefficients of u, u², u³ in the integrals from 0 to u of Bernstein's quadratics (1−u)², 2u(1−u), u².
_BERNSTEIN = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [1 / 3, -2 / 3, 1 / 3]])


@dataclass(frozen=True, slots=True)
class Memories:
    """The parameters of the memory terms, shared by all taxels."""

    r_pa: tuple[float, ...] = ()  # radii of the play operators
    tau_s: tuple[float, ...] = ()  # time constants


@dataclass(frozen=True, slots=True, eq=False)
class MemoryCurves:
    """Curves and memory of m taxels."""

    memories: Memories
    coefficients_pa: Array  # (m, 4) powers 0 to 3; the first is 0
    w: Array  # (m, radii)
    a: Array  # (m, time constants)

    def effects(self, identities: tuple[tuple[int, int, int], ...]) -> tuple[Effect, ...]:
        """Return the memory as effects on the m taxels `identities` (board, triangle, taxel)."""
        where, ones = Where("taxel", identities), np.ones(len(identities))
        effects = []
        if self.memories.r_pa:
            r_pa = np.outer(self.memories.r_pa, ones)
            effects.append(effect("hysteresis", where, r_pa=r_pa, w=self.w.T))
        if self.memories.tau_s:
            tau_s = np.outer(self.memories.tau_s, ones)
            effects.append(effect("creep", where, a=self.a.T, tau_s=tau_s))
        return tuple(effects)


def memory_states(t_s: Array, pressure_pa: Array, memories: Memories, layout: Layout) -> Array:
    """Return (n, radii + time constants) what each memory withholds of `pressure_pa` (n,): P − play[P], P − z[P]."""
    one_triangle = replace(layout, triangles=layout.triangles[:1], xy_m=layout.xy_m[:1])
    load = np.broadcast_to(pressure_pa[:, None, None], (len(t_s), 1, N_TAXELS))
    laws = [effect("hysteresis", r_pa=[r], w=[_SHARE]) for r in memories.r_pa]
    laws += [effect("creep", a=[_SHARE], tau_s=[tau]) for tau in memories.tau_s]
    terms = [(pressure_pa - Chain([law], one_triangle).forward()(load, t_s)[:, 0, 0]) / _SHARE for law in laws]
    return np.stack(terms, axis=1) if terms else np.empty((len(t_s), 0))


def fit_memory(
    activation: Array, pressure_pa: Array, memory_terms: Array, memories: Memories, stiffness: float
) -> MemoryCurves:
    """Fit curves and shares of m taxels to n samples, in any order; NaN where a taxel has no reading.

    `activation` (n, m) is in counts below the baseline and smoothed, because noise would bend the curve and look like
    memory. `memory_terms` (n, …) are the `memory_states` of `memories` at the samples. Raises CalibrationError if a
    taxel has too few samples.
    """
    rows = np.stack([_fit_taxel(x, pressure_pa, memory_terms, stiffness) for x in activation.T])
    shares = rows[:, 1 + _DEGREE :]
    w, a = (_limit_shares(block) for block in np.split(shares, [len(memories.r_pa)], axis=1))
    return MemoryCurves(memories, rows[:, : 1 + _DEGREE], w, a)


def cv_rmse_pa(
    activation: Array,
    pressure_pa: Array,
    memory_terms: Array,
    memories: Memories,
    stiffness: float,
    fold: NDArray[np.intp],
) -> Array:
    """Return (m,) the cross-validated RMSE in Pa; each `fold` (n,) is left out once, with known memory terms."""
    squares = np.zeros(activation.shape[1])
    for left_out in np.unique(fold):
        is_training, is_held_out = fold != left_out, fold == left_out
        curves = fit_memory(
            activation[is_training], pressure_pa[is_training], memory_terms[is_training], memories, stiffness
        )
        powers = activation[is_held_out, :, None] ** np.arange(1 + _DEGREE)
        predicted_pa = (powers * curves.coefficients_pa).sum(axis=2)
        predicted_pa += memory_terms[is_held_out] @ np.concatenate([curves.w, curves.a], axis=1).T
        squares += np.nansum((predicted_pa - pressure_pa[is_held_out, None]) ** 2, axis=0)
    rmse: Array = np.sqrt(squares / np.isfinite(activation).sum(axis=0))
    return rmse


def memory_calibration(
    curves: MemoryCurves, slots: NDArray[np.intp], baseline_count: Array, layout: Layout, provenance: Mapping[str, Any]
) -> Calibration:
    """Return the calibration for the slots (m,) 12 · row + taxel with the baselines (m,) `baseline_count`."""
    shape = (len(layout), N_TAXELS)
    row, taxel = np.divmod(slots, N_TAXELS)
    baseline = np.full(shape, np.nan)
    baseline[row, taxel] = baseline_count
    coefficients = np.full((*shape, 1 + _DEGREE), np.nan)
    coefficients[row, taxel] = curves.coefficients_pa
    identities = layout.identities.tolist()
    effects = curves.effects(tuple((*identities[r], t) for r, t in zip(row.tolist(), taxel.tolist(), strict=True)))
    return Calibration(
        foot=layout.foot,
        baseline_count=baseline,
        coefficients_pa=coefficients,
        covariance_pa2=None,
        usable=~np.isnan(baseline),
        provenance=provenance,
        effects=effects,
    )


def _limit_shares(shares: Array) -> Array:
    """Return shares (m, …) scaled down to what the laws allow; only a taxel that follows another load exceeds it."""
    total = shares.sum(axis=1, keepdims=True)
    bounded: Array = shares * np.minimum(1.0, MOST_SHARED / np.maximum(total, MOST_SHARED))
    return bounded


def _fit_taxel(activation: Array, pressure_pa: Array, memory_terms: Array, stiffness: float) -> Array:
    """Return (4 + memories,) the coefficients of the powers 0 to 3, then the shares."""
    is_finite = np.isfinite(activation)
    if is_finite.sum() < _MIN_SAMPLES:
        raise CalibrationError(
            f"a taxel has {is_finite.sum()} samples, expected at least {_MIN_SAMPLES}: leave it out, or record longer"
        )
    activation, pressure_pa, memory_terms = activation[is_finite], pressure_pa[is_finite], memory_terms[is_finite]
    top = float(np.quantile(activation, 0.999))
    increments = (activation[:, None] / top) ** np.arange(1, 1 + _DEGREE) @ _BERNSTEIN
    coefficients = _robust_nnls(np.concatenate([increments, memory_terms], axis=1), pressure_pa, stiffness)
    powers = _BERNSTEIN @ coefficients[:_DEGREE] / top ** np.arange(1, 1 + _DEGREE)
    return np.concatenate([[0.0], powers, coefficients[_DEGREE:]])


def _robust_nnls(design: Array, target: Array, stiffness: float) -> Array:
    """Return robust least-squares coefficients ≥ 0; those after the curve's are penalised towards 0."""
    penalty_rows = np.zeros((design.shape[1] - _DEGREE, design.shape[1]))
    np.fill_diagonal(penalty_rows[:, _DEGREE:], np.sqrt(stiffness * len(target) * target.var()))
    weight = np.ones(len(target))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        rows = np.concatenate([design * root[:, None], penalty_rows])
        coefficients: Array = nnls(rows, np.concatenate([target * root, np.zeros(len(penalty_rows))]))[0]
        residual = np.abs(target - design @ coefficients)
        weight = (1.0 - np.minimum(residual / (1.4826 * np.median(residual) * TUKEY), 1.0) ** 2) ** 2
    return coefficients
