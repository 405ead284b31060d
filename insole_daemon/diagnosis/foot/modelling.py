"""What was found on walks in the laws' own parameters, and as a model that a daemon can undo.

Undone, a viscoelasticity is P = q + b·(q − z') with τ'·dz'/dt = q − z': a = b/(1 + b), τ = τ'/(1 − a). Undone plays
are plays again: P = q + Σ b_j·(q − play_r'j[q]), whose slopes 1 + Σ_(i>j) b_i are one over those of the law, and whose
radii are stretched by them (the inverse in `physics.effects.hysteresis`, the other way round).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyadd, polypow

from ...physics import effects_document
from ...physics.effect import Effect, Where
from ...physics.effects import laws
from ...physics.law import Array
from ...skin.geometry import N_TAXELS
from ..finding import Quantity
from ..modelling import FAMILY, as_effect
from .evidence import Evidence
from .hypothesis import Fitted, Term
from .naming import Tried, std
from .part import CURVED_PA

LEAST_SHARE = 2e-3  # of a play that is worth a word


def place(term: Term, evidence: Evidence) -> Where:
    """Where it is at work."""
    return Where("board", tuple((board,) for board in term.boards)) if term.boards else Where()


def quantities(term: Term, tried: Tried) -> dict[str, Quantity]:
    """The parameters of one effect, with the jackknife over the folds and what families of curves differ by."""
    values = _values(term, tried.fitted)
    folds = [_values(term, each) for each in tried.without]
    units = {parameter.name: parameter.unit for parameter in laws()[term.word].parameters}
    found = {}
    for name, value in values.items():
        scatter = std(np.stack([each[name] for each in folds]))
        found[name] = (value, np.hypot(scatter, FAMILY * np.abs(value)))
    if term.word == "hysteresis":
        kept = found["w"][0] > LEAST_SHARE
        kept[np.argmax(found["w"][0])] = True
        found = {name: (value[kept], spread[kept]) for name, (value, spread) in found.items()}
        return {name: Quantity(value, spread, units[name]) for name, (value, spread) in found.items()}
    return {name: Quantity(float(value[0]), float(spread[0]), units[name]) for name, (value, spread) in found.items()}


def effect(term: Term, parameters: Mapping[str, Quantity], evidence: Evidence) -> Effect:
    """As a chain runs it, with the range of pressures it was identified in."""
    highest = max(float(part.pressure_pa.max()) for part in evidence.parts)
    limits = {"pressure_pa": (0.0, float(np.ceil(highest)))}
    return replace(as_effect(term.word, place(term, evidence), parameters), valid_range=limits)


def document(
    evidence: Evidence, recalibration: Array, effects: list[Effect], provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """An `insole-calibration/1`: the curves as recalibrated, with the effects."""
    walk = evidence.parts[0].walk
    layout, calibration = walk.layout, walk.calibration
    triangles = np.unique(walk.slots // N_TAXELS)
    bent = recalibration[: evidence.n_common].reshape(len(triangles), -1)
    # The constants of the wrench go to the taxels as the smallest pressures that have it.
    constant = recalibration[evidence.n_common : evidence.n_common + 3]  # N and N·m
    rests_pa = walk.arms @ np.linalg.lstsq(walk.arms.T @ walk.arms, constant, rcond=None)[0]
    rest_of = dict(zip(walk.slots.tolist(), rests_pa.tolist(), strict=True))
    taxels = []
    for slot in np.flatnonzero(calibration.usable.ravel()).tolist():
        row, taxel = divmod(slot, N_TAXELS)
        c = calibration.coefficients_pa[row, taxel]
        if row in triangles:
            at = int(np.searchsorted(triangles, row))
            c = _bent(c, dict(zip(evidence.freedom.powers, bent[at], strict=True)))
        c[0] += rest_of.get(slot, 0.0)
        board, triangle = layout.identities[row].tolist()
        taxels.append(
            {"board": board, "triangle": triangle, "taxel": taxel,
             "baseline_count": round(float(calibration.baseline_count[row, taxel]), 4),
             "coefficients_pa": [float(f"{value:.9g}") for value in c]}
        )  # fmt: skip
    taxels.sort(key=lambda each: (each["board"], each["triangle"], each["taxel"]))
    return {
        "format": "insole-calibration/1", "foot": layout.foot, "taxels": taxels,
        "effects": effects_document.document(effects, layout), "provenance": dict(provenance),
    }  # fmt: skip


def _bent(c: Array, by: Mapping[int, float]) -> Array:
    """Coefficients of P + Σ by_k · P^k / CURVED_PA^(k − 1), P the polynomial of the coefficients `c`."""
    found = c
    for power, share in by.items():
        found = polyadd(found, share / CURVED_PA ** (power - 1) * polypow(c, power))
    return np.asarray(found)


def _values(term: Term, fitted: Fitted) -> dict[str, Array]:
    time_s, shares = fitted.times(term), fitted.shares[fitted.terms.index(term)]
    if term.word == "viscoelasticity":
        a = shares / (1.0 + shares)
        return {"a": a, "tau_s": time_s / (1.0 - a)}
    if term.word == "hysteresis":
        return _plays(shares, np.array(fitted.radii_pa))
    return {"tau_s" if term.word == "lag" else "delay_s": np.array([time_s])}


def _plays(shares: Array, radii_pa: Array) -> dict[str, Array]:
    """Radii and weights of the law whose inverse has `shares` at `radii_pa`."""
    slopes = 1.0 + shares.sum() - np.concatenate([[0.0], np.cumsum(shares)])  # of the inverse, before and after each
    widths = np.diff(radii_pa, prepend=0.0)
    return {"r_pa": np.cumsum(slopes[:-1] * widths), "w": np.diff(1.0 / slopes)}
