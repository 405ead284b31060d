"""Boards on one bus from power-up on: time goes forward, frames come out, commands go in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch
from ..skin.identifiers import CLASS_MANAGEMENT
from ..skin.layout import Foot
from .board import Board
from .bus_time import BusTime, Offer
from .commands import CLASS_COMMAND, obey
from .load import Load


@dataclass(frozen=True, slots=True)
class Mounted:
    """A board, and where in its foot's layout its triangles stand (n_triangles,), ascending by triangle."""

    board: Board
    foot: Foot
    rows: NDArray[np.intp]


class Run:
    """One life of the boards on one bus."""

    def __init__(self, mounted: Sequence[Mounted], load: Load, t_start_ns: int) -> None:
        """Power the boards up at `t_start_ns`, which is t = 0 of `load`."""
        self.now_ns = t_start_ns
        self.bus = BusTime(t_start_ns)
        self._t_start_ns = t_start_ns
        self._mounted = mounted
        self._load = load
        self._answers: list[Offer] = []
        for each in mounted:
            each.board.power_up(t_start_ns)

    def advance(self, until_ns: int) -> FrameBatch:
        """The frames that begin before `until_ns` and after those of the last call.

        `t_ns` and `t_mono_ns` are both the moment the frame ended on the bus, on the clock of `t_start_ns`.
        """
        offers = self._answers
        self._answers = []
        for each in self._mounted:
            ticks_ns = each.board.ticks(until_ns)
            can_ids = each.board.can_ids
            if not len(ticks_ns) or not len(can_ids):
                continue
            data = each.board.halves(self._pressure_pa(each, ticks_ns))
            dlc = np.full(len(can_ids), 8, np.uint8)
            offers += [
                Offer(tick, each.board.address, can_ids, dlc, payloads)
                for tick, payloads in zip(ticks_ns.tolist(), data, strict=True)
            ]
        offers.sort(key=lambda offer: offer.ready_ns)
        self.now_ns = until_ns
        return self.bus.carry(offers, until_ns)

    def obey(self, frames: FrameBatch) -> None:
        """Let the boards act, now, on frames that were sent to them; answers come with the next `advance`."""
        # Chosen at once: on a bus that echoes, most of what comes in is the boards' own stream.
        cls = frames.can_id >> np.uint32(8)
        for row in np.flatnonzero((frames.flags == 0) & ((cls == CLASS_COMMAND) | (cls == CLASS_MANAGEMENT))):
            can_id = int(frames.can_id[row])
            payload = frames.data[row, : frames.dlc[row]].tobytes()
            for each in self._mounted:
                pressure_pa = self._pressure_pa(each, np.array([self.now_ns]))[0]
                answer = obey(each.board, can_id, payload, self.now_ns, pressure_pa)
                if answer is not None:
                    self._answers.append(_answer(self.now_ns, each.board.address, *answer))

    def _pressure_pa(self, mounted: Mounted, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n_times, n_triangles, 12) on the board's own triangles."""
        t_s = (t_ns - self._t_start_ns).astype(np.float64) * 1e-9
        return self._load.pressure_pa(mounted.foot, t_s)[:, mounted.rows]


def _answer(t_ns: int, address: int, can_id: int, payload: bytes) -> Offer:
    data = np.zeros((1, 8), np.uint8)
    data[0, : len(payload)] = list(payload)
    return Offer(t_ns, address, np.array([can_id], np.uint32), np.array([len(payload)], np.uint8), data)
