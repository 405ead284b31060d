"""Arrays of halves: the value before each one, and the counts and status words in their bytes."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

S = TypeVar("S", np.int16, np.int64, np.uint64)


def row_offsets(n: int, length: int) -> NDArray[np.int64]:
    """Return the flat index (n, 1) at which each row of a table with `length` columns begins."""
    return (np.arange(n) * length)[:, None]


def previous_rows(stored: NDArray[S], rows: NDArray[S]) -> NDArray[S]:
    """Return the row before each of the n rows, (n, …); `stored` for the first."""
    return stored[None] if len(rows) == 1 else np.concatenate([stored[None], rows[:-1]])


def previous_values(keys: NDArray[Any], values: NDArray[S], stored: NDArray[S]) -> NDArray[S]:
    """Return the previous value with the same key for each of n values, (n,); `stored` (k,) for the first of a key."""
    before: NDArray[S] = stored[keys]
    order = np.argsort(keys, kind="stable")
    later = np.flatnonzero(keys[order[1:]] == keys[order[:-1]]) + 1
    before[order[later]] = values[order[later - 1]]
    return before


def decode_counts(halves: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return counts (n, n_triangles, 12) of halves (n, n_triangles, 16): seven after the tag of A, five after B's."""
    counts = np.empty((*halves.shape[:2], 12), np.uint8)
    counts[:, :, :7] = halves[:, :, 1:8]
    counts[:, :, 7:] = halves[:, :, 9:14]
    return counts


def decode_status(halves: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Return the status words (n, n_triangles) of halves (n, n_triangles, 16), which have the high byte first."""
    return halves[:, :, 14:].view(">u2")[:, :, 0].astype(np.uint16)
