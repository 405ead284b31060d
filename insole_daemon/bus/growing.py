"""Join many batches into one, without holding all of them twice."""

from __future__ import annotations

import numpy as np

from .frames import FrameBatch


class GrowingBatch:
    """Copies batches one after another, so that each can be freed at once.

    Besides parsing, touching new memory takes most of the time. Room is therefore allocated once if the number of
    frames can be estimated, and grows by half if not.
    """

    def __init__(self) -> None:
        """Start without frames."""
        self._room = FrameBatch.empty()
        self._held = 0

    def append(self, frames: FrameBatch, expected: int) -> None:
        """Add `frames`; `expected` is an estimate of the total number."""
        end = self._held + len(frames)
        if end > len(self._room):
            before = self.batch()
            self._room = _unwritten(max(expected + expected // 16, end + end // 2))
            self._write(slice(0, self._held), before)
        self._write(slice(self._held, end), frames)
        self._held = end

    def batch(self) -> FrameBatch:
        """Return all frames, without a copy."""
        return self._room[: self._held]

    def _write(self, rows: slice, frames: FrameBatch) -> None:
        for name in FrameBatch.__slots__:
            getattr(self._room, name)[rows] = getattr(frames, name)


def _unwritten(n: int) -> FrameBatch:
    """Return a batch of `n` frames with undefined values."""
    return FrameBatch(
        np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.uint8), np.empty(n, np.uint32),
        np.empty(n, np.uint8), np.empty((n, 8), np.uint8), np.empty(n, np.uint8),
    )  # fmt: skip
