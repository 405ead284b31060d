"""Memory of cached properties, whose arrays are large."""

from __future__ import annotations

import ctypes
from collections.abc import Collection
from dataclasses import fields
from typing import Any

M_MMAP_THRESHOLD, LARGE_BYTES = -3, 16 << 20  # options of malloc.h, and their values here
M_TRIM_THRESHOLD, MOST_FREED_BYTES = -1, 64 << 20


def forget_cached(*owners: Any, kept: Collection[str] = ()) -> None:
    """Delete what each of `owners`, dataclasses without slots, has cached, but for the properties `kept`.

    It is computed again on demand.
    """
    for owner in owners:
        for name in vars(owner).keys() - {field.name for field in fields(owner)} - set(kept):
            del vars(owner)[name]


def return_freed_memory() -> None:
    """Return freed memory to the system; the C library of GNU otherwise keeps much of it, others have no such call."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def reuse_freed_memory() -> None:
    """Let the C library of GNU keep freed memory for the next arrays, but for arrays above LARGE_BYTES.

    A page that returns to the system must be cleared before it comes back: with arrays of 1 MB as the limit, that took
    a third of the time of a diagnosis. Without one, what was freed between larger arrays in use stays.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(M_MMAP_THRESHOLD, LARGE_BYTES)
        set_option(M_TRIM_THRESHOLD, MOST_FREED_BYTES)
