"""What a signal was a little earlier, between two samples by interpolation: exact where it is linear there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .law import Array


class Past:
    """Consecutive pieces of a signal, kept as long as they are asked for; before the first sample it was that."""

    def __init__(self) -> None:
        self._t_s = np.empty(0)
        self._x: Array | None = None

    def at(self, x: Array, t_s: Array, wanted: Sequence[tuple[Array, NDArray[np.intp]]]) -> Array:
        """(n, m) of the piece `x` (n, m) at `t_s` (n,), each of its columns as it was when its group asks for.

        `wanted`: moments (n,) that do not go back, not even from piece to piece, none after its own of `t_s`, and the
        columns that are as they were then; all columns together.
        """
        t = np.concatenate([self._t_s, t_s])
        known = x if self._x is None else np.concatenate([self._x, x])
        was = np.empty_like(x)
        for moments, columns in wanted:
            after = np.searchsorted(t, moments, side="left").clip(0, len(t) - 1)
            before = np.maximum(after - 1, 0)
            gap = t[after] - t[before]
            share = np.where(gap > 0, (moments - t[before]) / np.where(gap > 0, gap, 1.0), 0.0).clip(0.0, 1.0)
            since, until = known[before[:, None], columns], known[after[:, None], columns]
            was[:, columns] = since + share[:, None] * (until - since)
        # The newest sample that is not after anything that will be asked for, and what came since.
        oldest = min(moments[-1] for moments, _ in wanted)
        keep = max(int(np.searchsorted(t, oldest, side="right")) - 1, 0)
        self._t_s, self._x = t[keep:].copy(), known[keep:].copy()
        return was
