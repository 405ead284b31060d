"""How long a frame occupies a CAN bus, and one bus that carries one frame at a time.

    SOF  identifier  RTR IDE r0  DLC  data      CRC  | delimiter  ACK  end of frame  inter-frame space
    1    11          1   1   1   4    8 · dlc   15   | 1          2    7             3            bits

Left of the bar a complementary bit is stuffed after every five equal ones (ISO 11898-1, 10.5): 111 to 135 bit
times for a frame of 8 bytes. A stuff bit counts as the first bit of the run that follows it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch
from ..skin.identifiers import CLASS_MANAGEMENT, TYPE_OVERFLOW, skin_id
from .reference_insole import reference_insole

BIT_NS = 1000  # 1 Mbit/s
STACK_FRAMES = 20  # an MTB3's (can_interface.h 15)

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
    address: int  # whose queue it is, even if another board bears this address too
    can_id: NDArray[np.uint32]  # (n,)
    dlc: NDArray[np.uint8]  # (n,)
    data: NDArray[np.uint8]  # (n, 8)


class BusTime:
    """One bus: when it is free, the lowest identifier at the head of a board's queue goes next.

    A frame that has begun is not interrupted. What does not fit into a board's queue is lost and counted.

    The queue of an MTB3 is a stack behind one register of its CAN controller: whatever was put there last goes
    into the register as soon as that is empty, and stays until it is sent. When the stack is full, all of it is
    thrown away with the frame that did not fit, and an empty frame says so. Source: robotology/icub-firmware,
    mtb3/can_interface.c 171–226.
    """

    def __init__(self, t_ns: int, stacks: Collection[int] = ()) -> None:
        """A bus that is idle at `t_ns`; the boards `stacks` are MTB3s."""
        self.lost: dict[int, int] = {}  # frames, by address
        self._stacks = frozenset(stacks)
        self._queue_frames = round(reference_insole().mtb4_queue_frames)
        self._free_ns = t_ns
        self._sending: int | None = None  # whose frame is on the bus until it is free
        self._waiting: list[Offer] = []  # what earlier calls left, one a board, in the order it will be sent

    def carry(self, offers: Sequence[Offer], until_ns: int) -> FrameBatch:
        """The frames that begin before `until_ns`, each stamped with its end; the others wait.

        `offers` stand in the order of their time, later than those of earlier calls, before `until_ns`.
        """
        waiting = self._waiting
        self._waiting = []
        if not offers and not waiting:
            return FrameBatch.empty()
        # An empty frame for every stack at hand: its row is used whenever the stack overflows.
        overflows = [_overflow(address) for address in sorted(self._stacks)]
        everything = [*overflows, *waiting, *offers]
        can_id = np.concatenate([offer.can_id for offer in everything])
        dlc = np.concatenate([offer.dlc for offer in everything])
        data = np.concatenate([offer.data for offer in everything])
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
                if gone:
                    self._sending = address
                queues[address] = queues[address][gone:]
                if not len(queues[address]):
                    del queues[address]

        def put(offer: Offer, offered: NDArray[np.intp]) -> None:
            queue = queues.get(offer.address, offered[:0])
            if offer.address in self._stacks:
                on_bus = self._sending == offer.address and self._free_ns > offer.ready_ns
                overflow = np.array([sorted(self._stacks).index(offer.address)])
                queue, lost = _stacked(queue, offered, on_bus, overflow)
            else:
                queue = np.concatenate([queue, offered])
                lost = max(len(queue) - self._queue_frames, 0)
                queue = queue[: self._queue_frames]
            if lost:
                self.lost[offer.address] = self.lost.get(offer.address, 0) + lost
            if len(queue):
                queues[offer.address] = queue

        start = len(overflows)
        for offer in waiting:
            queues[offer.address] = np.arange(start, start + len(offer.can_id))
            start += len(offer.can_id)
        for offer in offers:
            serve(offer.ready_ns)
            if not queues:
                self._free_ns = max(self._free_ns, offer.ready_ns)
            put(offer, np.arange(start, start + len(offer.can_id)))
            start += len(offer.can_id)
        serve(until_ns)
        self._waiting = [
            Offer(self._free_ns, address, can_id[queue], dlc[queue], data[queue]) for address, queue in queues.items()
        ]
        if not rows:
            return FrameBatch.empty()
        sent, t_ns = np.concatenate(rows), np.concatenate(ends_ns)
        nothing = np.zeros(len(sent), np.uint8)
        return FrameBatch(t_ns, t_ns, nothing, can_id[sent], dlc[sent], data[sent], nothing)


def _stacked(
    queue: NDArray[np.intp], offered: NDArray[np.intp], on_bus: bool, overflow: NDArray[np.intp]
) -> tuple[NDArray[np.intp], int]:
    """The queue of an MTB3, in the order it will be sent, after `offered` was put on it; how many were lost.

    `on_bus`: a frame of its own is, so the register is not free to hold the next; `overflow` (1,): the row of its
    empty frame.
    """
    lost = 0
    for row in offered:
        register = 0 if on_bus else 1  # places at the head of `queue`
        if len(queue) - register >= STACK_FRAMES:
            lost += len(queue) - register + 1
            queue = np.concatenate([queue[:register], overflow])
        else:
            queue = np.concatenate([queue[:register], [row], queue[register:]])
    return queue, lost


def _overflow(address: int) -> Offer:
    empty_id = skin_id(address, TYPE_OVERFLOW, CLASS_MANAGEMENT)
    return Offer(0, address, np.array([empty_id], np.uint32), np.zeros(1, np.uint8), np.zeros((1, 8), np.uint8))
