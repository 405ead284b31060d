"""Tasks T1 to T3: standing still on both feet, on the left foot, and slow movements.

Each begins with the feet in the air and ends so: that is the insole's rest, and what drifts shows there.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...physics.portable import sin_turns
from ...skin.layout import Foot, Layout
from ..foot import Person, Places, standing

ALOFT_S = 2.0  # at the beginning and at the end
STEP_S = 1.0  # to put the weight on, and off


def on_the_ground(t_s: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
    """(n,) 0 to 1, the share of the weight that is on the ground in a task of `seconds`."""
    since = np.clip((t_s - ALOFT_S) / STEP_S, 0.0, 1.0)
    left = np.clip((seconds - ALOFT_S - t_s) / STEP_S, 0.0, 1.0)
    part = np.minimum(since, left)
    smooth: NDArray[np.float64] = part * part * (3 - 2 * part)
    return smooth


class _Standing(Person):
    """Who stands for `seconds`: share of the weight on each foot, lean forward, tiptoe and tilt."""

    def __init__(self, layouts: Sequence[Layout], body_mass_kg: float, places: Places | None, seconds: float) -> None:
        super().__init__(layouts, body_mass_kg, places)
        self._seconds = seconds

    def region_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """See Person."""
        force_n = self.weight_n * on_the_ground(t_s, self._seconds) * self._share(foot, t_s)
        return standing(force_n, *self._lean(foot, t_s))

    @abstractmethod
    def _share(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n_times,) of the weight that `foot` bears."""

    @abstractmethod
    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """(n_times,) each: forward, tiptoe and tilt, as in `foot.standing`."""


class Still(_Standing):
    """T1: half the weight on each foot, swaying by 4 % of it sideways and some mm forward."""

    def _share(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        sideways = 0.04 * sin_turns(0.31 * t_s)
        return 0.5 + (sideways if foot == "left" else -sideways)

    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        return 1 + 0.06 * sin_turns(0.23 * t_s), np.zeros_like(t_s), np.zeros_like(t_s)


class Balance(_Standing):
    """T2: all the weight on the left foot; who balances sways faster, and more to the sides."""

    def _share(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.full_like(t_s, 1.0 if foot == "left" else 0.0) * (1 + 0.01 * sin_turns(0.9 * t_s))

    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        return 1.4 + 0.12 * sin_turns(0.4 * t_s), np.zeros_like(t_s), 0.15 * sin_turns(0.55 * t_s)


class Moves(_Standing):
    """T3: the weight goes from foot to foot every 11 s, from heels to tiptoe every 7, to the edges every 13.

    As published, it is there to press every taxel through its range.
    """

    def _share(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        sideways = 0.46 * sin_turns(t_s / 11)
        return 0.5 + (sideways if foot == "left" else -sideways)

    def _lean(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        forward = sin_turns(t_s / 7)
        return 1 + 0.9 * np.minimum(forward, 0.0), 0.9 * np.maximum(forward, 0.0), 0.8 * sin_turns(t_s / 13)
