"""Model when readings are taken and stamped, and which frames are lost.

A converter (AD7147) runs freely: its twelve stages take 36.864 ms at decimation 256, and a board that reads more often
gets the last sequence again. Source: AD7147 data sheet, table 10; icub-firmware, AD7147.c 71. Random draws come from
one seed per board, sample after sample, so that pieces and one whole give the same numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .draws import Drawn, Draws
from .law import Array

CDC_HZ = 1 / 36.864e-3


def draw_phases_s(seed: int, board: int, hz: float = CDC_HZ) -> Array:
    """Return (16,) times at which the converters of the board's triangles first complete a sequence."""
    phases: Array = Draws(seed, Drawn.CONVERTERS, board).uniform(16) / hz
    return phases


def sequence_number(t_s: Array, phase_s: ArrayLike, hz: float = CDC_HZ) -> NDArray[np.int64]:
    """Return (n, …) number of the last sequence completed at `t_s` (n,); number 0 completed at `phase_s` (…)."""
    phase = np.asarray(phase_s, np.float64)
    number: NDArray[np.int64] = np.floor((t_s.reshape(-1, *(1,) * phase.ndim) - phase) * hz).astype(np.int64)
    return number


def conversion_time_s(t_s: Array, phase_s: ArrayLike, hz: float = CDC_HZ) -> Array:
    """Return (n, …) completion times of those sequences: a reading at `t_s` has the load of that time."""
    return np.asarray(phase_s, np.float64) + sequence_number(t_s, phase_s, hz) / hz


class Jitter:
    """Random delay of a board's samples, half-normal."""

    def __init__(self, std_s: float, seed: int, board: int) -> None:
        """`std_s` is the scale of the half-normal distribution."""
        self._std_s = std_s
        self._draws = Draws(seed, Drawn.JITTER, board)

    def draw_delays_s(self, n: int) -> Array:
        """Return (n,) delays of the next n samples."""
        delays_s: Array = self._std_s * np.abs(self._draws.normal(n))
        return delays_s


class Losses:
    """Random loss of a board's frames: a fraction `share` on average, in runs of `run` frames on average.

    Gilbert's two-state chain (Bell Syst. Tech. J. 39, 1960): whether a frame is lost depends on the one before.
    """

    def __init__(self, share: float, run: float, seed: int, board: int) -> None:
        """`share` is at most run/(1 + run), else such runs are impossible."""
        self._begin_probability, self._continue_probability = share / (run * (1 - share)), 1 - 1 / run
        self._draws = Draws(seed, Drawn.LOSSES, board)
        self._lost = bool(self._draws.uniform(1)[0] < share)  # whether the next frame is lost

    def draw_losses(self, n: int) -> NDArray[np.bool_]:
        """Return (n,) which of the next n frames are lost."""
        uniform = self._draws.uniform(n)
        # Each draw maps the two states onto constants, onto themselves, or onto each other.
        if_not, if_lost = uniform < self._begin_probability, uniform < self._continue_probability
        state = np.empty(n + 1, np.bool_)
        state[0] = self._lost
        state[1:] = if_not
        fixed = np.concatenate([[True], if_not == if_lost])
        exchanges = np.cumsum(np.concatenate([[False], if_not & ~if_lost]))
        since = np.maximum.accumulate(np.where(fixed, np.arange(n + 1), 0))
        lost: NDArray[np.bool_] = state[since] ^ ((exchanges - exchanges[since]) % 2 == 1)
        self._lost = bool(lost[-1])
        return lost[:-1]
