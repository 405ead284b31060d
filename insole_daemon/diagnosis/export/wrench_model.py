"""The model of recordings: the calibration handed in, less what it had absorbed of effects, with the effects found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics import effects_document
from ...physics.effect import Effect, Where
from ...physics.law import Array
from ...skin.geometry import N_TAXELS
from ..model.curves import CurveShares
from ..observations.wrench import WrenchObservation
from ..terms.stiffening import SCALE_PA


@dataclass(frozen=True, slots=True)
class Absorbed:
    """A share of a static term by which the curves of a place are off, because they were fitted with an effect."""

    word: str
    where: Where
    share: float


def document(
    seen: WrenchObservation,
    effects: Sequence[Effect],
    absorbed: Sequence[Absorbed],
    provenance: Mapping[str, Any],
    recalibrated: CurveShares | None,
    broken: NDArray[np.bool_],
) -> dict[str, Any]:
    """An `insole-calibration/1`; `recalibrated`: what curves are off by that were fitted with a memory at work.

    Taxels that are `broken` (T, 12) are not listed: nothing they read is a pressure.
    """
    layout, calibration = seen.layout, seen.calibration
    places = [(each, set(each.where.slots(layout).tolist())) for each in absorbed]
    taxels = []
    for slot in np.flatnonzero((calibration.usable & ~broken).ravel()).tolist():
        row, taxel = divmod(slot, N_TAXELS)
        board, triangle = layout.identities[row].tolist()
        curve = calibration.coefficients_pa[row, taxel]
        for each, slots in places:
            if slot in slots:
                curve = _changed(curve, each)
        if recalibrated is not None:
            curve = recalibrated.changed(curve, row, taxel)
        taxels.append(
            {"board": board, "triangle": triangle, "taxel": taxel,
             "baseline_count": round(float(calibration.baseline_count[row, taxel]), 4),
             "coefficients_pa": [float(f"{value:.9g}") for value in curve]}
        )  # fmt: skip
    taxels.sort(key=lambda each: (each["board"], each["triangle"], each["taxel"]))
    return {
        "format": "insole-calibration/1", "foot": layout.foot, "taxels": taxels,
        "effects": effects_document.document(list(effects), layout), "provenance": dict(provenance),
    }  # fmt: skip


def _changed(curve: Array, each: Absorbed) -> Array:
    """(k,) of the curve g(a) of which the columns of static terms are made (`terms`)."""
    slope = np.polynomial.polynomial.polyder(curve)
    if each.word == "gain":
        return np.asarray(curve - each.share * np.polynomial.polynomial.polymulx(slope)[: len(curve)])
    if each.word == "baseline":
        return np.asarray(np.polynomial.polynomial.polyadd(curve, each.share * slope))
    more = np.polynomial.polynomial.polymul(curve, curve) * (each.share / SCALE_PA)
    return np.asarray(np.polynomial.polynomial.polyadd(curve, more))
