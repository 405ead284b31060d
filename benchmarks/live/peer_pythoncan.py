"""The peer: the same daemon as one would write it on python-can, without its per-frame waste.

It reads with python-can's own receive path, all that is there at every wake-up and without its `select` a frame,
and copies byte slices to their place: no numpy a frame. Waiting, and everything from a complete cycle on, is as in
the floor and the daemon: `waiting`, Foot.payloads, put. `check` holds its messages against the daemon's.

Of the ways to be woken, `waiting` costs it least; against it: `select` for every frame, as Bus.recv does, 1.9 ×,
a timer of 1 ms 1.1 × and five times the latency.
"""

from __future__ import annotations

import select
import socket
import time
from array import array

import numpy as np
from can.exceptions import CanOperationError
from can.interfaces.socketcan.socketcan import capture_message
from can.message import Message as CanMessage

from benchmarks.lib import measured, traffic
from benchmarks.live.rhythm import HALVES, Rhythm
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.config import Zenoh
from insole_daemon.service.foot import Foot
from insole_daemon.skin.cycles import ClosedCycle
from insole_daemon.skin.identifiers import TAG_A, TAG_B, skin_id
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_daemon_session

_SO_TIMESTAMPNS = 35
_N_TRIANGLES = HALVES // 2
_TOO_SLOW_S = 0.2  # to wait for a frame before looking whether it is over
_NO_ARRIVALS = bytes(8 * _N_TRIANGLES)  # which the watch over faults counts, and the peer has none
# What a record ends with: no triangle missing, neither late nor repeated, and zeros up to a whole word.
_NOTHING_MISSING = bytes(-(-(18 + 39 * _N_TRIANGLES) // 8) * 8 - 16 - 38 * _N_TRIANGLES)
_STAMP_ERROR_NS = 1_000  # python-can's times are floats of seconds since 1970


class Assembly:
    """The halves of one foot since its last cycle."""

    def __init__(self) -> None:
        self.counts = bytearray(12 * _N_TRIANGLES)
        self.status = bytearray(2 * _N_TRIANGLES)
        self.t_s = [0.0] * HALVES
        self.outstanding = HALVES

    def cycle(self, t_s: float) -> ClosedCycle:
        """The cycle that the frame at `t_s` completed, as the record that the daemon's messages are made of."""
        self.outstanding = HALVES
        older_s = map(min, self.t_s[::2], self.t_s[1::2])
        t_ns = array("q", [round(time_s * 1e9) for time_s in older_s])
        newest_ns = round(t_s * 1e9)
        record = b"".join((
            array("q", (newest_ns, newest_ns)), t_ns, array("q", [newest_ns - time_ns for time_ns in t_ns]),
            _NO_ARRIVALS, self.status, self.counts, _NOTHING_MISSING,
        ))  # fmt: skip
        return ClosedCycle(newest_ns, newest_ns, False, False, record)


class NoWatch:
    """In the place of a foot's watch over faults, which the peer has not."""

    def __init__(self, n_triangles: int) -> None:
        self.masked = np.zeros((n_triangles, 12), np.bool_)

    def gather(self, cycle: ClosedCycle, may_come_loose: bool) -> None:
        """Nothing is looked for."""


class Decoder:
    """Puts every message in its place."""

    def __init__(self, feet: list[Foot]) -> None:
        self.feet = [Assembly() for _ in feet]
        # By identifier: foot, its assembly, and where in it the triangle's counts, status and times begin.
        self._places = {
            skin_id(triangle.board, triangle.triangle): (index, self.feet[index], 12 * row, 2 * row)
            for index, foot in enumerate(feet)
            for row, triangle in enumerate(foot.layout.triangles)
        }

    def take(self, message: CanMessage) -> tuple[int, ClosedCycle] | None:
        """The foot and its cycle, if this frame completed one."""
        place = self._places.get(message.arbitration_id)
        data = message.data
        if place is None or len(data) != 8:
            return None
        index, assembly, count, half = place
        if data[0] == TAG_A:
            assembly.counts[count : count + 7] = data[1:8]
            assembly.t_s[half] = message.timestamp
        elif data[0] == TAG_B:
            assembly.counts[count + 7 : count + 12] = data[1:6]
            assembly.status[half : half + 2] = data[:5:-1]
            assembly.t_s[half + 1] = message.timestamp
        else:
            return None
        assembly.outstanding -= 1
        return (index, assembly.cycle(message.timestamp)) if not assembly.outstanding else None


def check() -> None:
    """Whether the messages are those of the daemon, apart from the rounding of times; raises AssertionError."""
    ours, theirs = traffic.feet(), traffic.feet()
    batch = traffic.frames(1.0)
    batch = batch[slice(112, 112 + 20 * 112)]
    stamp_ns = batch.t_ns + 1_700_000_000_000_000_000
    batch = FrameBatch(stamp_ns, stamp_ns, batch.interface, batch.can_id, batch.dlc, batch.data, batch.flags)
    reader = SkinReader([foot.layout for foot in ours], traffic.PERIOD_NS, 5_000_000)
    expected = [
        message.decode(message.encode())
        for foot, closed in zip(ours, reader.feed(batch), strict=True)
        for cycles in closed
        for at in range(len(cycles))
        for message in foot.messages(cycles, at).published()
    ]
    decoder = Decoder(theirs)
    differences = [
        (index, message)
        for t_ns, can_id, data in zip(stamp_ns.tolist(), batch.can_id.tolist(), batch.data, strict=True)
        if (closed := decoder.take(CanMessage(t_ns * 1e-9, can_id, False, dlc=8, data=data.tobytes())))
        for index in [closed[0]]
        for kind, payload in theirs[index].payloads(closed[1]).payloads
        for message in [kind.decode(payload)]
    ]
    differences.sort(key=lambda pair: pair[0])
    assert len(differences) == len(expected) > 100, (len(differences), len(expected))
    for (_, message), other in zip(differences, expected, strict=True):
        for name in (field for field in other.__slots__ if field not in ("started_ns", "t_published_ns")):
            a, b = getattr(message, name), getattr(other, name)
            if name in ("t_ns", "triangle_t_ns"):
                assert (np.abs(np.subtract(a, b)) <= _STAMP_ERROR_NS).all(), name
            elif name == "age_ms":
                assert np.allclose(a, b, atol=2e-6 * _STAMP_ERROR_NS), name
            else:
                assert np.array_equal(a, b, equal_nan=isinstance(b, np.ndarray)), (name, a, b)


def main() -> None:
    options = measured.options(__doc__)
    sock, feed = measured.open_bus(options.bus)
    sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)  # as SocketcanBus does
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    sock.setblocking(False)
    feet = traffic.feet()
    for foot in feet:
        foot._watch = NoWatch(foot.n_triangles)  # type: ignore[assignment]
    decoder, recorder, rhythm = Decoder(feet), measured.Recorder(options), Rhythm()
    ended: list[bool] = []
    measured.on_end(lambda: ended.append(True))
    frames = 0
    with open_daemon_session(Zenoh(listen=(options.endpoint,))) as session:
        publishers = [FootPublisher(session, "bench", foot.name) for foot in feet]
        measured.ready([feed], options.endpoint)
        take = decoder.take
        while not ended:
            try:
                while True:
                    closed = take(capture_message(sock))
                    frames += 1
                    if closed is not None:
                        index, cycle = closed
                        publishers[index].put(feet[index].payloads(cycle).payloads)
                        newest_t_ns = cycle.t_ns
                        recorder.cycle(feet[index].name, newest_t_ns)
                        rhythm.complete(index, newest_t_ns)
            except CanOperationError:  # nothing left: python-can wraps the BlockingIOError
                pass
            pause_s = rhythm.pause_s([assembly.outstanding for assembly in decoder.feet])
            if pause_s:
                time.sleep(pause_s)
            else:
                select.select([sock], [], [], _TOO_SLOW_S)
        for publisher in publishers:
            publisher.close()
    recorder.report(frames)


if __name__ == "__main__":
    main()
