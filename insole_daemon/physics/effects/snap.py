"""A contact that snaps to and lets go again at a lower load: the cover lifts off, the arch bridges.

The relay switches at values, not at moments, and a load that is linear between its samples is monotonic there: at
the samples it is exact. What follows `snap` sees the step as linear between two samples too.
"""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Moments, Operator, Parameter, Site, Values


class _Snap:
    """x + step · relay[x]."""

    def __init__(self, up: Array, down: Array, step: Array) -> None:
        self._up, self._down, self._step = up, down, step
        self._on: np.ndarray[tuple[int], np.dtype[np.bool_]] | None = None

    def __call__(self, x: Array, moments: Moments) -> Array:
        if self._on is None:
            self._on = np.zeros(x.shape[1], bool)
        relay = x >= self._up
        stays = x > self._down
        last = self._on
        for row, still in zip(relay, stays, strict=True):
            np.logical_and(last, still, out=still)
            last = np.logical_or(still, row, out=row)
        self._on = last.copy()
        return x + self._step * relay


def _forward(values: Values, site: Site) -> Operator:
    return _Snap(values["up_pa"], values["down_pa"], values["step_pa"])


def _inverse(values: Values, site: Site) -> Operator:
    # q leaps over the gap from up to up + step, and back over that from down + step to down: the middle of the gap
    # tells which side it is on, with as much room for noise on either.
    half = values["step_pa"] / 2
    return _Snap(values["up_pa"] + half, values["down_pa"] + half, -values["step_pa"])


def _wrong(values: Values) -> tuple[str, str] | None:
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
        Parameter("up_pa", "Pa", 0.0, 1e7, (20_000.0, 60_000.0), "load that makes it snap to"),
        Parameter("down_pa", "Pa", -1e6, 1e7, (10_000.0, 30_000.0), "load at which it lets go"),
        Parameter("step_pa", "Pa", 0.0, 1e7, (1_000.0, 20_000.0), "what it adds; less than 0 could not be undone"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    wrong=_wrong,
)
