"""The exported model: the calibration, corrected for effects it had absorbed, with the effects that were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyadd, polyder, polymul, polymulx, polyval
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.stats import binom

from ...physics import calibration as calibrations
from ...physics import effects_document
from ...physics.effect import Effect, Where
from ...physics.law import Array
from ...skin.geometry import N_TAXELS
from ..model.curves import CurveShares
from ..observations.wrench import WrenchObservation
from ..terms import creep_by_reference, mean_curve
from ..terms.stiffening import SCALE_PA

N_COUNTS, DEGREE = 200, 6  # of a mean curve that is fitted with a polynomial
LEAST_SLOPE = 0.02  # of a corrected curve, relative to its mean slope


@dataclass(frozen=True, slots=True)
class Absorbed:
    """The shares of a static term by which curves of a place deviate, because an effect acted in their calibration."""

    word: str
    where: Where
    shares: Array  # (k,) of one column, or of a mean curve at its knots
    knots_pa: Array | None = None  # (k,) of a mean curve


def document(
    seen: WrenchObservation,
    effects: Sequence[Effect],
    absorbed: Sequence[Absorbed],
    provenance: Mapping[str, Any],
    recalibrated: CurveShares | None,
    broken: NDArray[np.bool_],
) -> dict[str, Any]:
    """Return an `insole-calibration/1`.

    `recalibrated`: corrections of curves that were fitted while a memory acted. Taxels that are `broken` (T, 12) are
    not listed. A corrected curve is valid up to the highest activation of the rows, another as far as it was before.
    """
    layout, calibration = seen.layout, seen.calibration
    places = [(correction, set(correction.where.slots(layout).tolist())) for correction in absorbed]
    reached_count, top_count = seen.activation_count.max(axis=0), seen.top_count
    fitted_count = calibration.highest_count
    if fitted_count is None:
        fitted_count = np.full(reached_count.shape, np.inf)
    highest_pa = 0.0
    taxels = []
    for slot in np.flatnonzero((calibration.usable & ~broken).ravel()).tolist():
        row, taxel = divmod(slot, N_TAXELS)
        board, triangle = layout.identities[row].tolist()
        given = curve = calibration.coefficients_pa[row, taxel]
        for correction, slots in places:
            if slot in slots:
                curve = polyadd(curve, _change(given, correction, float(reached_count[row, taxel])))
        if curve is not given:
            curve = _rising(curve, float(reached_count[row, taxel]))
        if recalibrated is not None:
            curve = recalibrated.corrected(curve, float(top_count[row, taxel]), row, taxel)
        highest_pa = max(highest_pa, float(polyval(reached_count[row, taxel], curve)))
        extensions = calibrations.valid_up_to(float((fitted_count if curve is given else reached_count)[row, taxel]))
        taxels.append(
            {"board": board, "triangle": triangle, "taxel": taxel,
             "baseline_count": round(float(calibration.baseline_count[row, taxel]), 4),
             "coefficients_pa": [float(f"{value:.9g}") for value in curve],
             **({"extensions": extensions} if extensions else {})}
        )  # fmt: skip
    taxels.sort(key=lambda entry: (entry["board"], entry["triangle"], entry["taxel"]))
    up_to_highest = [_valid_up_to(effect, highest_pa) for effect in effects]
    return {
        "format": "insole-calibration/1", "foot": layout.foot, "taxels": taxels,
        "effects": effects_document.document(up_to_highest, layout), "provenance": dict(provenance),
    }  # fmt: skip


def _rising(curve: Array, reached_count: float) -> Array:
    """Return coefficients (k,) of a curve that rises from activation 0 to `reached_count`, as near as possible.

    A corrected curve may fall by an error of its fit, and could then not be inverted. A polynomial rises if its
    coefficients in the Bernstein basis do (G. G. Lorentz, Bernstein Polynomials, 1953).
    """
    count = np.linspace(0.0, max(reached_count, 1.0), N_COUNTS)
    pressure_pa, degree = polyval(count, curve), len(curve) - 1
    least = LEAST_SLOPE * float(np.ptp(pressure_pa)) / count[-1]
    if np.min(polyval(count, polyder(curve))) >= least:
        return curve
    steps = binom.sf(np.arange(degree), degree, (count / count[-1])[:, None])
    low = np.concatenate([[-np.inf], np.full(degree, least * count[-1] / degree)])
    columns = np.concatenate([np.ones((N_COUNTS, 1)), steps], axis=1)
    rising_pa = columns @ lsq_linear(columns, pressure_pa, (low, np.full(degree + 1, np.inf)), method="bvls").x
    return np.asarray(Polynomial.fit(count, rising_pa, degree).convert().coef)


def _valid_up_to(effect: Effect, highest_pa: float) -> Effect:
    """Return `effect` with a valid range up to a pressure that corrected curves return, if that is higher."""
    if "pressure_pa" not in effect.valid_range:
        return effect
    low, high = effect.valid_range["pressure_pa"]
    return replace(effect, valid_range={**effect.valid_range, "pressure_pa": (low, max(high, np.ceil(highest_pa)))})


def _change(curve: Array, absorbed: Absorbed, reached_count: float) -> Array:
    """Return by how much the static term `absorbed` changes the coefficients (k,) of a curve (see `terms`).

    A mean curve is fitted with a polynomial up to the activation `reached_count`.
    """
    slope = polyder(curve)
    if absorbed.word == "mean_curve":
        assert absorbed.knots_pa is not None
        count = np.linspace(0.0, max(reached_count, 1.0), N_COUNTS)
        pressure_pa = np.asarray(polyval(count, curve), np.float64)
        change = mean_curve.change_pa(pressure_pa, absorbed.knots_pa, absorbed.shares)
        return np.asarray(Polynomial.fit(count, change, DEGREE).convert().coef)
    (share,) = absorbed.shares.tolist()
    if absorbed.word == creep_by_reference.CALIBRATED:
        return np.asarray(curve * share / (1.0 - share))
    if absorbed.word == "gain":
        return np.asarray(-share * polymulx(slope)[: len(curve)])
    if absorbed.word == "baseline":
        return np.asarray(share * slope)
    return np.asarray(polymul(curve, curve) * (share / SCALE_PA))
