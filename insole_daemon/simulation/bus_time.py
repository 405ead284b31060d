"""Bit times of CAN frames, and one bus that carries one frame at a time.

    SOF  identifier  RTR IDE r0  DLC  data      CRC  | delimiter  ACK  end of frame  inter-frame space
    1    11          1   1   1   4    8 · dlc   15   | 1          2    7             3            bits

Left of the bar a complementary bit is stuffed after every five equal ones (ISO 11898-1, 10.5): a frame of 8 bytes takes
111 to 135 bit times. A stuff bit counts as the first bit of the following run.
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
STACK_FRAMES = 20  # transmit stack of an MTB3 (can_interface.h 15)

_CRC_POLYNOMIAL = 0x4599
_UNSTUFFED_BITS = 47  # all but the data: 19 + 15 left of the bar, 13 right of it


def _stuffing_table(width: int) -> NDArray[np.uint8]:
    """Return (8, 2**width) the effect of `width` bits on the run before them: stuff bits << 3 | run after.

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


_STUFFING = {width: _stuffing_table(width) for width in (2, 7, 8)}
_CRC = np.array([_crc_of_byte(byte) for byte in range(256)], np.uint16)


def frame_bits(can_id: NDArray[np.uint32], dlc: NDArray[np.uint8], data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return (n,) bit times of n standard data frames, with exact stuffing and inter-frame space."""
    run = np.zeros(len(can_id), np.uint8)  # state after the start of frame, one dominant bit
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
            has_byte = dlc > place
            added = np.zeros_like(stuffed)
            crc = np.where(has_byte, _crc_step(crc, byte), crc)
            run = np.where(has_byte, _stuff_step(run, byte, 8, added), run)
            stuffed += added * has_byte
    run = _stuff_step(run, crc >> np.uint16(7), 8, stuffed)
    _stuff_step(run, crc & np.uint16(0x7F), 7, stuffed)
    return stuffed + _UNSTUFFED_BITS + 8 * dlc.astype(np.int64)


def _crc_step(crc: NDArray[np.uint16], byte: NDArray[np.integer]) -> NDArray[np.uint16]:
    updated: NDArray[np.uint16] = (
        crc << np.uint16(8) ^ _CRC[(crc >> np.uint16(7) ^ byte) & np.uint16(0xFF)]
    ) & np.uint16(0x7FFF)
    return updated


def _stuff_step(
    run: NDArray[np.uint8], bits: NDArray[np.integer], width: int, stuffed: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """Return the run after `bits`, and add their stuff bits to `stuffed`."""
    step: NDArray[np.uint8] = _STUFFING[width][run, bits]
    stuffed += step >> 3
    return step & np.uint8(7)


@dataclass(frozen=True, slots=True)
class Offer:
    """Frames that a board puts into its transmit queue at one time, in this order."""

    ready_ns: int
    address: int  # identifies the queue, even if another board uses this address too
    can_id: NDArray[np.uint32]  # (n,)
    dlc: NDArray[np.uint8]  # (n,)
    data: NDArray[np.uint8]  # (n, 8)


class BusTime:
    """One bus: when it is free, the lowest identifier at the head of a board's queue is sent next.

    A frame that has begun is not interrupted. Frames that do not fit into a board's queue are lost and counted.

    The queue of an MTB3 is a stack behind one register of its CAN controller: the last frame put on it moves to the
    register as soon as that is empty, and stays there until it is sent. A full stack is discarded with the frame that
    did not fit, and an empty frame reports this. Source: robotology/icub-firmware, mtb3/can_interface.c 171–226.
    """

    def __init__(self, t_ns: int, stacks: Collection[int] = ()) -> None:
        """Create a bus that is idle at `t_ns`; the boards in `stacks` are MTB3s."""
        self.lost: dict[int, int] = {}  # number of frames, by address
        self._stacks = frozenset(stacks)
        self._queue_frames = round(reference_insole().mtb4_queue_frames)
        self._free_ns = t_ns
        self._sending: int | None = None  # board whose frame is on the bus
        self._queued: list[Offer] = []  # frames left by earlier calls, one offer per board, in the order of sending

    def carry(self, offers: Sequence[Offer], until_ns: int) -> FrameBatch:
        """Return the frames that begin before `until_ns`, stamped with their end; the others stay queued.

        `offers` must be in order of time, later than those of earlier calls and before `until_ns`.
        """
        queued = self._queued
        self._queued = []
        if not offers and not queued:
            return FrameBatch.empty()
        # One empty frame per stack, whose row is used whenever the stack overflows.
        overflows = [_overflow_frame(address) for address in sorted(self._stacks)]
        all_offers = [*overflows, *queued, *offers]
        can_id = np.concatenate([offer.can_id for offer in all_offers])
        dlc = np.concatenate([offer.dlc for offer in all_offers])
        data = np.concatenate([offer.data for offer in all_offers])
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
            remaining = n_begun = int(np.searchsorted(end_ns - duration_ns[pending], before_ns))
            rows.append(pending[:n_begun])
            ends_ns.append(end_ns[:n_begun])
            self._free_ns = int(end_ns[n_begun - 1])
            for address in order:
                n_sent = min(remaining, len(queues[address]))
                remaining -= n_sent
                if n_sent:
                    self._sending = address
                queues[address] = queues[address][n_sent:]
                if not len(queues[address]):
                    del queues[address]

        def put(offer: Offer, offered: NDArray[np.intp]) -> None:
            queue = queues.get(offer.address, offered[:0])
            if offer.address in self._stacks:
                on_bus = self._sending == offer.address and self._free_ns > offer.ready_ns
                overflow = np.array([sorted(self._stacks).index(offer.address)])
                queue, lost = _push_on_stack(queue, offered, on_bus, overflow)
            else:
                queue = np.concatenate([queue, offered])
                lost = max(len(queue) - self._queue_frames, 0)
                queue = queue[: self._queue_frames]
            if lost:
                self.lost[offer.address] = self.lost.get(offer.address, 0) + lost
            if len(queue):
                queues[offer.address] = queue

        start = len(overflows)
        for offer in queued:
            queues[offer.address] = np.arange(start, start + len(offer.can_id))
            start += len(offer.can_id)
        for offer in offers:
            serve(offer.ready_ns)
            if not queues:
                self._free_ns = max(self._free_ns, offer.ready_ns)
            put(offer, np.arange(start, start + len(offer.can_id)))
            start += len(offer.can_id)
        serve(until_ns)
        self._queued = [
            Offer(self._free_ns, address, can_id[queue], dlc[queue], data[queue]) for address, queue in queues.items()
        ]
        if not rows:
            return FrameBatch.empty()
        sent, t_ns = np.concatenate(rows), np.concatenate(ends_ns)
        zeros = np.zeros(len(sent), np.uint8)
        return FrameBatch(t_ns, t_ns, zeros, can_id[sent], dlc[sent], data[sent], zeros)


def _push_on_stack(
    queue: NDArray[np.intp], offered: NDArray[np.intp], on_bus: bool, overflow: NDArray[np.intp]
) -> tuple[NDArray[np.intp], int]:
    """Return an MTB3's queue, in the order of sending, with `offered` added, and the number of lost frames.

    `on_bus`: a frame of the board is being sent, so the register does not yet hold the next one. `overflow` (1,) is the
    row of the board's empty frame.
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


def _overflow_frame(address: int) -> Offer:
    empty_id = skin_id(address, TYPE_OVERFLOW, CLASS_MANAGEMENT)
    return Offer(0, address, np.array([empty_id], np.uint32), np.zeros(1, np.uint8), np.zeros((1, 8), np.uint8))
