"""Chamber scenarios: the same known pressure on every taxel, in a vacuum bag or a pressure chamber.

Sources: Sorrentino et al. 2020, section 4.1 (vacuum bag, three slow cycles); Kangro et al. 2018 (plenum). Cycles at two
speeds, a hold with its recovery and minor loops separate hysteresis, viscoelasticity and creep.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...physics.portable import interpolate
from ...skin.geometry import PRESSURE_TAXELS
from ...skin.layout import Foot, Layout
from ..conditions import ChamberCycles

REST_S = 5.0  # unloaded time at the beginning and at the end


def programme(top_pa: float, speeds_pa_s: Sequence[float], chosen: ChamberCycles) -> NDArray[np.float64]:
    """Return (n, 2) turning points (s, Pa): cycles to `top_pa` at each speed, then a hold and minor loops."""
    pressures = [point for _ in speeds_pa_s for _ in range(chosen.cycles) for point in (top_pa, 0.0)]
    speeds = [speed for speed in speeds_pa_s for _ in range(2 * chosen.cycles)]
    pressures += [top_pa, top_pa, 0.0, 0.0]
    if chosen.minor:
        pressures += [*(fraction * top_pa for fraction in chosen.minor), 0.0]
    speeds += [speeds_pa_s[-1]] * (len(pressures) - len(speeds))
    turns = [(0.0, 0.0), (REST_S, 0.0)]
    for pressure, speed in zip(pressures, speeds, strict=True):
        t_s, last = turns[-1]
        turns.append((t_s + (abs(pressure - last) / speed if pressure != last else chosen.hold_s), pressure))
    turns.append((turns[-1][0] + REST_S, 0.0))
    return np.array(turns)


class Chamber:
    """A load that is linear between turning points and constant after the last one."""

    def __init__(self, layouts: Sequence[Layout], turns: NDArray[np.float64]) -> None:
        """`layouts` has one layout per foot, all in the chamber; `turns` (n, 2) are in s and Pa."""
        self._shapes = {layout.foot: (len(layout), len(PRESSURE_TAXELS)) for layout in layouts}
        self._turns = turns

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pressure; see Load."""
        pressure = np.zeros((len(t_s), *self._shapes[foot]))
        pressure[..., PRESSURE_TAXELS] = self.level_pa(t_s)[:, None, None]
        return pressure

    def level_pa(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times,) the chamber's pressure."""
        return interpolate(t_s, self._turns[:, 0], self._turns[:, 1])

    def reference(self, foot: Foot, t_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return the column pressure_pa (n_times,)."""
        return {"pressure_pa": self.level_pa(t_s)}
