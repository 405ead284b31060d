"""Receive many datagrams per system call: `recvmmsg`, with the kernel's receive time and its count of lost frames.

Works on any datagram socket whose datagrams are `struct can_frame` (16 bytes, linux/can.h), which is what a
raw CAN socket delivers:

    byte   0..3   identifier, with the flag bits EFF (31), RTR (30), ERR (29)
    byte   4      dlc
    byte   5..7   padding
    byte   8..15  data

Control messages (64-bit Linux, `struct cmsghdr` is 16 bytes): SCM_TIMESTAMPNS always first, then SO_RXQ_OVFL
once a frame was dropped (net/socket.c, __sock_recv_cmsgs).
"""

from __future__ import annotations

import ctypes
import os
import socket
import sys
import time

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..errors import BusError
from .frames import ERROR, EXTENDED, REMOTE, FrameBatch, ReceivedFrames
from .source import BusCounters

RECEIVE_BUFFER_BYTES = 8 << 20
# All that the kernel's queue can hold: it doubles the buffer and charges 768 bytes for a small frame. One call must
# receive everything that has arrived; otherwise cycles would be closed by time before their frames are read.
_CAPACITY = 2 * RECEIVE_BUFFER_BYTES // 768
_SO_TIMESTAMPNS = 35
_SO_RXQ_OVFL = 40
_SO_RCVBUFFORCE = 33
_STAMP_BYTES = 32  # cmsghdr + struct timespec
_CONTROL_BYTES = 64  # the stamp, and cmsghdr + uint32 of the drop counter, padded
_STAMP_HEADER = socket.SOL_SOCKET | _SO_TIMESTAMPNS << 32
_ID_EXTENDED, _ID_REMOTE, _ID_ERROR = 1 << 31, 1 << 30, 1 << 29
_ID_BITS = np.uint64(11)
_PLAIN = np.uint64((8 << 32) >> 11)  # the first 8 bytes above the identifier, of a standard data frame of 8 bytes
_ZEROS = np.zeros(_CAPACITY, np.uint8)
_ZEROS.flags.writeable = False  # batches share it: flags none, interface the first

_CLOCK_STEP_NS = 1_000_000  # realtime against monotonic: slewing stays far below this between two drains

_libc = ctypes.CDLL(None, use_errno=True)


