"""How long a frame occupies a CAN bus, and one bus that carries one frame at a time.

    SOF  identifier  RTR IDE r0  DLC  data      CRC  | delimiter  ACK  end of frame  inter-frame space
    1    11          1   1   1   4    8 · dlc   15   | 1          2    7             3            bits

Left of the bar a complementary bit is stuffed after every five equal ones (ISO 11898-1, 10.5): 111 to 135 bit
times for a frame of 8 bytes. A stuff bit counts as the first bit of the run that follows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch

BIT_NS = 1000  # 1 Mbit/s
QUEUE_FRAMES = 64  # a board's transmit queue; the firmware's real depth is not known

_CRC_POLYNOMIAL = 0x4599
_UNSTUFFED_BITS = 47  # everything but the data: 19 + 15 left of the bar, 13 right of it


def _stuffing(width: int) -> NDArray[np.uint8]:
    """(8, 2**width): what `width` bits do to the run before them, as stuff bits << 3 | run after.

    A run is (value of its bit) << 2 | (length 1..4) − 1; a fifth equal bit ends it with a stuff bit.
    """
    table = np.empty((8, 1 << width), np.uint8)
    for run in range(8):
        for bits in range(1 << width):
            value, length, stuffed = run >> 2, (run & 3) + 1, 0
            for position in reversed(range(width)):
                bit = bits >> position & 1
                length = length + 1 if bit == value else 1
                value = bit
                if length == 5:
                    value, length, stuffed = 1 - bit, 1, stuffed + 1
            table[run, bits] = stuffed << 3 | value << 2 | length - 1
    return table


def _crc_of_byte(byte: int) -> int:
    crc = byte << 7
    for _ in range(8):
        crc = crc << 1 ^ (_CRC_POLYNOMIAL if crc & 0x4000 else 0)
    return crc & 0x7FFF


_STUFFING = {width: _stuffing(width) for width in (2, 7, 8)}
_CRC = np.array([_crc_of_byte(byte) for byte in range(256)], np.uint16)


def frame_bits(can_id: NDArray[np.uint32], dlc: NDArray[np.uint8], data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(n,) bit times of n standard data frames, exact stuffing and inter-frame space included."""
    run = np.zeros(len(can_id), np.uint8)  # after the start of frame, one dominant bit
    crc = np.zeros(len(can_id), np.uint16)
    stuffed = np.zeros(len(can_id), np.int64)
    # Identifier, RTR, IDE and r0 (all 0), DLC: 18 bits; zeros before them do not change the CRC.
    header = can_id << np.uint32(7) | dlc
    for shift in (16, 8, 0):
        crc = _crc_step(crc, (header >> np.uint32(shift) & 0xFF).astype(np.uint16))
    for width, shift in ((8, 10), (8, 2), (2, 0)):
        run = _stuff_step(run, header >> np.uint32(shift) & (1 << width) - 1, width, stuffed)
    shortest = int(dlc.min(initial=8))
    for place in range(int(dlc.max(initial=0))):
        byte = data[:, place]
        if place < shortest:
            crc = _crc_step(crc, byte)
            run = _stuff_step(run, byte, 8, stuffed)
        else:
            there = dlc > place
            added = np.zeros_like(stuffed)
            crc = np.where(there, _crc_step(crc, byte), crc)
            run = np.where(there, _stuff_step(run, byte, 8, added), run)
            stuffed += added * there
    run = _stuff_step(run, crc >> np.uint16(7), 8, stuffed)
    _stuff_step(run, crc & np.uint16(0x7F), 7, stuffed)
    return stuffed + _UNSTUFFED_BITS + 8 * dlc.astype(np.int64)


def _crc_step(crc: NDArray[np.uint16], byte: NDArray[np.integer]) -> NDArray[np.uint16]:
    after: NDArray[np.uint16] = (
        crc << np.uint16(8) ^ _CRC[(crc >> np.uint16(7) ^ byte) & np.uint16(0xFF)]
    ) & np.uint16(0x7FFF)
    return after


def _stuff_step(
    run: NDArray[np.uint8], bits: NDArray[np.integer], width: int, stuffed: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """The run after `bits`; their stuff bits are added to `stuffed`."""
    step: NDArray[np.uint8] = _STUFFING[width][run, bits]
    stuffed += step >> 3
    return step & np.uint8(7)


@dataclass(frozen=True, slots=True)
class Offer:
    """Frames a board puts into its transmit queue at one moment, in this order."""

    ready_ns: int
    address: int
    can_id: NDArray[np.uint32]  # (n,)
    dlc: NDArray[np.uint8]  # (n,)
    data: NDArray[np.uint8]  # (n, 8)


class BusTime:
    """One bus: when it is free, the lowest identifier at the head of a board's queue goes next.

    A frame that has begun is not interrupted. What does not fit into a board's queue is lost and counted.
    """

    def __init__(self, t_ns: int) -> None:
        """A bus that is idle at `t_ns`."""
        self.lost: dict[int, int] = {}  # frames, by address
        self._free_ns = t_ns
        self._waiting: list[Offer] = []  # what earlier calls left, one a board

    def carry(self, offers: Sequence[Offer], until_ns: int) -> FrameBatch:
        """The frames that begin before `until_ns`, each stamped with its end; the others wait.

        `offers` stand in the order of their time, later than those of earlier calls, before `until_ns`.
        """
        offers = [*self._waiting, *offers]
        self._waiting = []
        if not offers:
            return FrameBatch.empty()
        can_id = np.concatenate([offer.can_id for offer in offers])
        dlc = np.concatenate([offer.dlc for offer in offers])
        data = np.concatenate([offer.data for offer in offers])
        duration_ns = frame_bits(can_id, dlc, data) * BIT_NS
        queues: dict[int, NDArray[np.intp]] = {}
        rows: list[NDArray[np.intp]] = []
        ends_ns: list[NDArray[np.int64]] = []

        def serve(before_ns: int) -> None:
            if not queues or self._free_ns >= before_ns:
                return
            order = sorted(queues, key=lambda address: can_id[queues[address][0]])
            pending = np.concatenate([queues[address] for address in order])
            end_ns = self._free_ns + np.cumsum(duration_ns[pending])
            left = begun = int(np.searchsorted(end_ns - duration_ns[pending], before_ns))
            rows.append(pending[:begun])
            ends_ns.append(end_ns[:begun])
            self._free_ns = int(end_ns[begun - 1])
            for address in order:
                gone = min(left, len(queues[address]))
                left -= gone
                queues[address] = queues[address][gone:]
                if not len(queues[address]):
                    del queues[address]

        start = 0
        for offer in offers:
            serve(offer.ready_ns)
            if not queues:
                self._free_ns = max(self._free_ns, offer.ready_ns)
            offered = np.arange(start, start + len(offer.can_id))
            start += len(offer.can_id)
            queue = np.concatenate([queues.get(offer.address, offered[:0]), offered])
            if len(queue) > QUEUE_FRAMES:
                self.lost[offer.address] = self.lost.get(offer.address, 0) + len(queue) - QUEUE_FRAMES
            if len(queue):
                queues[offer.address] = queue[:QUEUE_FRAMES]
        serve(until_ns)
        self._waiting = [
            Offer(self._free_ns, address, can_id[queue], dlc[queue], data[queue]) for address, queue in queues.items()
        ]
        if not rows:
            return FrameBatch.empty()
        sent, t_ns = np.concatenate(rows), np.concatenate(ends_ns)
        nothing = np.zeros(len(sent), np.uint8)
        return FrameBatch(t_ns, t_ns, nothing, can_id[sent], dlc[sent], data[sent], nothing)
