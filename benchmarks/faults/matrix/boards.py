"""A process: emulated boards of both feet, each foot on its interface, every half numbered.

    python -m benchmarks.faults.matrix.boards CONFIG OUT.npz SAID

With `obey` in SAID (JSON) they hear commands. Says "playing <monotonic ns>" when they are powered up. On stdin, a line
each: `mangle FOOT HOW` does to that foot's frames what Bus._mangle lists, `mangle FOOT none` ends it, `end` ends
everything and writes what was sent.
"""

from __future__ import annotations

import bisect
import contextlib
import json
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.faults.matrix import numbers
from insole_daemon import config as configs
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.sink import can_frames
from insole_daemon.bus.socketcan import COMMAND_FILTERS, SocketCanSource
from insole_daemon.errors import BusError
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.skin.identifiers import CLASS_SKIN, TAG_A, TAG_B

FRAME = struct.Struct("=IB3x8s")
BUS_OFF, RESTARTED = 0x2000_0040, 0x2000_0100  # error frames, as a driver sends them
NOT_OURS = -1  # a frame that is not one intact, numbered half
BABBLING, MANY = (6, 8), 8  # boards, and how often a babbling one says everything
FOLLOW_NS = 20_000_000  # after which an interface that has come back is spoken on
LENGTH_S = 90.0  # of what is played at the most
GROUP_S = 0.002  # frames due within this are sent together
FLOOD, FLOOD_EVERY_S = 10, 0.01  # frames at once: as many as one slow processor bears
SHARE = 0.05  # of the frames that are lost, doubled, cut or spoiled


Numbered = tuple[bytes, int, int, int]  # struct can_frame, identifier, 0 half A or 1 half B, number


class Pressed:
    """Both feet stand, swaying a little, and lift off from `lift_s` on."""

    def __init__(self, n_triangles: int, pressure_pa: float, lift_s: float) -> None:
        self._shape, self._pressure_pa, self._lift_s = (n_triangles, 12), pressure_pa, lift_s

    def pressure_pa(self, foot: str, t_s):
        sway = 1 + 0.2 * np.sin(np.pi * t_s)
        load = np.where(t_s < self._lift_s, self._pressure_pa * sway, 0.0)
        return np.broadcast_to(load[:, None, None], (len(t_s), *self._shape)).copy()


class Bus:
    """One interface: sends while it is there, hears commands, and keeps what was sent intact."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.how = "none"
        self.sent: list[tuple[int, int, int, int]] = []  # identifier, 0 A or 1 B, number, monotonic ns
        self._numbers: dict[tuple[int, int], int] = {}
        self._random = np.random.default_rng(7)
        self._index, self._follow_ns = 0, 0
        self._socket: socket.socket | None = None
        self._source: SocketCanSource | None = None

    def receive(self) -> FrameBatch:
        self._follow()
        if self._source is None:
            return FrameBatch.empty()
        try:
            self._source.receive()
        except BusError:
            return FrameBatch.empty()
        return self._source.drain()

    def send(self, batch: FrameBatch) -> None:
        self.put(self.numbered(batch))

    def numbered(self, batch: FrameBatch) -> list[Numbered]:
        """The frames with a number in each half."""
        frames = []
        for can_id, frame in zip(batch.can_id.tolist(), can_frames(batch), strict=True):
            half, number = NOT_OURS, 0
            if can_id >> 8 == CLASS_SKIN:
                half = int(frame[8] == TAG_B)
                number = self._numbers[can_id, half] = self._numbers.get((can_id, half), -1) + 1
                bits = numbers.B_BITS if half else numbers.A_BITS
                if not numbers.write(frame[9:14] if half else frame[9:16], number % (1 << bits)):
                    half = NOT_OURS
            frames.append((frame.tobytes(), can_id, half, number))
        return frames

    def put(self, frames: Sequence[Numbered]) -> None:
        """Send them now, as far as the bus lets them."""
        self._follow()
        now_ns = time.monotonic_ns()  # of all, which takes a while in some kernels
        for frame, can_id, half, number in frames if self.how == "none" else self._mangle(frames):
            try:
                assert self._socket is not None
                self._socket.send(frame)
            except (OSError, AssertionError):
                continue  # nobody hears it
            if half != NOT_OURS:
                self.sent.append((can_id, half, number, now_ns))

    def error(self, id_and_flags: int) -> None:
        """What a driver says of its controller."""
        assert self._socket is not None
        self._socket.send(FRAME.pack(id_and_flags, 8, bytes(8)))

    def _mangle(self, frames: Sequence[Numbered]) -> Iterator[Numbered]:
        """What becomes of frames on a bad bus; what does not leave as one intact half is none of ours."""
        how, random = self.how, self._random
        if how == "silence":
            return
        hit = random.random(len(frames)) < SHARE
        if how == "reordered":
            frames = [frames[at] for at in random.permutation(len(frames))]
        for (frame, can_id, half, number), struck in zip(frames, hit.tolist(), strict=True):
            copies = (
                (MANY if can_id >> 4 & 0xF in BABBLING else 1)
                if how == "babbling"
                else 1 + (how == "duplicated" and struck)
            )
            if how == "lost" and struck:
                continue
            if how == "corrupted" and struck:
                spoilt = bytearray(frame)
                spoilt[8 + random.integers(8)] ^= 1 << int(random.integers(8))
                yield bytes(spoilt), can_id, NOT_OURS, number
            elif how == "of wrong length" and struck:
                yield frame[:4] + bytes([int(random.integers(8))]) + frame[5:], can_id, NOT_OURS, number
            else:
                yield frame, can_id, half, number
                for _ in range(copies - 1):
                    yield frame, can_id, NOT_OURS, number

    def _follow(self) -> None:
        """Hold the interface that has the name now."""
        now_ns = time.monotonic_ns()
        if now_ns < self._follow_ns:
            return
        self._follow_ns = now_ns + FOLLOW_NS
        try:
            index = socket.if_nametoindex(self.name)
        except OSError:
            index = 0
        if index == self._index:
            return
        self._index = index
        if self._source is not None:
            self._source.close()
            self._source = self._socket = None
        if index:
            sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
            filters = b"".join(struct.pack("=II", each["can_id"], each["can_mask"]) for each in COMMAND_FILTERS)
            sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
            sock.setblocking(False)
            sock.bind((self.name,))
            self._socket, self._source = sock, SocketCanSource(sock, self.name)


def strange(bus: Bus, stop: threading.Event) -> None:
    """Another node says 1 000 frames a second, of a board that is not ours."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sock:
        sock.bind((bus.name,))
        frame = FRAME.pack(0x4E1, 8, bytes([TAG_A, *[240] * 7]))
        while not stop.wait(FLOOD_EVERY_S if bus.how == "flooded" else 0.1):
            if bus.how == "flooded":
                for _ in range(FLOOD):
                    with contextlib.suppress(OSError):
                        sock.send(frame)


