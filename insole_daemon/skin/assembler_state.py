"""The state of an assembler between frames: arrays that numpy code and the compiled kernel read and write alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NEVER = -(1 << 62)  # receive time of a half that has never arrived
N_SCALARS = 10


class StoredInt:
    """An integer at a place of `AssemblerState.scalars`."""

    def __init__(self, place: int) -> None:
        self._place = place

    def __get__(self, state: AssemblerState, _: type) -> int:
        return int(state.scalars[self._place])

    def __set__(self, state: AssemblerState, value: int) -> None:
        state.scalars[self._place] = value


class StoredTime:
    """A time in ns at a place of `AssemblerState.scalars`, or None."""

    def __init__(self, place: int) -> None:
        self._place = place

    def __get__(self, state: AssemblerState, _: type) -> int | None:
        time_ns = int(state.scalars[self._place])
        return None if time_ns == NEVER else time_ns

    def __set__(self, state: AssemblerState, time_ns: int | None) -> None:
        state.scalars[self._place] = NEVER if time_ns is None else time_ns


class AssemblerState:
    """What is known of the halves of one foot, with an element for each of its n_slots = 2 · n_triangles slots.

    The places of the numbers in `scalars`, and the order of `kernel_arrays`, are those of `kernel.c`.
    """

    _due_ns = StoredTime(0)  # when the open cycle is closed by time; None before the first frame
    _outstanding = StoredInt(1)  # halves expected and not seen
    _waiting = StoredInt(2)  # whether any half is expected in the open cycle
    _newest_t_ns = StoredInt(3)
    _fresh = StoredInt(4)  # whether some half was seen since the last close
    superseded = StoredInt(5)  # halves overwritten by a second arrival within a cycle
    _complete_ns = StoredTime(6)  # when the last cycle closed, if it was complete
    _interval_ns = StoredTime(7)  # running mean between complete cycles, while they follow each other
    _promised_ns = StoredTime(8)  # when the open cycle completes if the boards stay periodic
    skipped = StoredInt(9)  # repeats left out of a long silence

    def __init__(self, boards: NDArray[np.uint8]) -> None:
        """Set the state before the first frame; `boards` (n_triangles,): address of the board of each triangle."""
        n_slots = 2 * len(boards)
        self.arrivals = np.zeros(n_slots, np.int64)  # of every half since the start
        self.changes = np.zeros(n_slots, np.int64)  # arrivals whose bytes differed from the ones before
        self.missed = np.zeros(n_slots, np.int64)  # cycles that closed late without this expected half
        self._bytes = np.zeros(n_slots, np.uint64)  # newest payload of every half
        self._t_ns = np.zeros(n_slots, np.int64)
        self._t_mono_ns = np.full(n_slots, NEVER)
        self._seen = np.zeros(n_slots, np.bool_)  # since the last close
        addresses, of_triangles = np.unique(boards, return_inverse=True)
        self._board = np.repeat(of_triangles, 2).astype(np.int64)  # of every slot
        self._newest_slot = np.full(len(addresses), -1, np.int16)  # which half of each board came last
        self._expected = np.ones(n_slots, np.bool_)
        self._misses = np.zeros(n_slots, np.int64)  # late closings missed since the half last came in time
        self._returning = np.zeros(n_slots, np.bool_)  # came in time while not expected
        self.scalars = np.zeros(N_SCALARS, np.int64)
        self._due_ns = self._complete_ns = self._interval_ns = self._promised_ns = None
        self._outstanding = n_slots
        self._waiting = True

    @property
    def kernel_arrays(self) -> tuple[NDArray[np.generic], ...]:
        """The arrays in the order of the kernel; it keeps them and changes them in place."""
        return (
            self._seen, self._expected, self._returning, self._misses, self.missed, self.arrivals, self.changes,
            self._bytes, self._t_ns, self._t_mono_ns, self._newest_slot, self._board, self.scalars,
        )  # fmt: skip
