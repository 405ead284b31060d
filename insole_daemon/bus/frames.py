"""A batch of CAN frames: one row per frame, one array per property."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

EXTENDED = 0x01  # 29-bit identifier
REMOTE = 0x02  # remote transmission request: no data
ERROR = 0x04  # error frame of the driver: `can_id` holds the error class, never a message
FD = 0x08  # CAN FD: `dlc` is the payload's length (up to 64), `data` its first 8 bytes

# One frame of a saturated 1 Mbit/s bus with 8 data bytes takes at least 111 bit times (no stuff bits,
# inter-frame space included; ISO 11898-1), so n frames of one interface never arrive in less than n of these.
FRAME_TIME_NS = 111_000


@dataclass(frozen=True, slots=True)
class FrameBatch:
    """Frames in the order received; every array has the same first length n (which may be 0)."""

    t_ns: NDArray[np.int64]  # (n,) kernel receive time, CLOCK_REALTIME, ns; may step
    t_mono_ns: NDArray[np.int64]  # (n,) the same moments on the monotonic clock, ns; never decreases
    interface: NDArray[np.uint8]  # (n,) index into the source's `interfaces`
    can_id: NDArray[np.uint32]  # (n,) identifier without flag bits
    dlc: NDArray[np.uint8]  # (n,) bytes of payload
    data: NDArray[np.uint8]  # (n, 8) payload; bytes beyond dlc are 0
    flags: NDArray[np.uint8]  # (n,) EXTENDED | REMOTE | ERROR | FD

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def has_flags(self) -> bool:
        """Whether any frame is not a standard data frame."""
        return bool(np.count_nonzero(self.flags))

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> FrameBatch:
        """Return the frames that `rows` selects, as a batch."""
        return FrameBatch(
            self.t_ns[rows], self.t_mono_ns[rows], self.interface[rows], self.can_id[rows],
            self.dlc[rows], self.data[rows], self.flags[rows],
        )  # fmt: skip

    @classmethod
    def empty(cls) -> Self:
        """Return a batch without frames."""
        return cls(
            np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.uint8), np.empty(0, np.uint32),
            np.empty(0, np.uint8), np.empty((0, 8), np.uint8), np.empty(0, np.uint8),
        )  # fmt: skip

    @classmethod
    def concatenate(cls, batches: Sequence[FrameBatch]) -> FrameBatch:
        """Return the batches joined in order."""
        if len(batches) == 1:
            return batches[0]
        if not batches:
            return cls.empty()
        return cls(
            np.concatenate([b.t_ns for b in batches]),
            np.concatenate([b.t_mono_ns for b in batches]),
            np.concatenate([b.interface for b in batches]),
            np.concatenate([b.can_id for b in batches]),
            np.concatenate([b.dlc for b in batches]),
            np.concatenate([b.data for b in batches]),
            np.concatenate([b.flags for b in batches]),
        )


class ReceivedFrames(FrameBatch):
    """Standard data frames of 8 bytes, in one block of memory from the compiled kernel.

    The block holds t_ns and t_mono_ns (int64), `struct can_frame` (16 bytes) and the interface (uint8), each for all
    frames. The live path passes the block on; the arrays are read-only views that are made on access.
    """

    __slots__ = ("block",)
    FRAME_BYTES: ClassVar = 33
    block: bytes

    def __init__(self, block: bytes) -> None:
        object.__setattr__(self, "block", block)

    def __len__(self) -> int:
        return len(self.block) // self.FRAME_BYTES

    def __reduce__(self) -> tuple[type[ReceivedFrames], tuple[bytes]]:
        return ReceivedFrames, (self.block,)

    @property
    def has_flags(self) -> bool:
        """False: all are standard data frames."""
        return False

    @property
    def raw(self) -> NDArray[np.uint8]:
        """(n, 16) `struct can_frame`."""
        n = len(self)
        return np.frombuffer(self.block, np.uint8, 16 * n, 16 * n).reshape(n, 16)

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """See FrameBatch."""
        return np.frombuffer(self.block, np.int64, len(self))

    @property
    def t_mono_ns(self) -> NDArray[np.int64]:
        """See FrameBatch."""
        n = len(self)
        return np.frombuffer(self.block, np.int64, n, 8 * n)

    @property
    def interface(self) -> NDArray[np.uint8]:
        """See FrameBatch."""
        n = len(self)
        return np.frombuffer(self.block, np.uint8, n, 32 * n)

    @property
    def can_id(self) -> NDArray[np.uint32]:
        """See FrameBatch."""
        return self.raw.view(np.uint32)[:, 0]

    @property
    def dlc(self) -> NDArray[np.uint8]:
        """See FrameBatch."""
        return self.raw[:, 4]

    @property
    def data(self) -> NDArray[np.uint8]:
        """See FrameBatch."""
        return self.raw[:, 8:]

    @property
    def flags(self) -> NDArray[np.uint8]:
        """See FrameBatch."""
        return np.zeros(len(self), np.uint8)
