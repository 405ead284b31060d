"""When a reading was really taken, when it seems to have been, and which never come.

A converter (AD7147) runs freely: its twelve stages take 36.864 ms at decimation 256, and whoever asks more often
reads the last sequence again. Source: AD7147 data sheet, table 10; icub-firmware, AD7147.c 71.
None of these has an inverse: a value that was never read cannot be had back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .law import Array

CDC_HZ = 1 / 36.864e-3


def sequence(t_s: Array, phase_s: ArrayLike, hz: float = CDC_HZ) -> NDArray[np.int64]:
    """(n, …) number of the converter's sequence that was through last at `t_s` (n,); its 0th was at `phase_s` (…)."""
    phase = np.asarray(phase_s, np.float64)
    number: NDArray[np.int64] = np.floor((t_s.reshape(-1, *(1,) * phase.ndim) - phase) * hz).astype(np.int64)
    return number


def taken_s(t_s: Array, phase_s: ArrayLike, hz: float = CDC_HZ) -> Array:
    """(n, …) when that sequence was through: what is read at `t_s` is the load of then."""
    return np.asarray(phase_s, np.float64) + sequence(t_s, phase_s, hz) / hz


def jittered_s(t_s: Array, std_s: float, rng: np.random.Generator) -> Array:
    """(n,) stamps of what was there at `t_s`: later by half-normal luck of scale `std_s`, in the same order."""
    late: Array = np.maximum.accumulate(t_s + np.abs(rng.normal(0.0, std_s, len(t_s))))
    return late


def lost(n: int, share: float, run: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(n,) which of n samples never come: `share` of them on average, in runs of `run` samples on average.

    Gilbert's two-state chain (Bell Syst. Tech. J. 39, 1960): the next is lost by whether this one is.
    """
    if not (0 <= share < 1 and run >= 1 and share <= run * (1 - share)):
        raise ValueError(f"expected a share below 1 in runs of at least 1, found {share:g} in runs of {run:g}")
    fall = share / (run * (1 - share))
    luck = rng.random(n + 1)
    state = bool(luck[0] < share)
    states = np.empty(n, bool)
    for i, draw in enumerate(luck[1:]):
        states[i] = state
        state = draw >= 1 / run if state else draw < fall
    return states


def held(x: Array, missing: NDArray[np.bool_]) -> Array:
    """`x` (n, …) with the last that came in the place of what is `missing` (n,); the first is taken to have come."""
    row = np.where(missing, 0, np.arange(len(x)))
    return x[np.maximum.accumulate(row)]
