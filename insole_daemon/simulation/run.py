"""Run boards on one bus from power-up: time advances, frames come out, commands go in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch
from ..skin.identifiers import CLASS_MANAGEMENT
from ..skin.layout import Foot
from .board import EmulatedBoard
from .bus_time import BusTime, Offer
from .commands import CLASS_COMMAND, obey
from .load import Load
from .reference_insole import reference_insole


@dataclass(frozen=True, slots=True)
class MountedBoard:
    """A board, and the rows of its triangles in its foot's layout (n_triangles,), ascending by triangle."""

    board: EmulatedBoard
    foot: Foot
    rows: NDArray[np.intp]


class BoardRun:
    """One run of the boards on one bus, from power-up."""

    def __init__(self, mounted: Sequence[MountedBoard], load: Load, t_start_ns: int) -> None:
        """Power the boards up at `t_start_ns`, which is t = 0 of `load`."""
        self.now_ns = t_start_ns
        self.bus = BusTime(
            t_start_ns, [mounted_board.board.node for mounted_board in mounted if mounted_board.board.generation.stacks]
        )
        self._t_start_ns = t_start_ns
        self._mounted = mounted
        self._load = load
        self._pending: list[Offer] = []  # answers, and halves that a slow board has not computed yet
        for mounted_board in mounted:
            mounted_board.board.power_up(t_start_ns)

    def advance(self, until_ns: int) -> FrameBatch:
        """Return the frames that begin before `until_ns` and after those of the last call.

        `t_ns` and `t_mono_ns` are both the time at which the frame ended on the bus, on the clock of `t_start_ns`.
        """
        offers = self._pending
        for mounted_board in self._mounted:
            board = mounted_board.board
            while board.next_event_ns is not None and board.next_event_ns < until_ns:
                event_ns = board.next_event_ns
                offers += self._collect_offers(mounted_board, event_ns)
                board.apply_next_event(self._pressure_pa(mounted_board, self._seconds(np.array([event_ns])))[0])
            offers += self._collect_offers(mounted_board, until_ns)
        offers.sort(key=lambda offer: offer.ready_ns)
        self._pending = [offer for offer in offers if offer.ready_ns >= until_ns]
        self.now_ns = until_ns
        return self.bus.carry(offers[: len(offers) - len(self._pending)], until_ns)

    def obey(self, frames: FrameBatch) -> bool:
        """Let the boards act, now, on frames that were sent to them; return whether there were commands.

        Answers come with the next `advance`.
        """
        # Selected with array operations: on a bus that echoes, most received frames are the boards' own stream.
        cls = frames.can_id >> np.uint32(8)
        rows = np.flatnonzero((frames.flags == 0) & ((cls == CLASS_COMMAND) | (cls == CLASS_MANAGEMENT)))
        for row in rows:
            can_id = int(frames.can_id[row])
            payload = frames.data[row, : frames.dlc[row]].tobytes()
            for mounted_board in self._mounted:
                if mounted_board.board.is_disconnected:
                    continue
                pressure_pa = self._pressure_pa(mounted_board, self._seconds(np.array([self.now_ns])))[0]
                answer = obey(mounted_board.board, can_id, payload, self.now_ns, pressure_pa)
                if answer is not None:
                    self._pending.append(_single_offer(self.now_ns, mounted_board.board.node, *answer))
        return len(rows) > 0

    def _collect_offers(self, mounted: MountedBoard, until_ns: int) -> list[Offer]:
        """Return what a board sends, or begins to send, before `until_ns`; it must have no event before then."""
        board = mounted.board
        ticks_ns = board.ticks(until_ns)
        readings_ns = board.thermometer.ticks(until_ns)
        offers = [
            _single_offer(reading_ns, board.node, *board.temperature_frame(reading_ns))
            for reading_ns in readings_ns.tolist()
        ]
        if len(ticks_ns):
            ticks_ns, data = board.send_ticks(ticks_ns, self._pressure_when_sampled_pa(mounted, ticks_ns))
            if len(board.can_ids):
                offers += _stream_offers(board, ticks_ns, data)
        return [] if board.is_disconnected else offers

    def _pressure_when_sampled_pa(self, mounted: MountedBoard, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (n_times, n_triangles, 12) the pressures when the board sampled its readings at `t_ns` (n_times,)."""
        t_s = self._seconds(t_ns)
        sample_times_s = mounted.board.sensors.sample_times_s(t_s)
        if sample_times_s is None:
            return self._pressure_pa(mounted, t_s)
        times_s, index = np.unique(sample_times_s, return_inverse=True)
        index = index.reshape(sample_times_s.shape)
        return self._pressure_pa(mounted, times_s)[index, np.arange(sample_times_s.shape[1])]

    def _pressure_pa(self, mounted: MountedBoard, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times, n_triangles, 12) the pressures on the board's triangles."""
        return self._load.pressure_pa(mounted.foot, t_s)[:, mounted.rows]

    def _seconds(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        return (t_ns - self._t_start_ns).astype(np.float64) * 1e-9


def _stream_offers(board: EmulatedBoard, ticks_ns: NDArray[np.int64], data: NDArray[np.uint8]) -> list[Offer]:
    """Return the offers of ticks: an MTB4 offers all halves of a tick at once, an MTB3 one after another."""
    can_ids = board.can_ids
    dlc = np.full(len(can_ids), 8, np.uint8)
    if not board.generation.stacks:
        return [
            Offer(tick, board.node, can_ids, dlc, payloads)
            for tick, payloads in zip(ticks_ns.tolist(), data, strict=True)
        ]
    half_ns = round(reference_insole().mtb3_half_us * 1000)
    return [
        Offer(
            tick + half * half_ns, board.node, can_ids[half : half + 1], dlc[half : half + 1], payloads[half : half + 1]
        )
        for tick, payloads in zip(ticks_ns.tolist(), data, strict=True)
        for half in range(len(can_ids))
    ]


def _single_offer(t_ns: int, node: int, can_id: int, payload: bytes) -> Offer:
    data = np.zeros((1, 8), np.uint8)
    data[0, : len(payload)] = list(payload)
    return Offer(t_ns, node, np.array([can_id], np.uint32), np.array([len(payload)], np.uint8), data)
