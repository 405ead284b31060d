"""The interface of every load on simulated insoles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..skin.layout import Foot, Layout


class Load(Protocol):
    """A pressure on every taxel as a function of time alone: the same time gives the same pressure."""

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times, n_triangles, 12) Pa at the times `t_s` (n_times,), triangles in the layout's order.

        The pressure is 0 on the thermal pads (6 and 10), which have no area of the insole.
        """
        ...


class Unloaded:
    """Insoles without a load."""

    def __init__(self, layouts: Sequence[Layout]) -> None:
        """`layouts` has one layout per foot."""
        self._n_triangles = {layout.foot: len(layout.triangles) for layout in layouts}

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return 0 everywhere; see Load."""
        return np.zeros((len(t_s), self._n_triangles[foot], 12))
