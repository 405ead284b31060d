"""The exported model: the calibration, corrected for effects it had absorbed, with the effects that were found."""

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
    """The share of a static term by which curves of a place deviate, because an effect acted in their calibration."""

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
    """Return an `insole-calibration/1`.

    `recalibrated`: corrections of curves that were fitted while a memory acted. Taxels that are `broken` (T, 12) are
    not listed.
    """
    layout, calibration = seen.layout, seen.calibration
    places = [(correction, set(correction.where.slots(layout).tolist())) for correction in absorbed]
    taxels = []
    for slot in np.flatnonzero((calibration.usable & ~broken).ravel()).tolist():
        row, taxel = divmod(slot, N_TAXELS)
        board, triangle = layout.identities[row].tolist()
        curve = calibration.coefficients_pa[row, taxel]
        for correction, slots in places:
            if slot in slots:
                curve = _changed(curve, correction)
        if recalibrated is not None:
            curve = recalibrated.changed(curve, row, taxel)
        taxels.append(
            {"board": board, "triangle": triangle, "taxel": taxel,
             "baseline_count": round(float(calibration.baseline_count[row, taxel]), 4),
             "coefficients_pa": [float(f"{value:.9g}") for value in curve]}
        )  # fmt: skip
    taxels.sort(key=lambda entry: (entry["board"], entry["triangle"], entry["taxel"]))
    return {
        "format": "insole-calibration/1", "foot": layout.foot, "taxels": taxels,
        "effects": effects_document.document(list(effects), layout), "provenance": dict(provenance),
    }  # fmt: skip


def _changed(curve: Array, absorbed: Absorbed) -> Array:
    """Return the coefficients (k,) of the curve, corrected by the static term `absorbed` (see `terms`)."""
    slope = np.polynomial.polynomial.polyder(curve)
    if absorbed.word == "gain":
        return np.asarray(curve - absorbed.share * np.polynomial.polynomial.polymulx(slope)[: len(curve)])
    if absorbed.word == "baseline":
        return np.asarray(np.polynomial.polynomial.polyadd(curve, absorbed.share * slope))
    more = np.polynomial.polynomial.polymul(curve, curve) * (absorbed.share / SCALE_PA)
    return np.asarray(np.polynomial.polynomial.polyadd(curve, more))
