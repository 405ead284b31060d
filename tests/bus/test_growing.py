"""Batches copied into one."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.growing import GrowingBatch


def numbered(first: int, n: int) -> FrameBatch:
    rows = np.arange(first, first + n)
    return FrameBatch(
        rows, rows + 1, rows.astype(np.uint8), rows.astype(np.uint32), (rows % 9).astype(np.uint8),
        np.tile(rows.astype(np.uint8)[:, None], 8), (rows % 4).astype(np.uint8),
    )  # fmt: skip


@pytest.mark.parametrize("expected", [0, 7, 100, 1000])
def test_a_wrong_estimate_loses_nothing(expected: int) -> None:
    growing = GrowingBatch()
    for first in range(0, 100, 5):
        growing.append(numbered(first, 5), expected)
    for name in FrameBatch.__slots__:
        result, whole = getattr(growing.batch(), name), getattr(numbered(0, 100), name)
        assert result.dtype == whole.dtype
        assert np.array_equal(result, whole)


def test_empty_buffer_gives_an_empty_batch() -> None:
    assert len(GrowingBatch().batch()) == 0
