"""Assignment of frames to the halves of triangles, and counts of all other traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from ..compiled import kernel
from .identifiers import (
    CLASS_LEGACY_SKIN,
    CLASS_MANAGEMENT,
    CLASS_SECOND_HALF,
    CLASS_SKIN,
    TAG_A,
    TAG_B,
    TYPE_OVERFLOW,
    skin_id,
)
from .layout import Layout

_OTHER = -1  # not a skin frame: other nodes share the bus
_UNCONFIGURED_BOARD = -2
_UNCONFIGURED_TRIANGLE = -3
_UNKNOWN_TAG = -4

_REASONS = 5  # in `Streams.n_refused`: by reason, which is minus the slot; from here on by the address of the board

_TAG_CODE = np.zeros(256, np.uint32)  # payload byte 0 → 0 neither, 1 half A, 2 half B
_TAG_CODE[TAG_A], _TAG_CODE[TAG_B] = 1, 2


@dataclass(slots=True)
class Refused:
    """Frames that carried no half of a configured triangle, by reason."""

    other: int = 0  # other classes, other nodes: ignored
    remote: int = 0
    extended: int = 0
    fd: int = 0
    error: int = 0  # error frames; the bus counts their kinds
    bad_dlc: int = 0  # a skin frame without 8 bytes
    unknown_tag: int = 0  # a skin frame whose first byte is neither 0x40 nor 0xC0
    unconfigured_triangle: int = 0
    unconfigured_board: dict[int, int] = field(default_factory=dict)  # by address
    overflow: dict[int, int] = field(default_factory=dict)  # by address: an MTB3 dropped its queue


class Streams:
    """Assigns every frame its slot: 2 · (triangle's place in the layouts, counted through) + (1 for half B)."""

    def __init__(self, layouts: Sequence[Layout]) -> None:
        self.refused = Refused()
        self._n_refused = np.zeros(_REASONS + 16, np.int64)  # by the kernel, and not yet in `refused`
        self._slot = np.full((2048, 3), _OTHER, np.int16)
        self._slot[CLASS_SKIN << 8 : (CLASS_SKIN + 1) << 8] = _UNCONFIGURED_BOARD
        triangles = [triangle for layout in layouts for triangle in layout.triangles]
        for board in {triangle.board for triangle in triangles}:
            ids = slice(skin_id(board, 0), skin_id(board, 15) + 1)
            self._slot[ids] = _UNCONFIGURED_TRIANGLE
            self._slot[ids, 0] = _UNKNOWN_TAG
        for place, triangle in enumerate(triangles):
            for cls in (CLASS_SKIN, CLASS_LEGACY_SKIN):
                self._slot[skin_id(triangle.board, triangle.triangle, cls), 1:] = 2 * place, 2 * place + 1
            self._slot[skin_id(triangle.board, triangle.triangle, CLASS_SECOND_HALF), 2] = 2 * place + 1

    def slots(self, batch: FrameBatch) -> NDArray[np.int16]:
        """Return the slot of every frame, (n,), negative for frames without a half; `refused` counts the latter."""
        if kernel is not None:
            compiled_slots = np.empty(len(batch), np.int16)
            n_refused = kernel.slots(
                self._slot, _TAG_CODE, batch.can_id, batch.dlc, batch.flags, batch.data, compiled_slots
            )
            if n_refused > 0:
                self._count(batch, compiled_slots)
            if n_refused >= 0:
                return compiled_slots
        odd = batch.dlc != 8
        odd |= batch.flags != 0
        n_odd = int(np.count_nonzero(odd))
        can_id = batch.can_id & 0x7FF if n_odd else batch.can_id
        slots: NDArray[np.int16] = self._slot.take(can_id * np.uint32(3) + _TAG_CODE.take(batch.data[:, 0]))
        if n_odd:
            slots[odd] = _OTHER
            self._count_odd(batch[odd])
        if np.count_nonzero(slots < 0):
            self._count(batch, slots, n_odd)
        return slots

    def sorter(self, assemblies: Sequence[Any]) -> Any:
        """The kernel's: it assigns the slots and feeds the frames to `assemblies`, one a foot."""
        return kernel.sorter(self._slot, _TAG_CODE, self._n_refused, tuple(assemblies))

    def count_refused(self) -> None:
        """Take over what the kernel's sorter has refused."""
        self._add(self._n_refused.tolist())
        self._n_refused[:] = 0

    def _count(self, batch: FrameBatch, slots: NDArray[np.int16], n_odd: int = 0) -> None:
        """Count the frames without a half by reason; `n_odd` of them are counted already."""
        n_by_reason = np.bincount(-slots[slots < 0], minlength=_REASONS)
        n_by_reason[-_OTHER] -= n_odd
        addresses = batch.can_id[slots == _UNCONFIGURED_BOARD] >> np.uint32(4) & 0xF
        self._add([*n_by_reason.tolist(), *np.bincount(addresses, minlength=16).tolist()])

    def _add(self, n_refused: list[int]) -> None:
        """Count frames by reason, and then those of unconfigured boards by address."""
        refused = self.refused
        refused.other += n_refused[-_OTHER]
        refused.unknown_tag += n_refused[-_UNKNOWN_TAG]
        refused.unconfigured_triangle += n_refused[-_UNCONFIGURED_TRIANGLE]
        if n_refused[-_UNCONFIGURED_BOARD]:
            for address, n in enumerate(n_refused[_REASONS:]):
                if n:
                    refused.unconfigured_board[address] = refused.unconfigured_board.get(address, 0) + n

    def _count_odd(self, batch: FrameBatch) -> None:
        """Count the frames that are not standard data frames of 8 bytes, by reason."""
        refused = self.refused
        flags = batch.flags
        refused.error += int((flags & ERROR != 0).sum())
        flags = flags[flags & ERROR == 0]
        refused.fd += int((flags & FD != 0).sum())
        refused.remote += int(((flags & REMOTE != 0) & (flags & FD == 0)).sum())
        refused.extended += int(((flags & EXTENDED != 0) & (flags & (FD | REMOTE) == 0)).sum())
        short = batch.flags == 0
        can_id = batch.can_id[short]
        skin = can_id >> 8 == CLASS_SKIN
        refused.bad_dlc += int(skin.sum())
        overflow = (can_id >> 8 == CLASS_MANAGEMENT) & (can_id & 0xF == TYPE_OVERFLOW) & (batch.dlc[short] == 0)
        for address in (can_id[overflow] >> 4 & 0xF).tolist():
            refused.overflow[address] = refused.overflow.get(address, 0) + 1
        refused.other += int((~skin & ~overflow).sum())
