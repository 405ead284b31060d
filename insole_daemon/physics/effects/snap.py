"""Snap: a contact that closes at one load and opens at a lower one: the cover lifts off, or the arch bridges.

The relay switches at values, not at times, and a load that is linear between its samples is monotonic there, so the
result at the samples is exact. Later effects see the step as linear between two samples.

Each taxel switches by its own pressure, or all taxels of a triangle together by their mean: they are on one mesh.
"""

from __future__ import annotations

import numpy as np

from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values


class _Snap:
    """Computes x + step · relay[x·switching]; `switching` (m, m) averages over triangles, None: own pressures."""

    def __init__(self, up: Array, down: Array, step: Array, switching: Array | None) -> None:
        self._up, self._down, self._step, self._switching = up, down, step, switching
        self._on: np.ndarray[tuple[int], np.dtype[np.bool_]] | None = None

    def __call__(self, x: Array, moments: Moments) -> Array:
        if self._on is None:
            self._on = np.zeros(x.shape[1], bool)
        switches_at = x if self._switching is None else x @ self._switching
        is_on = switches_at >= self._up
        is_kept = switches_at > self._down
        previous = self._on
        for row, kept_row in zip(is_on, is_kept, strict=True):
            np.logical_and(previous, kept_row, out=kept_row)
            previous = np.logical_or(kept_row, row, out=row)
        self._on = previous.copy()
        return x + self._step * is_on


def _forward(values: Values, site: Site) -> Operator:
    return _Snap(values["up_pa"], values["down_pa"], values["step_pa"], _switching(values, site))


def _inverse(values: Values, site: Site) -> Operator:
    # q jumps from up to up + step, and back from down + step to down; the middle of the gap separates the two states
    # with equal margins for noise.
    half_step = values["step_pa"] / 2
    up, down = values["up_pa"] + half_step, values["down_pa"] + half_step
    return _Snap(up, down, -values["step_pa"], _switching(values, site))


def _switching(values: Values, site: Site) -> Array | None:
    """Return the weights (m, m) of pressures in those by which taxels switch: own, or the mean of the triangle."""
    together = values.get("together")
    if together is None or not together.any():
        return None
    row, taxel = np.divmod(site.columns, N_TAXELS)
    weights = (row[:, None] == row) * PRESSURE_TAXELS[taxel][:, None].astype(np.float64)
    means = weights / np.maximum(weights.sum(axis=0), 1.0)
    return np.asarray(np.where(together != 0.0, means, np.eye(len(row))))


def _find_problem(values: Values) -> tuple[str, str] | None:
    up, down = np.broadcast_arrays(values["up_pa"], values["down_pa"])
    if (down < up).all():
        return None
    i = int(np.argmax(down >= up))
    return "down_pa", f"expected less than up_pa, which is {up.flat[i]:g}, found {down.flat[i]:g}"


LAW = Law(
    word="snap",
    order=4,
    domain="pressure",
    equation="q = P + A·R[P], R relay: 1 from P ≥ up until P ≤ down",
    source="relay hysteron: Mayergoyz, Mathematical Models of Hysteresis (1991), ch. 1",
    parameters=(
        Parameter("up_pa", "Pa", 0.0, 1e7, (20_000.0, 60_000.0), "load at which the contact closes"),
        Parameter("down_pa", "Pa", -1e6, 1e7, (10_000.0, 30_000.0), "load at which the contact opens"),
        Parameter("step_pa", "Pa", 0.0, 1e7, (1_000.0, 20_000.0), "added pressure; a negative one has no inverse"),
        Parameter(
            "together",
            "1",
            0.0,
            1.0,
            (0.0, 1.0),
            "1: all taxels of a triangle switch together, by the mean of their pressures; 0 or absent: each by its own",
            whole=True,
            is_optional=True,
        ),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    find_problem=_find_problem,
)
