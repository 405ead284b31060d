"""Closed cycles: one complete set of halves of a foot, with the age of everything in it.

`Cycles` has n of them as arrays. `ClosedCycle` is one on its way to be published, as the kernel or numpy made it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_RECORD_HEAD_BYTES, _RECORD_TRIANGLE_BYTES = 18, 39  # of a closed cycle: its own, and those of each triangle


@dataclass(frozen=True, slots=True)
class Cycles:
    """n closed cycles of one foot, in order; triangles in the layout's order."""

    t_mono_ns: NDArray[np.int64]  # (n,) when the cycle closed, monotonic clock
    t_ns: NDArray[np.int64]  # (n,) kernel receive time of the newest half, CLOCK_REALTIME
    counts: NDArray[np.uint8]  # (n, n_triangles, 12); 0 where never received
    status: NDArray[np.uint16]  # (n, n_triangles) the status word of half B
    triangle_t_ns: NDArray[np.int64]  # (n, n_triangles) kernel receive time of the older half; 0: never received
    age_ns: NDArray[np.int64]  # (n, n_triangles) age of the older half when the cycle closed; -1: never received
    arrivals: NDArray[np.int64]  # (n, n_triangles) halves received since the start, repeated ones too
    missing: NDArray[np.bool_]  # (n, n_triangles) a half was expected and did not come
    late: NDArray[np.bool_]  # (n,) closed by time, with halves missing
    repeated: NDArray[np.bool_]  # (n,) nothing has arrived since the cycle before

    def __len__(self) -> int:
        return len(self.t_ns)

    def __getitem__(self, rows: slice) -> Cycles:
        """The cycles `rows` selects."""
        return Cycles(*(getattr(self, name)[rows] for name in Cycles.__slots__))

    @classmethod
    def of_records(cls, records: list[bytes]) -> Cycles:
        """Return the cycles of one foot that the kernel made, at least one; the arrays are read-only."""
        n_triangles = (len(records[0]) - _RECORD_HEAD_BYTES) // _RECORD_TRIANGLE_BYTES
        table = np.frombuffer(b"".join(records), _record_dtype(n_triangles))
        return cls(*(table[name] for name in cls.__slots__))

    @classmethod
    def concatenate(cls, pieces: list[Cycles], n_triangles: int) -> Cycles:
        """Return the pieces one after another; `n_triangles` shapes the result if there are none."""
        if len(pieces) == 1:
            return pieces[0]
        if not pieces:
            none = np.empty(0, np.int64)
            wide = np.empty((0, n_triangles), np.int64)
            flag = np.empty(0, np.bool_)
            return cls(
                none, none, np.empty((0, n_triangles, 12), np.uint8), wide.astype(np.uint16), wide, wide, wide,
                wide.astype(np.bool_), flag, flag,
            )  # fmt: skip
        return cls(*(np.concatenate([getattr(piece, name) for piece in pieces]) for name in cls.__slots__))


@cache
def _record_dtype(n_triangles: int) -> np.dtype[np.void]:
    """Of a closed cycle as the kernel makes it, padded to whole words."""
    fields: dict[str, tuple[str, tuple[int, ...]]] = {
        "t_mono_ns": ("<i8", ()),
        "t_ns": ("<i8", ()),
        "triangle_t_ns": ("<i8", (n_triangles,)),
        "age_ns": ("<i8", (n_triangles,)),
        "arrivals": ("<i8", (n_triangles,)),
        "status": ("<u2", (n_triangles,)),
        "counts": ("u1", (n_triangles, 12)),
        "missing": ("?", (n_triangles,)),
        "late": ("?", ()),
        "repeated": ("?", ()),
    }
    packed = np.dtype([(name, kind, shape) for name, (kind, shape) in fields.items()])
    offsets = [packed.fields[name][1] for name in fields] if packed.fields is not None else []
    return np.dtype({
        "names": list(fields),
        "formats": list(fields.values()),
        "offsets": offsets,
        "itemsize": -(-packed.itemsize // 8) * 8,
    })  # fmt: skip


def counts_of_record(cycle: ClosedCycle) -> memoryview:
    """Return the counts of a cycle that has a record, (12 · n_triangles,) bytes."""
    assert cycle.record is not None
    n_triangles = (len(cycle.record) - _RECORD_HEAD_BYTES) // _RECORD_TRIANGLE_BYTES
    begin = 16 + (3 * 8 + 2) * n_triangles
    return memoryview(cycle.record)[begin : begin + 12 * n_triangles]


class ClosedCycle(NamedTuple):
    """One closed cycle of a foot, on its way to be published.

    Its arrays are made only for whoever asks for `cycles`: on the live path that is the fault watch, later.
    """

    t_mono_ns: int  # when it closed, monotonic clock
    t_ns: int  # kernel receive time of the newest half, CLOCK_REALTIME
    is_late: bool
    is_repeated: bool
    record: bytes | None  # as the kernel made it; None: numpy did
    source: tuple[Cycles, int] | None = None  # what numpy made, and the cycle's place in it

    @classmethod
    def of(cls, cycles: Cycles, at: int) -> ClosedCycle:
        """Return cycle `at` of `cycles`."""
        late, repeated = bool(cycles.late[at]), bool(cycles.repeated[at])
        return cls(int(cycles.t_mono_ns[at]), int(cycles.t_ns[at]), late, repeated, None, (cycles, at))

    @property
    def row(self) -> tuple[Cycles, int]:
        """Arrays with the cycle in them, and its place there."""
        if self.record is not None:
            return Cycles.of_records([self.record]), 0
        assert self.source is not None
        return self.source

    @property
    def cycles(self) -> Cycles:
        """The cycle as arrays, n = 1."""
        cycles, at = self.row
        return cycles if len(cycles) == 1 else cycles[at : at + 1]


def rows_of(closed: Sequence[ClosedCycle]) -> list[tuple[Cycles, int]]:
    """Return arrays with each cycle of one foot in them, and its place there; all records share theirs."""
    records = [cycle.record for cycle in closed if cycle.record is not None]
    if not records or len(records) < len(closed):
        return [cycle.row for cycle in closed]
    cycles = Cycles.of_records(records)
    return [(cycles, at) for at in range(len(records))]
