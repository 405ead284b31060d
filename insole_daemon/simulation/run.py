"""Boards on one bus from power-up on: time goes forward, frames come out, commands go in."""

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
class Mounted:
    """A board, and where in its foot's layout its triangles stand (n_triangles,), ascending by triangle."""

    board: EmulatedBoard
    foot: Foot
    rows: NDArray[np.intp]


class BoardRun:
    """One life of the boards on one bus."""

    def __init__(self, mounted: Sequence[Mounted], load: Load, t_start_ns: int) -> None:
        """Power the boards up at `t_start_ns`, which is t = 0 of `load`."""
        self.now_ns = t_start_ns
        self.bus = BusTime(t_start_ns, [each.board.node for each in mounted if each.board.generation.stacks])
        self._t_start_ns = t_start_ns
        self._mounted = mounted
        self._load = load
        self._later: list[Offer] = []  # answers, and what a slow board has not brought forth yet
        for each in mounted:
            each.board.power_up(t_start_ns)

    def advance(self, until_ns: int) -> FrameBatch:
        """The frames that begin before `until_ns` and after those of the last call.

        `t_ns` and `t_mono_ns` are both the moment the frame ended on the bus, on the clock of `t_start_ns`.
        """
        offers = self._later
        for each in self._mounted:
            board = each.board
            while board.next_event_ns is not None and board.next_event_ns < until_ns:
                event_ns = board.next_event_ns
                offers += self._offers(each, event_ns)
                board.happen(self._pressure_pa(each, self._seconds(np.array([event_ns])))[0])
            offers += self._offers(each, until_ns)
        offers.sort(key=lambda offer: offer.ready_ns)
        self._later = [offer for offer in offers if offer.ready_ns >= until_ns]
        self.now_ns = until_ns
        return self.bus.carry(offers[: len(offers) - len(self._later)], until_ns)

    def obey(self, frames: FrameBatch) -> bool:
        """Let the boards act, now, on frames that were sent to them; whether there were any.

        Answers come with the next `advance`.
        """
        # Chosen at once: on a bus that echoes, most of what comes in is the boards' own stream.
        cls = frames.can_id >> np.uint32(8)
        rows = np.flatnonzero((frames.flags == 0) & ((cls == CLASS_COMMAND) | (cls == CLASS_MANAGEMENT)))
        for row in rows:
            can_id = int(frames.can_id[row])
            payload = frames.data[row, : frames.dlc[row]].tobytes()
            for each in self._mounted:
                if each.board.deaf:
                    continue
                pressure_pa = self._pressure_pa(each, self._seconds(np.array([self.now_ns])))[0]
                answer = obey(each.board, can_id, payload, self.now_ns, pressure_pa)
                if answer is not None:
                    self._later.append(_single(self.now_ns, each.board.node, *answer))
        return len(rows) > 0

    def _offers(self, mounted: Mounted, until_ns: int) -> list[Offer]:
        """What a board brings forth before `until_ns`, or begins to; it does not change by itself before."""
        board = mounted.board
        ticks_ns = board.ticks(until_ns)
        readings_ns = board.thermometer.ticks(until_ns)
        offers = [_single(at, board.node, *board.temperature_frame(at)) for at in readings_ns.tolist()]
        if len(ticks_ns):
            ticks_ns, data = board.speak(ticks_ns, self._sampled_pa(mounted, ticks_ns))
            if len(board.can_ids):
                offers += _stream(board, ticks_ns, data)
        return [] if board.deaf else offers

    def _sampled_pa(self, mounted: Mounted, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n_times, n_triangles, 12) when the board's sensors took what is read at `t_ns` (n_times,)."""
        t_s = self._seconds(t_ns)
        sampled_s = mounted.board.sensors.sampled_s(t_s)
        if sampled_s is None:
            return self._pressure_pa(mounted, t_s)
        moments_s, which = np.unique(sampled_s, return_inverse=True)
        which = which.reshape(sampled_s.shape)
        return self._pressure_pa(mounted, moments_s)[which, np.arange(sampled_s.shape[1])]

    def _pressure_pa(self, mounted: Mounted, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n_times, n_triangles, 12) on the board's own triangles."""
        return self._load.pressure_pa(mounted.foot, t_s)[:, mounted.rows]

    def _seconds(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        return (t_ns - self._t_start_ns).astype(np.float64) * 1e-9


def _stream(board: EmulatedBoard, ticks_ns: NDArray[np.int64], data: NDArray[np.uint8]) -> list[Offer]:
    """An MTB4 offers all halves of a tick at once, an MTB3 one after another as it works them out."""
    can_ids = board.can_ids
    dlc = np.full(len(can_ids), 8, np.uint8)
    if not board.generation.stacks:
        return [
            Offer(tick, board.node, can_ids, dlc, payloads)
            for tick, payloads in zip(ticks_ns.tolist(), data, strict=True)
        ]
    half_ns = round(reference_insole().mtb3_half_us * 1000)
    return [
        Offer(tick + at * half_ns, board.node, can_ids[at : at + 1], dlc[at : at + 1], payloads[at : at + 1])
        for tick, payloads in zip(ticks_ns.tolist(), data, strict=True)
        for at in range(len(can_ids))
    ]


def _single(t_ns: int, node: int, can_id: int, payload: bytes) -> Offer:
    data = np.zeros((1, 8), np.uint8)
    data[0, : len(payload)] = list(payload)
    return Offer(t_ns, node, np.array([can_id], np.uint32), np.array([len(payload)], np.uint8), data)
