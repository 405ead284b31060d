"""Memory on a regular grid, whole signals at once: what the search evaluates ten thousand times.

The equations are those of `physics`, which a test holds them to.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.signal import lfilter

from ..physics.first_order import steps
from ..physics.law import Array

AT_ONCE = 128  # rows of all taxels, that a processor keeps in its cache


def low_pass(x: Array, step_s: float, tau_s: float) -> Array:
    """(N, m) z with τ·dz/dt = x − z, at rest at x[0] before; exact for x linear between rows (`first_order`)."""
    decay, before, now = _step(step_s, tau_s)
    rest = x[:1]
    z: Array = lfilter([now, before], [1.0, -decay], x - rest, axis=0)
    return z + rest


@lru_cache(maxsize=4096)
def _step(step_s: float, tau_s: float) -> tuple[float, float, float]:
    decay, before, now = (float(each[0, 0]) for each in steps(np.array([step_s]), np.array([tau_s])))
    return decay, before, now


def plays(x: Array, radii_pa: Array) -> Array:
    """(k, N, m) play_r[x] − x for each radius, no load before the first row (`effects.hysteresis`)."""
    found = np.empty((len(x), len(radii_pa), x.shape[1]))
    radius = radii_pa[:, None]
    last = np.zeros(found.shape[1:])
    for row, low, high in zip(found, x[:, None] - radius, x[:, None] + radius, strict=True):
        last = np.maximum(np.minimum(last, high, out=row), low, out=row)
    found -= x[:, None]
    return np.moveaxis(found, 1, 0)


def frictions(x: Array, widths_pa: Array) -> Array:
    """(k, N, m) what friction takes of x for each width s, none before the first row: dz = (1 − sgn(dx)·z/s)·dx.

    P. R. Dahl 1968; exact for x monotonic between rows. A play takes the same of a long way, but all of a short one.
    """
    width = widths_pa[:, None]
    found = np.empty((len(x), len(widths_pa), x.shape[1]))
    last = np.zeros(found.shape[1:])
    for row, way in zip(found, np.diff(x, axis=0, prepend=0.0)[:, None], strict=True):
        end = np.copysign(width, way)
        last = np.add(end, (last - end) * np.exp(-np.abs(way) / width), out=row)
    return np.moveaxis(found, 1, 0)


def activated(x: Array, step_s: float, tau_s: float, scale_pa: float) -> Array:
    """(N, ...) z with τ·dz/dt = s·sinh((x − z)/s), at rest at x[0] before; exact for x constant between rows.

    Flow over energy barriers that load lowers (H. Eyring, J. Chem. Phys. 4 (1936) 283): tanh((x − z)/2s) decays with τ.
    """
    found = np.empty_like(x)
    decay, last = np.exp(-step_s / tau_s), x[0]
    for row, now in zip(found, x, strict=True):
        last = np.subtract(now, 2.0 * scale_pa * np.arctanh(decay * np.tanh((now - last) / (2.0 * scale_pa))), out=row)
    return found


def polynomial(x: Array, coefficients: Array) -> Array:
    """(N, ...) values at x (N, ...) of polynomials with coefficients (k, ...), lowest power first."""
    found = np.empty(x.shape)
    for first in range(0, len(x), AT_ONCE):
        own, at = found[first : first + AT_ONCE], x[first : first + AT_ONCE]
        own[:] = coefficients[-1]
        for each in coefficients[-2::-1]:
            own *= at
            own += each
    return found


def relay(x: Array, up_pa: float, down_pa: float) -> Array:
    """(N, m) 1 from x ≥ up until x ≤ down, 0 before the first."""
    event = np.where(x >= up_pa, 1, np.where(x <= down_pa, -1, 0))
    row = np.where(event != 0, np.arange(len(x))[:, None], 0)
    np.maximum.accumulate(row, axis=0, out=row)
    on: Array = (np.take_along_axis(event, row, axis=0) > 0).astype(float)
    return on
