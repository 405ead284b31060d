"""When a reading was really taken, when it seems to have been, and which never come.

A converter (AD7147) runs freely: its twelve stages take 36.864 ms at decimation 256, and whoever asks more often
reads the last sequence again. Source: AD7147 data sheet, table 10; icub-firmware, AD7147.c 71.
What is left to chance comes from one seed, a board at a time, sample after sample: in pieces as in one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .draws import Drawn, Draws
from .law import Array

CDC_HZ = 1 / 36.864e-3


def phases_s(seed: int, board: int, hz: float = CDC_HZ) -> Array:
    """(16,) when the converters of the board's triangles are through for the first time."""
    phases: Array = Draws(seed, Drawn.CONVERTERS, board).uniform(16) / hz
    return phases


def sequence(t_s: Array, phase_s: ArrayLike, hz: float = CDC_HZ) -> NDArray[np.int64]:
    """(n, …) number of the converter's sequence that was through last at `t_s` (n,); its 0th was at `phase_s` (…)."""
    phase = np.asarray(phase_s, np.float64)
    number: NDArray[np.int64] = np.floor((t_s.reshape(-1, *(1,) * phase.ndim) - phase) * hz).astype(np.int64)
    return number


def taken_s(t_s: Array, phase_s: ArrayLike, hz: float = CDC_HZ) -> Array:
    """(n, …) when that sequence was through: what is read at `t_s` is the load of then."""
    return np.asarray(phase_s, np.float64) + sequence(t_s, phase_s, hz) / hz


class Jitter:
    """By how much samples of a board are late: half-normal luck."""

    def __init__(self, std_s: float, seed: int, board: int) -> None:
        """`std_s`: the scale."""
        self._std_s = std_s
        self._luck = Draws(seed, Drawn.JITTER, board)

    def late_s(self, n: int) -> Array:
        """(n,) of the next n."""
        late: Array = self._std_s * np.abs(self._luck.normal(n))
        return late


class Losses:
    """Which of a board's frames never come: `share` of them on average, in runs of `run` frames on average.

    Gilbert's two-state chain (Bell Syst. Tech. J. 39, 1960): the next is lost by whether this one is.
    """

    def __init__(self, share: float, run: float, seed: int, board: int) -> None:
        """`share` at most run/(1 + run), else such runs cannot be."""
        self._begins, self._goes_on = share / (run * (1 - share)), 1 - 1 / run
        self._luck = Draws(seed, Drawn.LOSSES, board)
        self._lost = bool(self._luck.uniform(1)[0] < share)  # the next one

    def next(self, n: int) -> NDArray[np.bool_]:
        """(n,) of the next n."""
        luck = self._luck.uniform(n)
        # Each draw maps lost or not onto lost or not: to one of them, or it keeps them, or exchanges them.
        if_not, if_lost = luck < self._begins, luck < self._goes_on
        state = np.empty(n + 1, np.bool_)
        state[0] = self._lost
        state[1:] = if_not
        fixed = np.concatenate([[True], if_not == if_lost])
        exchanges = np.cumsum(np.concatenate([[False], if_not & ~if_lost]))
        since = np.maximum.accumulate(np.where(fixed, np.arange(n + 1), 0))
        lost: NDArray[np.bool_] = state[since] ^ ((exchanges - exchanges[since]) % 2 == 1)
        self._lost = bool(lost[-1])
        return lost[:-1]
