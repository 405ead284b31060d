"""The floor: the least that a program in Python does, that puts both feet's cycles on Zenoh in time.

It receives every frame, knows when a foot's cycle is complete by counting, and puts bytes made beforehand, of the
size of the daemon's messages, on the same six keys.

Of the ways to be woken, the one in `waiting` is best. Others, in CPU and median latency against it:
sleeping for as long as the bus needs for the frames outstanding 1.1 to 1.6 × and the same latency, depending on
the boards' phases; a timer of 1 ms 1.4 × and five times the latency; one blocking recvmmsg for all that is
outstanding 3 ×, since the kernel wakes the process for every frame of it; poll for every frame 4 ×.
"""

from __future__ import annotations

import ctypes
import socket
import struct
import time

import numpy as np
import zenoh

from benchmarks.lib import measured, traffic
from benchmarks.live.rhythm import HALVES, Rhythm
from insole_daemon.config import Zenoh
from insole_daemon.service.foot import Foot
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.keys import key
from insole_daemon.wire.session import open_daemon_session

_SO_TIMESTAMPNS, _SO_RCVBUFFORCE = 35, 33
_LEFT_BELOW = 0x480  # identifiers of boards 5, 6, 7; those of the right foot's are above
_CONTROL_BYTES = 64
_WAIT_US = 200_000  # for frames that do not come, before looking whether it is over
_libc = ctypes.CDLL(None, use_errno=True)


class Receiver:
    """`recvmmsg` into memory of its own; only identifiers and the newest time are ever looked at."""

    def __init__(self, sock: socket.socket, capacity: int = 256) -> None:
        try:
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, 8 << 20)
        except PermissionError:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, _WAIT_US))
        frames = np.zeros((capacity, 16), np.uint8)
        control = np.zeros((capacity, _CONTROL_BYTES), np.uint8)
        row = np.arange(capacity, dtype=np.uint64)
        # struct iovec {base, len} and struct mmsghdr {name, namelen, iov, iovlen, control, controllen, flags, len}
        iovec = np.zeros((capacity, 2), np.uint64)
        iovec[:, 0], iovec[:, 1] = frames.ctypes.data + row * np.uint64(16), 16
        headers = np.zeros((capacity, 8), np.uint64)
        headers[:, 2], headers[:, 3] = iovec.ctypes.data + row * np.uint64(16), 1
        headers[:, 4], headers[:, 5] = control.ctypes.data + row * np.uint64(_CONTROL_BYTES), _CONTROL_BYTES
        self._ids, self._stamps = frames.view(np.uint32)[:, 0], control.view(np.int64)
        self._memory = frames, control, iovec, headers
        self._address = ctypes.c_void_p(headers.ctypes.data)
        self._fd = sock.fileno()

    def take(self, most: int, wait: bool = False) -> int:
        """How many frames came, at most `most`; `wait`: until as many have."""
        flags = 0 if wait else socket.MSG_DONTWAIT
        return max(0, _libc.recvmmsg(self._fd, self._address, most, flags, None))

    def left(self, n: int) -> int:
        """How many of the n frames just taken are of the left foot."""
        return int(np.count_nonzero(self._ids[:n] < _LEFT_BELOW))

    def newest_t_ns(self, n: int) -> int:
        """Kernel receive time of the last of the n frames just taken."""
        return int(self._stamps[n - 1, 2]) * 1_000_000_000 + int(self._stamps[n - 1, 3])


def payloads(index: int, feet: list[Foot]) -> list[tuple[str, zenoh.Encoding, bytes]]:
    """Key, encoding and bytes of the messages of a real cycle of feet[index]."""
    reader = SkinReader([foot.layout for foot in feet], traffic.PERIOD_NS, 5_000_000)
    cycles = reader.feed(traffic.frames(0.2))[index][-1]
    return [
        (
            key("bench", feet[index].name, type(message).__name__.lower()),
            zenoh.Encoding("application/msgpack").with_schema(message.SCHEMA),
            message.encode(),
        )
        for message in feet[index].messages(cycles, -1).published()
    ]


def main() -> None:
    options = measured.options(__doc__)
    sock, feed = measured.open_bus(options.bus)
    receiver, recorder, rhythm = Receiver(sock), measured.Recorder(options), Rhythm()
    feet = traffic.feet()
    names = [foot.name for foot in feet]
    ended: list[bool] = []
    measured.on_end(lambda: ended.append(True))
    frames = 0
    with open_daemon_session(Zenoh(listen=(options.endpoint,))) as session:
        puts = [
            [
                (
                    session.declare_publisher(
                        name,
                        encoding=encoding,
                        congestion_control=zenoh.CongestionControl.DROP,
                        priority=zenoh.Priority.REAL_TIME,
                    ),
                    payload,
                )
                for name, encoding, payload in payloads(index, feet)
            ]
            for index in range(len(feet))
        ]
        measured.ready([feed], options.endpoint)
        outstanding = [HALVES, HALVES]
        while not ended:
            # Never more than can complete a cycle, so that the frame that does is the last one taken.
            n = receiver.take(min(outstanding))
            if not n:
                pause_s = rhythm.pause_s(outstanding)
                if pause_s:
                    time.sleep(pause_s)
                    continue
                n = receiver.take(min(outstanding), wait=True)
            frames += n
            left = receiver.left(n)
            outstanding[0] -= left
            outstanding[1] -= n - left
            for foot in (0, 1):
                if not outstanding[foot]:
                    newest_t_ns = receiver.newest_t_ns(n)
                    for publisher, payload in puts[foot]:
                        publisher.put(payload)
                    recorder.cycle(names[foot], newest_t_ns)
                    rhythm.complete(foot, newest_t_ns)
                    outstanding[foot] = HALVES
    recorder.report(frames)


if __name__ == "__main__":
    main()
