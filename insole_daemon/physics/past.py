"""Interpolate a signal at slightly earlier times; exact if the signal is linear between its samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .law import Array


class SignalHistory:
    """Keeps consecutive pieces of a signal as long as they are needed; before the first sample it had that value."""

    def __init__(self) -> None:
        self._t_s = np.empty(0)
        self._x: Array | None = None

    def at(self, x: Array, t_s: Array, wanted: Sequence[tuple[Array, NDArray[np.intp]]]) -> Array:
        """Return (n, m) the piece `x` (n, m) at `t_s` (n,), with each column evaluated at the times of its group.

        `wanted` has (times (n,), columns) of each group; together the groups have all columns. Times must not decrease,
        not even between pieces, and must not be later than `t_s`.
        """
        t = np.concatenate([self._t_s, t_s])
        known = x if self._x is None else np.concatenate([self._x, x])
        interpolated = np.empty_like(x)
        for moments, columns in wanted:
            after = np.searchsorted(t, moments, side="left").clip(0, len(t) - 1)
            before = np.maximum(after - 1, 0)
            gap = t[after] - t[before]
            share = np.where(gap > 0, (moments - t[before]) / np.where(gap > 0, gap, 1.0), 0.0).clip(0.0, 1.0)
            earlier, later = known[before[:, None], columns], known[after[:, None], columns]
            interpolated[:, columns] = earlier + share[:, None] * (later - earlier)
        # Keep the newest sample before all future times, and everything after it.
        oldest = min(moments[-1] for moments, _ in wanted)
        keep = max(int(np.searchsorted(t, oldest, side="right")) - 1, 0)
        self._t_s, self._x = t[keep:].copy(), known[keep:].copy()
        return interpolated
