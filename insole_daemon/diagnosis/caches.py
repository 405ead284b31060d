"""Memory of cached properties, whose arrays are large."""

from __future__ import annotations

import ctypes
from collections.abc import Collection
from dataclasses import fields
from typing import Any

M_MMAP_THRESHOLD, LARGE_BYTES = -3, 1 << 20  # an option of malloc.h, and its value here


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


def return_large_arrays() -> None:
    """Let arrays above LARGE_BYTES return to the system as they are freed, in the C library of GNU.

    It otherwise raises that limit to up to 32 MB, and what was freed between arrays in use stays.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(M_MMAP_THRESHOLD, LARGE_BYTES)
