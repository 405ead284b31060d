"""Free ports for tests: suites that run side by side, and the processes of each, never get the same one."""

from __future__ import annotations

import itertools
import socket

_FIRST, _END, _PER_PROCESS = 20_000, 32_000, 1_000  # below the ports that the kernel assigns by itself


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Return a port on loopback that nobody uses, and that no other process of any suite is given."""
    return next(port for port in _PORTS if _is_free(port, kind))


def _reserve() -> tuple[socket.socket, range]:
    """Return the range of this process and the socket that reserves it until the process ends.

    A name in the abstract namespace can be bound once on a machine, and the kernel takes it back from a killed process.
    """
    for first in range(_FIRST, _END, _PER_PROCESS):
        reservation = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            reservation.bind(f"\0insole-daemon-tests-{first}")
        except OSError:
            reservation.close()
        else:
            return reservation, range(first, first + _PER_PROCESS)
    raise RuntimeError(f"{(_END - _FIRST) // _PER_PROCESS} processes with tests run already: wait until one has ended")


def _is_free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as sock:
        try:
            sock.bind(("127.0.0.1", port))
        except OSError:  # in use by another program
            return False
    return True


_RESERVATION, _RANGE = _reserve()
_PORTS = itertools.cycle(_RANGE)
