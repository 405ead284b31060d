import errno
import re
import socket
import struct
import time

import numpy as np
import pytest

from insole_daemon.bus.frames import EXTENDED, REMOTE, FrameBatch
from insole_daemon.bus.opening import open_bus, open_sink
from insole_daemon.bus.sink import SocketCanSink, can_frames
from insole_daemon.config import Bus
from insole_daemon.errors import BusError
from tests.conftest import PATIENCE_S


def batch(n, **columns):
    fixed = {
        "t_ns": np.zeros(n, np.int64),
        "t_mono_ns": np.zeros(n, np.int64),
        "interface": np.zeros(n, np.uint8),
        "can_id": (0x450 + np.arange(n) % 16).astype(np.uint32),
        "dlc": np.full(n, 8, np.uint8),
        "data": (np.arange(8 * n).reshape(n, 8) % 251).astype(np.uint8),
        "flags": np.zeros(n, np.uint8),
    }
    return FrameBatch(**{**fixed, **columns})


def received_of(source, n):
    give_up = time.monotonic() + PATIENCE_S
    while source.receive() < n and time.monotonic() < give_up:
        source.wait(0.1)
    return source.drain()


class Stub:
    """A socket whose `send` fails with the given errors in turn, then takes everything."""

    def __init__(self, *errors, for_ever=False):
        self.errors, self.for_ever, self.taken = list(errors), for_ever, []

    def send(self, frame, flags):
        assert flags & socket.MSG_DONTWAIT
        if self.errors:
            number = self.errors[0] if self.for_ever else self.errors.pop(0)
            raise OSError(number, "stub")
        self.taken.append(frame)
        return len(frame)


def test_frames_are_struct_can_frame_of_this_machine():
    frames = batch(
        3,
        can_id=np.array([0x453, 0x1ABCDE12, 0x205], np.uint32),
        dlc=np.array([8, 2, 0], np.uint8),
        data=np.array([[0x40] * 8, [1, 2, 0, 0, 0, 0, 0, 0], [0] * 8], np.uint8),
        flags=np.array([0, EXTENDED, REMOTE], np.uint8),
    )
    expected = [
        struct.pack("=IB3x8s", 0x453, 8, b"\x40" * 8),
        struct.pack("=IB3x8s", 0x1ABCDE12 | 1 << 31, 2, b"\1\2"),
        struct.pack("=IB3x8s", 0x205 | 1 << 30, 0, b""),
    ]
    assert can_frames(frames).shape == (3, 16)
    assert [row.tobytes() for row in can_frames(frames)] == expected


def test_every_frame_is_one_datagram():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with ours, theirs:
        sink = SocketCanSink(ours, "can0")
        frames = batch(20)
        sink.send(frames)
        sink.send(FrameBatch.empty())
        assert [theirs.recv(64) for _ in range(20)] == [row.tobytes() for row in can_frames(frames)]


def test_a_full_queue_is_waited_for_and_no_frame_is_lost():
    stub = Stub(errno.ENOBUFS, errno.ENOBUFS, errno.EAGAIN)
    frames = batch(5)
    SocketCanSink(stub, "can0").send(frames)
    assert stub.taken == [row.tobytes() for row in can_frames(frames)]


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENETDOWN, "ip link set can7 up"),
        (errno.ENODEV, "plugged in"),
        (errno.ENOBUFS, "another node"),
        (errno.EIO, "ip -details link show can7"),
    ],
)
def test_an_interface_that_takes_nothing_is_named_with_a_remedy(number, remedy):
    with pytest.raises(BusError, match=f"socketcan:can7: sending failed: .*{re.escape(remedy)}"):
        SocketCanSink(Stub(number, for_ever=True), "can7", 0.02).send(batch(1))


def test_virtual_bus_hands_every_frame_on():
    source = open_bus(Bus("virtual", "sink-test"))
    with open_sink(Bus("virtual", "sink-test")) as sink:
        frames = batch(200, can_id=(0x400 + np.arange(200)).astype(np.uint32))
        sink.send(frames)
        received = received_of(source, 200)
        assert (received.can_id == frames.can_id).all()
        assert (received.dlc == frames.dlc).all()
        assert (received.data == frames.data).all()
        assert not received.flags.any()
        sink.send(
            batch(
                1,
                dlc=np.array([0], np.uint8),
                data=np.zeros((1, 8), np.uint8),
                flags=np.array([REMOTE], np.uint8),
            )
        )
        assert received_of(source, 1).flags.tolist() == [REMOTE]
    source.close()
    with pytest.raises(BusError, match="virtual:sink-test: sending failed"):
        sink.send(batch(1))  # it is closed


def test_no_such_interface_or_no_can_at_all():
    with pytest.raises(BusError, match=r"socketcan:nosuch7: cannot be opened: .*(CAN|no such interface)"):
        open_sink(Bus("socketcan", "nosuch7")).__enter__()


def test_no_such_driver():
    with pytest.raises(BusError, match=r"nosuch:x: cannot be opened: .*python-can"):
        open_sink(Bus("nosuch", "x")).__enter__()
