"""Observation of a bus for some seconds: the properties of every board, configured or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bus.error_frames import count_kinds
from ..bus.frames import ERROR, FrameBatch
from ..config import Board, Publish
from ..skin.cycles import Cycles
from ..skin.faults.watch import Fault, FaultWatch
from ..skin.geometry import PRESSURE_TAXELS
from ..skin.identifiers import (
    CLASS_LEGACY_SKIN,
    CLASS_MANAGEMENT,
    CLASS_SKIN,
    ERROR_NO_ACK,
    ERROR_NOT_CONNECTED,
    TAG_A,
    TAG_B,
)
from ..skin.layout import Layout
from ..skin.reader import SkinReader

_DISORDER_SHARE = 0.02  # of neighbouring halves that an MTB4 with jitter may send out of ascending order
_PADS = (6, 10)
_CLAMPED = (0, 255)


@dataclass(frozen=True, slots=True)
class BoardFacts:
    """The properties of one board, from its frames."""

    address: int
    is_ordered: bool  # halves come in ascending order: an MTB3 whose queue fills sends the newest first
    legacy: bool  # in the class of an MTB3 that was never configured in the new style
    triangles: tuple[int, ...]
    period_ms: float  # between two halves of one kind of one triangle, median
    new_values_hz: float  # of its most active half: how often its values change
    rest_count: float  # median of its pressure taxels
    pads_count: tuple[float, float] | None  # median of thermal pads 6 and 10; None: no triangle is connected
    open_triangles: tuple[int, ...]  # not connected by their own status, most of the time
    no_ack_triangles: tuple[int, ...]
    out_of_range_share: float  # of the taxels flagged out of range although their count is not clamped


class Observation:
    """Collects frames and evaluates them afterwards."""

    def __init__(self, layouts: Sequence[Layout], boards: Mapping[int, Board]) -> None:
        """`boards`: the configured ones, by address."""
        publish = Publish()
        self._reader = SkinReader(layouts, round(1e9 / publish.rate_hz), round(publish.slack_ms * 1e6))
        self._watches = [FaultWatch(layout, boards) for layout in layouts]
        self._batches: list[FrameBatch] = []
        self.cycles: list[list[Cycles]] = [[] for _ in layouts]  # of every layout
        self.error_frames: dict[str, int] = {}

    def feed(self, batch: FrameBatch, now_ns: int) -> None:
        """Add all frames received until `now_ns`, by the clock of the frames."""
        count_kinds(batch, self.error_frames)
        self._batches.append(batch)
        for closed in (self._reader.feed(batch), self._reader.advance(now_ns)):
            for watch, stored, portions in zip(self._watches, self.cycles, closed, strict=True):
                stored += portions
                for cycles in portions:
                    for at in range(len(cycles)):
                        watch.screen(cycles, at)
                        watch.update(cycles, at)

    @property
    def faults(self) -> list[Fault]:
        """The faults that the daemon would report now."""
        return [fault for watch in self._watches for fault in watch.faults]

    def frames(self) -> FrameBatch:
        """Return all frames so far."""
        self._batches = [FrameBatch.concatenate(self._batches)]
        return self._batches[0]

    def boards(self) -> dict[int, BoardFacts]:
        """Return every board that sent halves, by address."""
        frames = self.frames()
        halves = frames[_is_half(frames)]
        address = halves.can_id >> 4 & 0xF
        return {int(board): _board_facts(int(board), halves[address == board]) for board in np.unique(address)}

    def other_senders(self) -> dict[int, int]:
        """Return the number of frames by identifier that are neither halves nor other messages of a board."""
        frames = self.frames()
        is_from_boards = _is_half(frames) | (frames.flags & ERROR != 0)
        is_from_boards |= np.isin(frames.can_id >> 8, (CLASS_LEGACY_SKIN, CLASS_MANAGEMENT)) & (frames.flags == 0)
        identifiers, counts = np.unique(frames.can_id[~is_from_boards], return_counts=True)
        return dict(zip(identifiers.tolist(), counts.tolist(), strict=True))


def _is_half(frames: FrameBatch) -> NDArray[np.bool_]:
    """Return whether each frame is a half of a triangle, (n,)."""
    is_half: NDArray[np.bool_] = np.isin(frames.can_id >> 8, (CLASS_SKIN, CLASS_LEGACY_SKIN))
    is_half &= (frames.flags == 0) & (frames.dlc == 8) & np.isin(frames.data[:, 0], (TAG_A, TAG_B))
    return is_half


def _board_facts(address: int, halves: FrameBatch) -> BoardFacts:
    """Return the properties of one board from its halves."""
    triangle = (halves.can_id & 0xF).astype(np.int64)
    is_b = halves.data[:, 0] == TAG_B
    slot = 2 * triangle + is_b
    spacing_ms, new_values_hz = [], 0.0
    seconds = max(float(halves.t_mono_ns[-1] - halves.t_mono_ns[0]) * 1e-9, 1e-3)
    for index in np.unique(slot):
        of_slot = slot == index
        times_ns, payload = halves.t_mono_ns[of_slot], halves.data[of_slot]
        spacing_ms += (np.diff(times_ns) * 1e-6).tolist()
        new_values_hz = max(new_values_hz, float((payload[1:] != payload[:-1]).any(axis=1).sum()) / seconds)
    counts, status = np.full((16, 12), np.nan), np.zeros((16, 3))
    flagged = taxels = 0
    for index in np.unique(triangle):
        a = halves.data[(triangle == index) & ~is_b][:, 1:8]
        b = halves.data[(triangle == index) & is_b]
        if not len(a) or not len(b):
            continue
        counts[index] = np.median(np.concatenate([a[: len(b)], b[: len(a), 1:6]], axis=1), axis=0)
        words = b[:, 6].astype(np.int64) << 8 | b[:, 7]
        status[index, :2] = [np.mean(words & 0xF == kind) for kind in (ERROR_NO_ACK, ERROR_NOT_CONNECTED)]
        out_of_range = words[:, None] >> np.arange(11, 16) & 1  # of taxels 7 to 11, which b holds
        in_range = ~np.isin(b[:, 1:6], _CLAMPED)
        flagged += int((out_of_range.astype(bool) & in_range).sum())
        taxels += int(in_range.sum())
    is_open = status[:, 1] > 0.5
    connected = counts[~is_open & np.isfinite(counts).all(axis=1)]
    pads = connected[:, _PADS]
    rest = connected[:, PRESSURE_TAXELS]
    return BoardFacts(
        address=address,
        is_ordered=_is_ordered(slot),
        legacy=bool((halves.can_id >> 8 == CLASS_LEGACY_SKIN).any()),
        triangles=tuple(np.unique(triangle).tolist()),
        period_ms=float(np.median(spacing_ms)) if spacing_ms else float("nan"),
        new_values_hz=new_values_hz,
        rest_count=float(np.median(rest)) if len(rest) else float("nan"),
        pads_count=(float(np.median(pads[:, 0])), float(np.median(pads[:, 1]))) if len(pads) else None,
        open_triangles=tuple(np.flatnonzero(is_open).tolist()),
        no_ack_triangles=tuple(np.flatnonzero(status[:, 0] > 0.5).tolist()),
        out_of_range_share=flagged / taxels if taxels else 0.0,
    )  # fmt: skip


def _is_ordered(slot: NDArray[np.int64]) -> bool:
    """Return whether the halves of a board are ascending, A before B; each reading begins with one step down."""
    descents = np.count_nonzero(np.diff(slot) < 0) / max(1, len(slot) - 1)
    return bool(descents <= 1 / len(np.unique(slot)) + _DISORDER_SHARE)
