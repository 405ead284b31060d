"""What a person is told when an interface does not open, or stops."""

from __future__ import annotations

import errno
import gc
import os
import socket

import can
import pytest

from insole_daemon.bus import socketcan
from insole_daemon.bus.opening import open_as_boards, open_bus
from insole_daemon.bus.pythoncan import open_adapter
from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.config import Bus
from insole_daemon.errors import BusError


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.EPERM, "RestrictAddressFamilies=AF_CAN"),
        (errno.EACCES, "RestrictAddressFamilies=AF_CAN"),
        (errno.ENODEV, "ip -brief link show type can"),
        (errno.EAFNOSUPPORT, "modprobe can-raw.*; 'insole demo' needs none"),
        (errno.EMFILE, "Too many open files"),
    ],
)
def test_an_interface_that_does_not_open_is_named_with_a_remedy(monkeypatch, number, remedy):
    # A kernel that forbids AF_CAN to one process alone cannot be had here, so the answer of the system is a stand-in.
    def refuse(**_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(can, "Bus", refuse)
    with pytest.raises(BusError, match=f"socketcan:can7: cannot be opened: .*{remedy}"):
        open_bus(Bus("socketcan", "can7"))


@pytest.mark.parametrize(
    ("number", "remedy"), [(errno.ENETDOWN, "ip link set can7 up"), (errno.ENODEV, "adapter"), (errno.EIO, "error")]
)
def test_an_interface_that_fails_while_it_is_read_is_named(monkeypatch, number, remedy):
    source = socketcan.SocketCanSource(socket.socket(socket.AF_INET, socket.SOCK_DGRAM), "can7")

    def fail():
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(source._batched, "receive", fail)
    with pytest.raises(BusError, match=f"socketcan:can7: reading failed: .*{remedy}"):
        source.receive()
    source.close()


def test_several_buses_open_all_or_none():
    with pytest.raises(BusError, match="nosuch:x"):
        RecoveringSource([Bus("virtual", "all-or-none"), Bus("nosuch", "x")])
    source = RecoveringSource([Bus("virtual", "all-or-none"), Bus("virtual", "second")])
    assert source.interfaces == ("all-or-none", "second")
    assert source.receive() == 0
    assert len(source.drain()) == 0
    source.close()


def test_other_interfaces_of_python_can_give_wall_clock_nanoseconds():
    source = open_bus(Bus("virtual", "stamps"))
    with can.Bus(interface="virtual", channel="stamps") as sender:
        sender.send(can.Message(arbitration_id=0x453, is_extended_id=False, data=[0x40, 1, 2, 3, 4, 5, 6, 7]))
        sender.send(can.Message(arbitration_id=0x1ABCDE, is_extended_id=True, data=[1]))
        while source.receive() < 2:
            source.wait(1.0)
    batch = source.drain()
    assert batch.can_id.tolist() == [0x453, 0x1ABCDE]
    assert batch.dlc.tolist() == [8, 1]
    assert batch.data[1].tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    assert batch.t_mono_ns[1] >= batch.t_mono_ns[0]
    source.close()
    source.close()


def test_boards_listen_to_commands_alone(monkeypatch):
    ours, theirs = socket.socketpair()
    requested = {}

    def open_socket(channel, **options):
        requested.update(options)
        return ours

    monkeypatch.setattr(socketcan, "open_socket", open_socket)
    open_as_boards(Bus("socketcan", "can7")).close()
    assert ours.fileno() == -1
    theirs.close()
    assert [entry["can_id"] for entry in requested["can_filters"]] == [0x200, 0x700], "not the stream that they send"


def test_an_adapter_that_cannot_be_opened_is_one_error_and_no_warning(caplog) -> None:
    with pytest.raises(BusError, match="cannot be opened"):
        open_adapter("udp_multicast", "192.0.2.1")  # no multicast group, which shows once the adapter's object is made
    gc.collect()
    assert not caplog.records
