"""The one contract of every load that is put on simulated insoles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..skin.layout import Foot, Layout


class Load(Protocol):
    """A pressure on every taxel as a function of time alone: asked twice, it answers the same."""

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n_times, n_triangles, 12) Pa at the times `t_s` (n_times,), triangles in the layout's order.

        0 on the thermal pads (6 and 10): they stand for no area of the insole.
        """
        ...


class Unloaded:
    """Insoles that nobody stands on."""

    def __init__(self, layouts: Sequence[Layout]) -> None:
        """`layouts`: one a foot."""
        self._n_triangles = {layout.foot: len(layout.triangles) for layout in layouts}

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """See Load: 0 everywhere."""
        return np.zeros((len(t_s), self._n_triangles[foot], 12))
