"""Curves of taxels that each bear loads of their own: beyond what one has borne, its calibration goes on.

A taxel under the arch bears a few counts in a walk, which tell no curve. What tells one is used as far as it reaches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..physics.calibration import Calibration
from ..physics.curve_inverse import CurveInverse
from ..physics.law import Array
from .modelling import Curves

LEAST_REACH = 12.0  # counts that a curve of its own is told by; below, it is the calibration's with a gain and a shift
GAIN_SPREAD = 0.1  # of what calibrations are off by: what a few counts may say of a gain


def continued(
    curves: Curves, model: Calibration, load_pa: Array, activation: Array, noise_count: Array
) -> tuple[Curves, float]:
    """The curves of m taxels, and the mean square by which `model` is off under these loads, counts².

    `load_pa` (n, m) they bore and `activation` (n, m) they read, less the baseline as in `Curves`; `noise_count` (m,)
    of a reading. A taxel that the model does not list stays as it is.
    """
    listed = model.usable.ravel()[curves.slots]
    found, off = curves.activation_count.copy(), np.zeros(len(curves.slots))
    if not listed.any():
        return curves, 0.0
    polynomial = CurveInverse(_coefficients(model, curves.slots[listed]))
    load, read = load_pa[:, listed], activation[:, listed]
    bore = polynomial(load)
    grid = polynomial(np.repeat(curves.load_pa[:, None], int(listed.sum()), axis=1)).T
    middle, centre = bore.mean(axis=0), read.mean(axis=0)
    prior = (noise_count[listed] / GAIN_SPREAD) ** 2
    gain = (np.sum((bore - middle) * (read - centre), axis=0) + prior) / (np.sum((bore - middle) ** 2, axis=0) + prior)
    shift = centre - gain * middle
    baseline = model.baseline_count.ravel()[curves.slots[listed]]
    line = gain[:, None] * grid + shift[:, None]
    reach = load.max(axis=0)
    for at, own in enumerate(np.flatnonzero(listed)):
        if bore[:, at].max() - bore[:, at].min() < LEAST_REACH:
            found[own] = line[at]
            continue
        beyond = curves.load_pa > reach[at]
        step = np.interp(reach[at], curves.load_pa, found[own]) - np.interp(reach[at], curves.load_pa, line[at])
        found[own, beyond] = line[at, beyond] + step
    off[listed] = np.mean((gain * bore + shift + baseline - bore) ** 2, axis=0)
    return replace(curves, activation_count=found), float(off[listed].mean())


def _coefficients(model: Calibration, slots: NDArray[np.intp]) -> Array:
    coefficients: Array = model.coefficients_pa.reshape(-1, model.coefficients_pa.shape[-1])[slots]
    return np.pad(coefficients, ((0, 0), (0, 1))) if coefficients.shape[1] == 1 else coefficients