def play(buses: dict[str, Bus], frames: dict[str, FrameBatch], stop: threading.Event, began: threading.Event) -> None:
    """Send frames made beforehand, whose times begin at 0: an emulator at work costs a slow kernel too much."""
    made = {foot: buses[foot].numbered(batch) for foot, batch in frames.items()}
    times_ns = {foot: batch.t_ns.tolist() for foot, batch in frames.items()}
    at = dict.fromkeys(frames, 0)
    began_ns = time.monotonic_ns()
    began.set()
    while not stop.is_set():
        now_ns = time.monotonic_ns() - began_ns
        next_ns = now_ns + 20_000_000
        for foot, times in times_ns.items():
            due = bisect.bisect_right(times, now_ns)
            if due > at[foot]:
                buses[foot].put(made[foot][at[foot] : due])
                at[foot] = due
            if due < len(times):
                next_ns = min(next_ns, times[due])
        time.sleep(max(GROUP_S, (next_ns - now_ns) * 1e-9))


def main(config_file: str, out: str, faults: str) -> None:
    listed = json.loads(faults)
    config = configs.load(config_file)
    stop = threading.Event()
    buses, emulators = {}, {}
    for insole in config.insoles:
        buses[insole.foot] = Bus(insole.boards[0].interface)
        layout = load_layout(insole)
        emulators[insole.foot] = Emulator(
            config,
            [layout],
            Pressed(len(layout), listed["pressure_pa"], listed["lift_s"]),
            faults=[InjectedFault(**fault) for fault in listed["faults"]] if insole.foot == "left" else (),
            generation="mtb4",
        )
    threads = [threading.Thread(target=strange, args=(buses["left"], stop))]
    began = threading.Event()
    if listed["obey"]:
        began.set()
        for foot, bus in buses.items():
            threads.append(threading.Thread(target=emulators[foot].play, args=(bus.send, stop, None, bus.receive)))
    else:
        frames = {foot: emulator.frames(0, LENGTH_S) for foot, emulator in emulators.items()}
        threads.append(threading.Thread(target=play, args=(buses, frames, stop, began)))
    for thread in threads:
        thread.start()
    began.wait()
    print("playing", time.monotonic_ns(), flush=True)
    for line in sys.stdin:
        if line.strip() == "end":
            break
        _, foot, how = line.split(maxsplit=2)
        bus, how = buses[foot], how.strip()
        if how == "bus-off":
            bus.error(BUS_OFF)
            bus.how = "silence"
        elif how == "restarted":
            bus.error(RESTARTED)
            bus.how = "none"
        else:
            bus.how = how
        print("done", flush=True)
    stop.set()
    for thread in threads:
        thread.join()
    sent = {foot: np.array(bus.sent, np.int64).reshape(-1, 4) for foot, bus in buses.items()}
    np.savez(Path(out), **sent)


if __name__ == "__main__":
    main(*sys.argv[1:])
