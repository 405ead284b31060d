"""The batched reader on real datagram sockets: the kernel's stamps, its drop counter, its order.

UDP over loopback stands in for CAN here, the same system call on the same struct; tests/vcan has the real bus.
"""

from __future__ import annotations

import socket
import struct
import time

import numpy as np
import pytest

from insole_daemon.bus import batched_socket as module
from insole_daemon.bus import link
from insole_daemon.bus.batched_socket import BatchedSocket
from insole_daemon.bus.frames import ERROR, EXTENDED, REMOTE
from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.bus.socketcan import SocketCanSource
from insole_daemon.bus.source import BusCounters, collect
from insole_daemon.config import Bus
from tests.conftest import PATIENCE_S

from ..implementations import numpy_and_compiled

implementation = numpy_and_compiled(module)


def frame(can_id: int, data: bytes = b"", dlc: int | None = None) -> bytes:
    return struct.pack("<IB3x8s", can_id, len(data) if dlc is None else dlc, data)


@pytest.fixture
def pair():
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(receiver.getsockname())
    yield receiver, sender
    receiver.close()
    sender.close()


def wait_for_stamps(sender: socket.socket, batched: BatchedSocket) -> None:
    """Wait until the kernel stamps frames as they arrive.

    It begins some time after the first socket asks for it (net_enable_timestamp in net/core/dev.c). Until then a frame
    gets the time at which it is read.
    """
    end = time.monotonic() + PATIENCE_S
    stamp_ns = read_ns = 0
    while stamp_ns >= read_ns:
        assert time.monotonic() < end
        sender.send(frame(0x450))
        time.sleep(0.002)
        read_ns = time.time_ns()
        assert batched.receive() == 1
        stamp_ns = int(batched.drain().t_ns[0])


def test_frames_come_in_order_with_kernel_time_in_integer_ns(pair):
    receiver, sender = pair
    counters = BusCounters()
    batched = BatchedSocket(receiver, counters)
    wait_for_stamps(sender, batched)
    waited = counters.frames
    before = time.time_ns()
    for i in range(300):
        sender.send(frame(0x450 + i % 16, bytes([0x40, i % 256, 2, 3, 4, 5, 6, 7])))
    assert batched.receive() == 300
    after = time.time_ns()  # a busy kernel receives, and stamps, after the sender has gone on
    batch = batched.drain()
    assert batch.can_id.tolist() == [0x450 + i % 16 for i in range(300)]
    assert batch.data[:, 1].tolist() == [i % 256 for i in range(300)]
    assert (batch.dlc == 8).all()
    assert before <= batch.t_ns[0] <= batch.t_ns[-1] <= after
    assert (np.diff(batch.t_mono_ns) >= 0).all()
    assert batch.t_mono_ns[-1] <= time.monotonic_ns()
    assert batched.receive() == 0
    assert len(batched.drain()) == 0
    assert counters.frames - waited == 300


def test_a_batch_does_not_change_when_more_is_received(pair):
    receiver, sender = pair
    batched = BatchedSocket(receiver, BusCounters())
    sender.send(frame(0x451, b"\x40" * 8))
    batched.receive()
    first = batched.drain()
    sender.send(frame(0x452, b"\xc0" * 8))
    batched.receive()
    batched.drain()
    assert first.can_id.tolist() == [0x451]
    assert first.data.tolist() == [[0x40] * 8]


def test_flags_and_short_payloads(pair):
    receiver, sender = pair
    batched = BatchedSocket(receiver, BusCounters())
    sender.send(frame(0x123 | 1 << 31, b"\1\2\3"))
    sender.send(frame(0x123 | 1 << 30, b"", dlc=4))
    sender.send(frame(0x040 | 1 << 29, b"\0" * 8))
    sender.send(struct.pack("<IB3x8s", 0x7A5, 2, b"\xff" * 8))
    batched.receive()
    batch = batched.drain()
    assert batch.flags.tolist() == [EXTENDED, REMOTE, ERROR, 0]
    assert batch.can_id.tolist() == [0x123, 0x123, 0x040, 0x7A5]
    assert batch.data[3].tolist() == [255, 255, 0, 0, 0, 0, 0, 0], "bytes beyond the dlc say nothing"


