"""Tasks T4 to T6: walking for some time, at three speeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...skin.layout import Foot, Layout
from ..foot import Places, Walk
from .standing import weight_fraction


class WalkingTask(Walk):
    """A Walk with the feet in the air at the beginning and at the end."""

    def __init__(
        self,
        layouts: Sequence[Layout],
        body_mass_kg: float,
        cadence_per_min: float,
        seed: int,
        places: Places | None,
        seconds: float,
    ) -> None:
        super().__init__(layouts, body_mass_kg, cadence_per_min, seed, places)
        self._seconds = seconds

    def force_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times,) f_z of `foot`; 0 in swing, in the air and before the first step."""
        return super().force_n(foot, t_s) * weight_fraction(t_s, self._seconds)
