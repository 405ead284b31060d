"""What a taxel remembers, fitted together with its curve to a known pressure: the laws `hysteresis` and `creep`.

With P the pressure and q the effective load that the curve g turns into an activation x = baseline − count,

    q = P − Σ_j w_j·(P − play_rj[P]) − Σ_k a_k·(P − z_k[P])   and   q = g(x), so
    P = g(x) + Σ_j w_j·(P − play_rj[P]) + Σ_k a_k·(P − z_k[P])

which is linear in the coefficients of g, in w and in a, once radii and time constants are given. The memories are
those of the clean reference, never of noisy counts; products of w and a are left out, a hundredth of P. g is 0 at the
baseline and rises from there to the highest activation seen, its derivative being a sum of Bernstein polynomials none
of which is negative; no share is negative either. A share of 1 costs `stiffness` variances of the pressure, which
spreads over memories what the data do not tell apart. What is found is turned round by `Chain.inverse`, causally.

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

Array: TypeAlias = NDArray[np.float64]

_DEGREE = 3
_SHARE = 0.5  # with which a memory is asked for, to be divided by it
_TUKEY = 4.685  # robust standard deviations beyond which a sample counts nothing: 95 % efficient if all are good
_ROUNDS = 4  # of weights
_LEAST_SAMPLES = 50

# (3, 3) the powers 1 to 3 of the integrals from 0 to u of Bernstein's quadratics (1−u)², 2u(1−u), u².
_BERNSTEIN = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [1 / 3, -2 / 3, 1 / 3]])


@dataclass(frozen=True, slots=True)
class Memories:
    """What is remembered, by the parameters that all taxels share."""

    r_pa: tuple[float, ...] = ()  # radii of plays
    tau_s: tuple[float, ...] = ()  # time constants


@dataclass(frozen=True, slots=True, eq=False)
class MemoryCurves:
    """What was found of m taxels."""

    memories: Memories
    coefficients_pa: Array  # (m, 4) of the powers 0 to 3; the first is 0
    w: Array  # (m, radii)
    a: Array  # (m, time constants)

    def effects(self, identities: tuple[tuple[int, int, int], ...]) -> tuple[Effect, ...]:
        """The memories as effects on the taxels `identities` (board, triangle, taxel), m of them."""
        where, each = Where("taxel", identities), np.ones(len(identities))
        found = []
        if self.memories.r_pa:
            r_pa = np.outer(self.memories.r_pa, each)
            found.append(effect("hysteresis", where, r_pa=r_pa, w=self.w.T))
        if self.memories.tau_s:
            tau_s = np.outer(self.memories.tau_s, each)
            found.append(effect("creep", where, a=self.a.T, tau_s=tau_s))
        return tuple(found)


def states(t_s: Array, pressure_pa: Array, memories: Memories, layout: Layout) -> Array:
    """(n, radii + time constants) what each memory withholds of `pressure_pa` (n,): P − play[P], P − z[P]."""
    one = replace(layout, triangles=layout.triangles[:1], xy_m=layout.xy_m[:1])
    load = np.broadcast_to(pressure_pa[:, None, None], (len(t_s), 1, N_TAXELS))
    laws = [effect("hysteresis", r_pa=[r], w=[_SHARE]) for r in memories.r_pa]
    laws += [effect("creep", a=[_SHARE], tau_s=[tau]) for tau in memories.tau_s]
    held = [(pressure_pa - Chain([law], one).forward()(load, t_s)[:, 0, 0]) / _SHARE for law in laws]
    return np.stack(held, axis=1) if held else np.empty((len(t_s), 0))


def fit_memory(
    activation: Array, pressure_pa: Array, held: Array, memories: Memories, stiffness: float
) -> MemoryCurves:
    """Curves and shares of m taxels, from n samples that need not follow each other; NaN: a taxel said nothing.

    `activation` (n, m): counts below the baseline, smoothed: noise of theirs bends the curve and passes for memory.
    `held` (n, …): the `states` of `memories` at the samples. CalibrationError where a taxel has hardly any.
    """
    found = np.stack([_taxel(x, pressure_pa, held, stiffness) for x in activation.T])
    shares = found[:, 1 + _DEGREE :]
    w, a = (_bounded(each) for each in np.split(shares, [len(memories.r_pa)], axis=1))
    return MemoryCurves(memories, found[:, : 1 + _DEGREE], w, a)


def cv_rmse_pa(
    activation: Array, pressure_pa: Array, held: Array, memories: Memories, stiffness: float, fold: NDArray[np.intp]
) -> Array:
    """(m,) RMSE in Pa of samples that were not fitted: each `fold` (n,) is left out once, its memories are known."""
    squares = np.zeros(activation.shape[1])
    for out in np.unique(fold):
        rest, own = fold != out, fold == out
        curves = fit_memory(activation[rest], pressure_pa[rest], held[rest], memories, stiffness)
        powers = activation[own, :, None] ** np.arange(1 + _DEGREE)
        said = (powers * curves.coefficients_pa).sum(axis=2)
        said += held[own] @ np.concatenate([curves.w, curves.a], axis=1).T
        squares += np.nansum((said - pressure_pa[own, None]) ** 2, axis=0)
    rmse: Array = np.sqrt(squares / np.isfinite(activation).sum(axis=0))
    return rmse


def memory_calibration(
    curves: MemoryCurves, slots: NDArray[np.intp], baseline_count: Array, layout: Layout, provenance: Mapping[str, Any]
) -> Calibration:
    """Return what `fit_memory` found, for the slots (m,) 12 · row + taxel, whose baselines are (m,)."""
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


def _bounded(shares: Array) -> Array:
    """(m, …) brought down to what the laws allow: only a taxel that follows something else needs more."""
    total = shares.sum(axis=1, keepdims=True)
    bounded: Array = shares * np.minimum(1.0, MOST_SHARED / np.maximum(total, MOST_SHARED))
    return bounded


def _taxel(activation: Array, pressure_pa: Array, held: Array, stiffness: float) -> Array:
    """(4 + memories,) coefficients of the powers, then shares."""
    there = np.isfinite(activation)
    if there.sum() < _LEAST_SAMPLES:
        raise CalibrationError(
            f"a taxel has {there.sum()} samples, expected at least {_LEAST_SAMPLES}: leave it out, or record longer"
        )
    activation, pressure_pa, held = activation[there], pressure_pa[there], held[there]
    top = float(np.quantile(activation, 0.999))
    rises = (activation[:, None] / top) ** np.arange(1, 1 + _DEGREE) @ _BERNSTEIN
    found = _robust(np.concatenate([rises, held], axis=1), pressure_pa, stiffness)
    powers = _BERNSTEIN @ found[:_DEGREE] / top ** np.arange(1, 1 + _DEGREE)
    return np.concatenate([[0.0], powers, found[_DEGREE:]])


def _robust(design: Array, target: Array, stiffness: float) -> Array:
    """The coefficients, none negative; those after the curve's are drawn to 0."""
    stiff = np.zeros((design.shape[1] - _DEGREE, design.shape[1]))
    np.fill_diagonal(stiff[:, _DEGREE:], np.sqrt(stiffness * len(target) * target.var()))
    weight = np.ones(len(target))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        rows = np.concatenate([design * root[:, None], stiff])
        found: Array = nnls(rows, np.concatenate([target * root, np.zeros(len(stiff))]))[0]
        left = np.abs(target - design @ found)
        weight = (1.0 - np.minimum(left / (1.4826 * np.median(left) * _TUKEY), 1.0) ** 2) ** 2
    return found
