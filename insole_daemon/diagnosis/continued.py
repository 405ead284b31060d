"""Curves beyond the loads that were seen: as the calibration goes on, with a gain and a shift.

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
LEAST_STEEP = 0.1  # of its mean slope, that a curve goes on with: a polynomial that turns back is no curve from there
N_MORE = 50  # loads by which a curve goes on
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


def onwards(curves: Curves, model: Calibration, highest_pa: float) -> Curves:
    """`curves` up to `highest_pa`: beyond the highest load that was seen, as `model` goes on, with its gain till there.

    A taxel that the model does not list goes on straight.
    """
    load_pa, read = curves.load_pa, curves.activation_count
    if highest_pa <= load_pa[-1]:
        return curves
    more = np.linspace(load_pa[-1], highest_pa, N_MORE)
    rises = (read[:, -1] - read[:, 0]) / (load_pa[-1] - load_pa[0])
    steps = np.repeat((rises * (more[1] - more[0]))[:, None], N_MORE - 1, axis=1)
    listed = model.usable.ravel()[curves.slots]
    if listed.any():
        polynomial = CurveInverse(_coefficients(model, curves.slots[listed]))
        ends, goes_on = (polynomial(np.repeat(at[:, None], listed.sum(), axis=1)).T for at in (load_pa[[0, -1]], more))
        gain = (read[listed, -1] - read[listed, 0]) / np.maximum(ends[:, 1] - ends[:, 0], 1e-9)
        steps[listed] = np.maximum(gain[:, None] * np.diff(goes_on, axis=1), LEAST_STEEP * steps[listed])
    further = read[:, -1:] + np.cumsum(steps, axis=1)
    return Curves(curves.slots, np.append(load_pa, more[1:]), np.concatenate([read, further], axis=1))


def _coefficients(model: Calibration, slots: NDArray[np.intp]) -> Array:
    coefficients: Array = model.coefficients_pa.reshape(-1, model.coefficients_pa.shape[-1])[slots]
    return np.pad(coefficients, ((0, 0), (0, 1))) if coefficients.shape[1] == 1 else coefficients
