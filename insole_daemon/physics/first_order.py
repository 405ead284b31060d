"""Solve τ·dz/dt = P − z exactly, for a load that is linear between its samples.

With x = dt/τ, E = exp(−x), φ = (1 − E)/x:

    z_n = E·z_(n−1) + (φ − E)·P_(n−1) + (1 − φ)·P_n

Source: variation of constants with P(t) linear over the step (the first-order hold of sampled-data control, Franklin,
Powell & Workman, Digital Control of Dynamic Systems, ch. 6). A zero-order hold would delay by half a step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .law import Array
from .portable import exp_minus_one

_NO_TIME = 1e-300  # replaces a step of 0, for which φ is 1


class FirstOrderStep(NamedTuple):
    """Coefficients of z_n = decay · z_(n−1) + before · P_(n−1) + now · P_n; each (n, *shape of τ)."""

    decay: Array
    before: Array
    now: Array


def steps(dt_s: Array, tau_s: Array) -> FirstOrderStep:
    """Return the coefficients of the steps `dt_s` (n,), for time constants `tau_s` of any shape."""
    x = np.maximum(dt_s.reshape(-1, *(1,) * tau_s.ndim) / tau_s, _NO_TIME)
    approached = -exp_minus_one(-x)
    mean = approached / x
    return FirstOrderStep(1.0 - approached, mean - 1.0 + approached, 1.0 - mean)


def recur(factor: Array, drive: Array, state: Array) -> Array:
    """Compute y_n = factor_n · y_(n−1) + drive_n in place of `drive` (n, …), from y_(−1) = `state`; return the last."""
    product = np.empty(drive.shape[1:])
    for row_factor, row in zip(factor, drive, strict=True):
        np.multiply(row_factor, state, out=product)
        row += product
        state = row
    return state.copy()
