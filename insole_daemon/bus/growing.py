"""Many batches into one, without holding them all twice."""

from __future__ import annotations

import numpy as np

from .frames import FrameBatch


class GrowingBatch:
    """Copies batches one behind another as they come, so that each can be forgotten at once.

    Next to parsing, memory that is touched for the first time is what costs most: room is made once where the
    number of frames can be estimated, and by halves more where not.
    """

    def __init__(self) -> None:
        """With no frame in it."""
        self._room = FrameBatch.empty()
        self._held = 0

    def append(self, frames: FrameBatch, expected: int) -> None:
        """Add `frames`; `expected` is an estimate of how many there will be in all."""
        end = self._held + len(frames)
        if end > len(self._room):
            before = self.batch()
            self._room = _unwritten(max(expected + expected // 16, end + end // 2))
            self._write(slice(0, self._held), before)
        self._write(slice(self._held, end), frames)
        self._held = end

    def batch(self) -> FrameBatch:
        """All that was added, without a copy."""
        return self._room[: self._held]

    def _write(self, rows: slice, frames: FrameBatch) -> None:
        for name in FrameBatch.__slots__:
            getattr(self._room, name)[rows] = getattr(frames, name)


def _unwritten(n: int) -> FrameBatch:
    """A batch of `n` frames whose values are whatever was in memory."""
    return FrameBatch(
        np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.uint8), np.empty(n, np.uint32),
        np.empty(n, np.uint8), np.empty((n, 8), np.uint8), np.empty(n, np.uint8),
    )  # fmt: skip
