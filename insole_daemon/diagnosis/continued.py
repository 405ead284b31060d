"""Curves of taxels that each bear loads of their own: their calibration's, with a gain and a shift.

A taxel under the arch bears a few counts in a walk, which tell no curve, and what a free curve says beyond the highest
load a taxel has borne is a guess. Where a taxel bore little its gain is the insole's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..physics.calibration import Calibration
from ..physics.curve_inverse import CurveInverse
from ..physics.law import Array
from .modelling import Curves

STRONG = 12.0  # counts over which a taxel has to go for its gain to say what is usual
HALF = 2.0  # times its noise that a reading has to vary by, RMS, for a taxel to have half a say in its own gain


def continued(
    curves: Curves, model: Calibration, load_pa: Array, activation: Array, noise_count: Array
) -> tuple[Curves, float]:
    """The curves of m taxels, and the mean square by which `model` is off under these loads, counts².

    `load_pa` (n, m) they bore and `activation` (n, m) they read, less the baseline as in `Curves`; `noise_count` (m,)
    of a reading. A taxel that the model does not list stays as it is.
    """
    listed = model.usable.ravel()[curves.slots]
    if not listed.any():
        return curves, 0.0
    slots = curves.slots[listed]
    polynomial = CurveInverse(_coefficients(model, slots))
    bore, read = polynomial(load_pa[:, listed]), activation[:, listed]
    middle, centre = bore.mean(axis=0), read.mean(axis=0)
    square, product = np.sum((bore - middle) ** 2, axis=0), np.sum((bore - middle) * (read - centre), axis=0)
    strong = np.ptp(bore, axis=0) >= min(STRONG, float(np.ptp(bore, axis=0).max()))
    usual = float(np.median(product[strong] / np.maximum(square[strong], 1e-9)))
    prior = len(read) * (HALF * noise_count[listed]) ** 2
    gain = (product + prior * usual) / (square + prior)
    shift = centre - gain * middle
    found = curves.activation_count.copy()
    grid = polynomial(np.repeat(curves.load_pa[:, None], len(slots), axis=1)).T
    found[listed] = gain[:, None] * grid + shift[:, None]
    off = gain * bore + shift + model.baseline_count.ravel()[slots] - bore
    return replace(curves, activation_count=found), float(np.mean(off**2))


def _coefficients(model: Calibration, slots: NDArray[np.intp]) -> Array:
    coefficients: Array = model.coefficients_pa.reshape(-1, model.coefficients_pa.shape[-1])[slots]
    return np.pad(coefficients, ((0, 0), (0, 1))) if coefficients.shape[1] == 1 else coefficients
