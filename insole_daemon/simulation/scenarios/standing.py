"""Tasks T1 to T3: standing still on both feet, standing on the left foot, and slow movements.

Each begins and ends with the feet in the air, so that the insole is unloaded and drift is visible.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...physics.portable import sin_turns
from ...skin.layout import Foot, Layout
from ..foot import Person, Places, distribute_standing_force

ALOFT_S = 2.0  # time in the air at the beginning and at the end
STEP_S = 1.0  # time to put the weight on or off


def weight_fraction(t_s: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
    """Return (n,) the fraction of the weight on the ground, 0 to 1, in a task of `seconds`."""
    ramp_up = np.clip((t_s - ALOFT_S) / STEP_S, 0.0, 1.0)
    ramp_down = np.clip((seconds - ALOFT_S - t_s) / STEP_S, 0.0, 1.0)
    ramp = np.minimum(ramp_up, ramp_down)
    smooth: NDArray[np.float64] = ramp * ramp * (3 - 2 * ramp)
    return smooth


class _Standing(Person):
    """A person who stands for `seconds`: fraction of the weight on each foot, forward lean, tiptoe and tilt."""

    def __init__(self, layouts: Sequence[Layout], body_mass_kg: float, places: Places | None, seconds: float) -> None:
        super().__init__(layouts, body_mass_kg, places)
        self._seconds = seconds

    def region_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force on each region; see Person."""
        force_n = self.weight_n * weight_fraction(t_s, self._seconds) * self._foot_fraction(foot, t_s)
        return distribute_standing_force(force_n, *self._lean(foot, t_s))

    @abstractmethod
    def _foot_fraction(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times,) the fraction of the weight on `foot`."""

    @abstractmethod
    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return forward, tiptoe and tilt, (n_times,) each, as in `foot.distribute_standing_force`."""


class Still(_Standing):
    """T1: half the weight on each foot, swaying by 4 % of it sideways and some mm forward."""

    def _foot_fraction(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        sideways = 0.04 * sin_turns(0.31 * t_s)
        return 0.5 + (sideways if foot == "left" else -sideways)

    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        return 1 + 0.06 * sin_turns(0.23 * t_s), np.zeros_like(t_s), np.zeros_like(t_s)


class Balance(_Standing):
    """T2: all weight on the left foot; balancing sways faster and more sideways."""

    def _foot_fraction(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.full_like(t_s, 1.0 if foot == "left" else 0.0) * (1 + 0.01 * sin_turns(0.9 * t_s))

    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        return 1.4 + 0.12 * sin_turns(0.4 * t_s), np.zeros_like(t_s), 0.15 * sin_turns(0.55 * t_s)


class Moves(_Standing):
    """T3: the weight moves between the feet with a period of 11 s, from heels to tiptoe in 7 s, to the edges in 13 s.

    As published, this task presses every taxel through its range.
    """

    def _foot_fraction(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        sideways = 0.46 * sin_turns(t_s / 11)
        return 0.5 + (sideways if foot == "left" else -sideways)

    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        forward = sin_turns(t_s / 7)
        return 1 + 0.9 * np.minimum(forward, 0.0), 0.9 * np.maximum(forward, 0.0), 0.8 * sin_turns(t_s / 13)
