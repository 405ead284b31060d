"""Checks of the host: its clock, the size of the receive buffer, and the folder of the daemon's files."""

from __future__ import annotations

import ctypes
import os
import struct
import time
from collections.abc import Iterator
from pathlib import Path

from ...bus.batched_socket import RECEIVE_BUFFER_BYTES
from ..state import state_folder as folder_of_state
from .finding import CheckResult, ok, problem, warning

_RMEM_MAX = Path("/proc/sys/net/core/rmem_max")
_RAISE = (
    f"echo net.core.rmem_max={RECEIVE_BUFFER_BYTES} | sudo tee /etc/sysctl.d/60-insole.conf && sudo sysctl --system"
)
_STEP_NS = 1_000_000
_UNSYNCHRONISED = 0x40  # STA_UNSYNC of linux/timex.h
_NO_SOONER_THAN_S = 1_750_000_000  # 2025; a host without a clock battery starts in 1970 or at its last shutdown


def check_receive_buffer(limit: Path = _RMEM_MAX) -> Iterator[CheckResult]:
    """Check how many bytes of frames the kernel may buffer while the daemon does not read."""
    try:
        most = int(limit.read_text())
    except (OSError, ValueError) as error:
        yield warning("receive buffer", f"{limit} cannot be read: {error}")
        return
    if most >= RECEIVE_BUFFER_BYTES:
        yield ok("receive buffer", f"the kernel grants {most} bytes")
    else:
        yield warning(
            "receive buffer",
            f"the kernel grants {most} bytes, expected {RECEIVE_BUFFER_BYTES}: a stall of the host loses frames sooner "
            "(a daemon that runs as root may exceed it)",
            _RAISE,
        )


def check_state_folder() -> Iterator[CheckResult]:
    """Check that this user may store a zero."""
    folder = folder_of_state()
    nearest = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
    if os.access(nearest, os.W_OK | os.X_OK) and nearest.is_dir():
        yield ok("state", f"zeros are kept in {folder}")
    else:
        yield problem(
            "state",
            f"zeros are kept in {folder}, where this user may not write",
            f'sudo chown "$USER" {nearest}   # or set STATE_DIRECTORY to another folder',
        )


class ClockWatch:
    """Observes the clocks from its construction until `findings` is called."""

    def __init__(self) -> None:
        self._offset_ns = _offset_ns()

    def findings(self) -> Iterator[CheckResult]:
        """Check that the wall clock is synchronised and did not step."""
        step_ns = _offset_ns() - self._offset_ns
        if time.time() < _NO_SOONER_THAN_S:
            yield problem("clock", f"the date is {time.strftime('%Y-%m-%d')}: t_ns is wrong", _SET)
        elif abs(step_ns) > _STEP_NS:
            yield warning(
                "clock", f"the wall clock stepped by {step_ns * 1e-6:+.0f} ms just now: t_ns jumped, ages did not", _SET
            )
        elif _synchronised() is None:
            yield warning("clock", "the kernel does not say whether the clock is synchronised", "timedatectl")
        elif not _synchronised():
            yield warning(
                "clock", "not synchronised: t_ns cannot be compared with other hosts, and steps once it is set", _SET
            )
        else:
            yield ok("clock", "synchronised, no step seen")


_SET = "sudo timedatectl set-ntp true   # or another NTP client, such as chrony"


def _offset_ns() -> int:
    return time.time_ns() - time.monotonic_ns()


def _synchronised() -> bool | None:
    """Return whether the kernel reports a synchronised clock (adjtimex(2) with modes = 0 changes nothing)."""
    timex = ctypes.create_string_buffer(256)  # struct timex is 208 bytes
    if ctypes.CDLL(None).adjtimex(timex) < 0:
        return None
    # modes, offset, freq, maxerror, esterror, status
    status: int = struct.unpack_from("=I4xqqqqi", timex.raw)[5]
    return not status & _UNSYNCHRONISED
