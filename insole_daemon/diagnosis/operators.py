"""Operators with memory on a regular grid, vectorised over whole signals for the search.

The equations are those of `physics`; a test compares both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np
from scipy.signal import lfilter

from ..physics.first_order import steps
from ..physics.law import Array

AT_ONCE = 128  # rows of all taxels that fit in the cache of the processor
SIGNALS_AT_ONCE = 128  # for which a row takes about as long as for one


def low_pass(x: Array, step_s: float, tau_s: float) -> Array:
    """Return z (N, m) with τ·dz/dt = x − z, z = x in the first row; exact for x linear between rows (`first_order`)."""
    decay, before, now = _step(step_s, tau_s)
    initial = x[:1]
    z: Array = lfilter([now, before], [1.0, -decay], x - initial, axis=0)
    return z + initial


@lru_cache(maxsize=4096)
def _step(step_s: float, tau_s: float) -> tuple[float, float, float]:
    decay, before, now = (float(weight[0, 0]) for weight in steps(np.array([step_s]), np.array([tau_s])))
    return decay, before, now


def cubic_at(values: Array, position: Array) -> Array:
    """Return rows (n, ...) of `values` (N, ...) at fractional row numbers `position` (n,), by a Catmull–Rom cubic.

    Source: E. Catmull and R. Rom, A class of local interpolating splines, 1974.
    """
    row = position.astype(np.intp)
    x = (position - row).reshape(-1, *(1,) * (values.ndim - 1))
    p0, p1, p2, p3 = (
        (values[row + step] for step in (-1, 0, 1, 2))
        if row.max() + 2 < len(values)
        else (values[np.clip(row + step, 0, len(values) - 1)] for step in (-1, 0, 1, 2))
    )
    interpolated = p1 + 0.5 * x * (p2 - p0 + x * (2 * p0 - 5 * p1 + 4 * p2 - p3 + x * (3 * (p1 - p2) + p3 - p0)))
    return np.asarray(interpolated)


def plays(x: Array, radii_pa: Array) -> Array:
    """Return play_r[x] − x (k, N, m), without load before the first row (`effects.hysteresis`).

    `radii_pa`: the radius of each play (k,), or of each column of x, too (k, m).
    """
    play = np.empty((len(x), len(radii_pa), x.shape[1]))
    radius = radii_pa.reshape(len(radii_pa), -1)
    state = np.zeros(play.shape[1:])
    for row, low, high in zip(play, x[:, None] - radius, x[:, None] + radius, strict=True):
        state = np.maximum(np.minimum(state, high, out=row), low, out=row)
    play -= x[:, None]
    return np.moveaxis(play, 1, 0)


def held(x: Array, radius: Array) -> Array:
    """Return x (N, m) without turns smaller than 2·`radius` (m,): the mean of a play that runs forward and one back.

    It is constant while x stays within the noise, and does not lag where x moves.
    """
    since_start, before_end = x - x[0], x[::-1] - x[-1]
    return np.asarray(x + 0.5 * (plays(since_start, radius[None])[0] + plays(before_end, radius[None])[0][::-1]))


def frictions(x: Array, up_pa: Array, down_pa: Array) -> Array:
    """Return the part of x that friction takes, (k, N, m), with widths s_u of rising and s_d of falling x, each (k,).

    dz = (1 − sgn(dx)·z/L)·L/s·dx with L = s_u + s_d, and z = 0 at first. Exact for x monotonic between rows. After a
    long change of x in one direction z is ±L, as of a play of that width; after a turn it changes the faster the
    smaller s. Source: P. R. Dahl, A solid friction model, Aerospace Corp. TOR-0158 (1968).
    """
    rising, falling = up_pa[:, None], down_pa[:, None]
    friction = np.empty((len(x), len(up_pa), x.shape[1]))
    state = np.zeros(friction.shape[1:])
    ways = np.diff(x, axis=0, prepend=0.0)[:, None]
    for first in range(0, len(x), AT_ONCE):
        way, rows = ways[first : first + AT_ONCE], friction[first : first + AT_ONCE]
        kept = np.exp(-np.abs(way) / np.where(way > 0.0, rising, falling))  # part of z that a row leaves
        np.multiply(np.copysign(rising + falling, way), 1.0 - kept, out=rows)
        for row, kept_row in zip(rows, kept, strict=True):
            row += kept_row * state
            state = row
    return np.moveaxis(friction, 1, 0)


def each_of(operators: Callable[..., Array], x: Array, *parameters: Array) -> Iterator[Array]:
    """Yield (N, m) of each of k operators on x, as `plays` or `frictions` (x, *parameters), each parameter (k,).

    Several are computed at once if x (N, m) has few signals; of many signals they would need much memory.
    """
    at_once = max(SIGNALS_AT_ONCE // x.shape[1], 1)
    for first in range(0, len(parameters[0]), at_once):
        yield from operators(x, *(parameter[first : first + at_once] for parameter in parameters))


def flows(x: Array, tau_s: Array, scale_pa: Array, step_s: float) -> Array:
    """Return the part of x that flow has not reached, (k, N, m), with time constants τ and scales s, each (k,).

    It is x − z with τ·dz/dt = s·sinh((x − z)/s) and z = x in the first row; exact for x constant between rows.
    Thermally activated flow: with x constant, tanh((x − z)/2s) decays with τ.
    Source: H. Eyring, J. Chem. Phys. 4 (1936) 283.
    """
    twice, decay = 2.0 * scale_pa[:, None], np.exp(-step_s / tau_s)[:, None]
    late = np.zeros((len(x), len(tau_s), x.shape[1]))
    state = late[0]
    for row, change in zip(late[1:], np.diff(x, axis=0), strict=True):
        state = np.multiply(twice, np.arctanh(decay * np.tanh((state + change) / twice)), out=row)
    return np.moveaxis(late, 1, 0)


def polynomial(x: Array, coefficients: Array) -> Array:
    """Return values (N, ...) at x (N, ...) of polynomials with coefficients (k, ...), lowest power first (Horner)."""
    values = np.empty(x.shape)
    for first in range(0, len(x), AT_ONCE):
        rows, x_rows = values[first : first + AT_ONCE], x[first : first + AT_ONCE]
        rows[:] = coefficients[-1]
        for coefficient in coefficients[-2::-1]:
            rows *= x_rows
            rows += coefficient
    return values


def relay(x: Array, up_pa: float, down_pa: float) -> Array:
    """Return 1 (N, m) from x ≥ up until x ≤ down, else 0, also before x first reaches up (`physics.effects.snap`)."""
    event = np.where(x >= up_pa, 1, np.where(x <= down_pa, -1, 0))
    row = np.where(event != 0, np.arange(len(x))[:, None], 0)
    np.maximum.accumulate(row, axis=0, out=row)
    on: Array = (np.take_along_axis(event, row, axis=0) > 0).astype(float)
    return on