class BatchedSocket:
    """Receives frames from `sock` in bulk and returns them as one FrameBatch.

    Raises BusError on a 32-bit or big-endian machine, where the structures of the system call differ.
    """

    def __init__(self, sock: socket.socket, counters: BusCounters) -> None:
        if ctypes.sizeof(ctypes.c_void_p) != 8 or sys.byteorder != "little":
            raise BusError(
                "reading SocketCAN needs a 64-bit little-endian Linux (x86-64 or aarch64); "
                "install a 64-bit operating system"
            )
        self.socket = sock
        self._counters = counters
        _set_receive_buffer(sock)
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        sock.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        self._frames = np.zeros((_CAPACITY, 16), np.uint8)
        self._control = np.zeros((_CAPACITY, _CONTROL_BYTES // 8), np.int64)
        # struct iovec {base, len} and struct mmsghdr {name, namelen, iov, iovlen, control, controllen, flags, len}
        row = np.arange(_CAPACITY, dtype=np.uint64)
        self._iovec = np.zeros((_CAPACITY, 2), np.uint64)
        self._iovec[:, 0] = self._frames.ctypes.data + row * np.uint64(16)
        self._iovec[:, 1] = 16
        self._headers = np.zeros((_CAPACITY, 8), np.uint64)
        self._headers[:, 2] = self._iovec.ctypes.data + row * np.uint64(16)
        self._headers[:, 3] = 1
        self._headers[:, 4] = self._control.ctypes.data + row * np.uint64(_CONTROL_BYTES)
        self._headers[:, 5] = _CONTROL_BYTES
        self._headers_address = self._headers.ctypes.data
        self._receiver = None if kernel is None else kernel.receiver(self._frames, self._control, self._headers)
        self._held = 0
        self._dropped = 0
        self._last_mono_ns = 0
        self._clock_offset_ns = time.monotonic_ns() - time.time_ns()

    def receive(self) -> int:
        """Receive the frames that wait in the socket, without blocking; return the number of frames now held."""
        if self._receiver is not None:
            held: int = kernel.receive(self._receiver, self.socket.fileno(), self._held)
            if held < 0:
                raise OSError(-held, os.strerror(-held))
            self._held = held
            return held
        room = _CAPACITY - self._held
        if room == 0:
            return self._held
        taken = _libc.recvmmsg(
            self.socket.fileno(),
            ctypes.c_void_p(self._headers_address + 64 * self._held),
            room,
            socket.MSG_DONTWAIT,
            None,
        )
        if taken > 0:
            self._held += taken
        elif taken < 0:
            error = ctypes.get_errno()
            if error not in (socket.EAGAIN, socket.EWOULDBLOCK, 4):  # 4: EINTR, a signal came first
                raise OSError(error, os.strerror(error))
        return self._held

    def drain(self) -> FrameBatch:
        """Return the frames held, as new arrays with the kernel's times."""
        held, self._held = self._held, 0
        if held == 0:
            return FrameBatch.empty()
        if self._receiver is not None:
            return self._drain_compiled(held)
        raw = self._frames[:held].copy()
        control = self._control[:held]
        self._count_drops(held)
        if np.count_nonzero(control[:, 1] == _STAMP_HEADER) < held:
            raise _without_time()
        t_ns = control[:, 2] * 1_000_000_000
        t_ns += control[:, 3]
        self._headers[:held, 5] = _CONTROL_BYTES
        self._counters.frames += held
        return FrameBatch(t_ns, self._monotonic(t_ns), _ZEROS[:held], *parts_of(raw))

    def _drain_compiled(self, held: int) -> FrameBatch:
        """Return the `held` frames as `drain` does, by the compiled kernel."""
        now_mono_ns = self._follow_clocks()
        block, stamped, plain, dropped, self._last_mono_ns = kernel.drain(
            self._receiver, held, self._clock_offset_ns, self._last_mono_ns, now_mono_ns
        )
        if dropped is not None:
            self._add_drops(dropped)
        if stamped < held:
            raise _without_time()
        self._counters.frames += held
        frames = ReceivedFrames(block)
        if plain == held:
            return frames
        return FrameBatch(frames.t_ns, frames.t_mono_ns, _ZEROS[:held], *parts_of(frames.raw.copy()))

    def _count_drops(self, held: int) -> None:
        """Read the kernel's counter of drops: cumulative, 32 bit, and sent with frames only once it is not zero."""
        if self._headers[held - 1, 5] > _STAMP_BYTES:
            self._add_drops(int(self._control[held - 1].view(np.uint32)[_STAMP_BYTES // 4 + 4]))

    def _add_drops(self, dropped: int) -> None:
        self._counters.overflows += (dropped - self._dropped) & 0xFFFF_FFFF
        self._dropped = dropped

    def _follow_clocks(self) -> int:
        """Update the offset between the wall clock and the monotonic clock; return the latter."""
        before_ns, now_ns, now_mono_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if (
            now_mono_ns - before_ns < _CLOCK_STEP_NS
        ):  # otherwise another process ran in between, and the old offset is kept
            offset_ns = now_mono_ns - now_ns
            if abs(offset_ns - self._clock_offset_ns) > _CLOCK_STEP_NS:
                self._counters.clock_steps += 1
            self._clock_offset_ns = offset_ns
        return now_mono_ns

    def _monotonic(self, t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Convert receive times to the monotonic clock; a step of the wall clock in between has little effect."""
        now_mono_ns = self._follow_clocks()
        t_mono_ns = t_ns + self._clock_offset_ns
        if t_mono_ns[0] < self._last_mono_ns:
            t_mono_ns[0] = self._last_mono_ns
        if np.count_nonzero(t_mono_ns[1:] < t_mono_ns[:-1]):
            np.maximum.accumulate(t_mono_ns, out=t_mono_ns)
        if t_mono_ns[-1] > now_mono_ns:
            np.minimum(t_mono_ns, now_mono_ns, out=t_mono_ns)
        self._last_mono_ns = int(t_mono_ns[-1])
        return t_mono_ns


def parts_of(
    raw: NDArray[np.uint8],
) -> tuple[NDArray[np.uint32], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]:
    """Return can_id, dlc, data and flags of n `struct can_frame`, `raw` (n, 16), which may be changed."""
    can_id, dlc, data, flags = raw.view(np.uint32)[:, 0], raw[:, 4], raw[:, 8:], _ZEROS[: len(raw)]
    if np.count_nonzero(raw.view(np.uint64)[:, 0] >> _ID_BITS == _PLAIN) < len(raw):
        can_id, flags = _flags_apart(can_id)
        data[np.arange(8) >= dlc[:, None]] = 0
    return can_id, dlc, data, flags


def _without_time() -> BusError:
    return BusError("the kernel delivered a frame without a receive time although SO_TIMESTAMPNS is set")


def _flags_apart(id_and_flags: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Split identifiers and flags of frames that are not all standard data frames."""
    flags = np.where(id_and_flags & _ID_EXTENDED, EXTENDED, 0).astype(np.uint8)
    flags |= np.where(id_and_flags & _ID_REMOTE, REMOTE, 0).astype(np.uint8)
    flags |= np.where(id_and_flags & _ID_ERROR, ERROR, 0).astype(np.uint8)
    standard = flags & (EXTENDED | ERROR) == 0  # an error's class has 29 bits
    return id_and_flags & np.where(standard, np.uint32(0x7FF), np.uint32(0x1FFF_FFFF)), flags


def _set_receive_buffer(sock: socket.socket) -> None:
    """Set a buffer of 8 MiB if allowed: root may exceed net.core.rmem_max, other users get up to that limit."""
    try:
        sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