def test_frames_the_kernel_dropped_are_counted(pair):
    receiver, sender = pair
    counters = BusCounters()
    batched = BatchedSocket(receiver, counters)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    for _ in range(500):
        sender.send(frame(0x450, bytes(8)))
    received = batched.receive()
    batched.drain()
    sender.send(frame(0x450, bytes(8)))  # the counter rides on the next frame that gets through
    batched.receive()
    batched.drain()
    assert 0 < received < 500
    assert counters.overflows == 500 - received
    assert counters.frames == received + 1


def test_one_call_takes_in_all_that_the_queue_can_hold(pair):
    receiver, sender = pair
    counters = BusCounters()
    batched = BatchedSocket(receiver, counters)
    for _ in range(25_000):
        sender.send(frame(0x450, bytes(8)))
    received = batched.receive()
    batched.drain()
    assert batched.receive() == 0, "the queue is empty"
    sender.send(frame(0x450, bytes(8)))
    batched.receive()
    batched.drain()
    assert counters.overflows == 25_000 - received


def test_a_step_of_the_wall_clock_moves_no_monotonic_time(pair, monkeypatch):
    receiver, sender = pair
    counters = BusCounters()
    batched = BatchedSocket(receiver, counters)
    real = time.time_ns
    sender.send(frame(0x450, bytes(8)))
    batched.receive()
    first = batched.drain()
    # The wall clock steps forward an hour after the frame was stamped: only the reading of it can be faked here.
    sender.send(frame(0x450, bytes(8)))
    batched.receive()
    monkeypatch.setattr(time, "time_ns", lambda: real() + 3_600_000_000_000)
    second = batched.drain()
    assert counters.clock_steps == 1
    assert 0 <= second.t_mono_ns[0] - first.t_mono_ns[0] < 1_000_000_000


def test_another_process_that_runs_between_two_clocks_is_no_step(pair, monkeypatch):
    receiver, sender = pair
    counters = BusCounters()
    batched = BatchedSocket(receiver, counters)
    real = time.time_ns
    sender.send(frame(0x450, bytes(8)))
    batched.receive()

    def late() -> int:
        now_ns = real()
        time.sleep(0.01)  # after the one clock was read and before the other
        return now_ns

    monkeypatch.setattr(time, "time_ns", late)
    before_ns = time.monotonic_ns()
    batch = batched.drain()
    assert counters.clock_steps == 0
    assert batch.t_mono_ns[0] < before_ns, "the frame had come before"


def test_collect_waits_for_the_answers_and_at_most_the_timeout(pair):
    receiver, sender = pair
    source = SocketCanSource(receiver, "can0")
    for _ in range(5):
        sender.send(frame(0x450, bytes(8)))
    batch, looked_ns = collect(source, 5, time.monotonic_ns() + 10**10)
    assert len(batch) == 5
    assert looked_ns <= time.monotonic_ns()
    sender.send(frame(0x450, bytes(8)))
    until = time.monotonic_ns() + 20_000_000
    batch, looked_ns = collect(source, 5, until)
    assert len(batch) == 1
    assert looked_ns > until
    source.close()


def test_several_buses_are_one_in_the_order_of_time(pair, monkeypatch):
    receiver, sender = pair
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other.bind(("127.0.0.1", 0))
    sources = {"can0": SocketCanSource(receiver, "can0"), "can1": SocketCanSource(other, "can1")}
    monkeypatch.setattr(link, "open_bus", lambda bus: sources[bus.channel])
    several = RecoveringSource([Bus("stub", "can0"), Bus("stub", "can1")])
    for i in range(20):
        (sender.send if i % 2 else lambda data: sender.sendto(data, other.getsockname()))(frame(0x400 + i, bytes(8)))
    deadline = time.monotonic() + PATIENCE_S
    while several.receive() < 20 and time.monotonic() < deadline:
        several.wait(0.1)
    batch = several.drain()
    assert batch.can_id.tolist() == list(range(0x400, 0x414))
    assert batch.interface.tolist() == [1, 0] * 10
    assert several.counters.frames == 20
    several.close()
