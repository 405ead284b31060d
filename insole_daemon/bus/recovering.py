"""Read several buses as one, in the order of time; each may disappear and return.

An interface can be missing, down, return under another index (an adapter plugged in again, a new vcan), or be off the
bus while it stays open (`bus-off`: only its driver can end that). The other buses are not affected, and the reader
never waits for a lost one.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Sequence

import numpy as np

from ..compiled import kernel
from ..config import Bus
from ..errors import BusError
from .frames import FrameBatch, ReceivedFrames
from .link import InterfaceChange, Link
from .sink import FrameSink
from .source import BusCounters


class RecoveringSource:
    """The frames of those `buses` that are present; as a FrameSource it neither fails nor ends.

    Raises BusError at once for a bus that can never be opened: a driver unknown to python-can, a kernel without CAN.
    """

    def __init__(self, buses: Sequence[Bus]) -> None:
        self.interfaces: tuple[str, ...] = tuple(bus.channel for bus in buses)
        self._wake = os.eventfd(0, os.EFD_NONBLOCK)  # signalled when a bus has been reopened
        self._links: list[Link] = []
        self._closed = False
        try:
            for bus in buses:
                self._links.append(Link(bus, lambda: os.eventfd_write(self._wake, 1)))
        except BusError:
            self.close()
            raise

    @property
    def counters(self) -> BusCounters:
        """Sums over the buses since the start, and the state of each interface."""
        total = BusCounters(interfaces={link.bus.channel: link.condition for link in self._links})
        for link in self._links:
            link.count_into(total)
        return total

    @property
    def exhausted(self) -> bool:
        """A bus has no end."""
        return False

    def changes(self) -> list[InterfaceChange]:
        """Return the changes since the last call, in order; the first call reports interfaces that are not up."""
        changes: list[InterfaceChange] = []
        for link in self._links:
            if link.changes:
                changes += link.changes
                link.changes.clear()
        if changes:
            changes.sort(key=lambda change: change.t_ns)
        return changes

    def receive(self) -> int:
        """See FrameSource; a bus that fails is reopened by its thread."""
        held = 0
        for link in self._links:
            held += link.receive()
        return held

    def drain(self) -> FrameBatch:
        """See FrameSource."""
        if len(self._links) == 1:
            return self._links[0].drain()
        return _merged([link.drain() for link in self._links])

    clock_ns = staticmethod(time.monotonic_ns)

    def wait(self, timeout_s: float) -> None:
        """See FrameSource; also returns when a bus has been reopened."""
        open_now = [link.source.fileno() for link in self._links if link.source is not None]
        readable, _, _ = select.select([self._wake, *open_now], [], [], max(0.0, timeout_s))
        if self._wake in readable:
            os.eventfd_read(self._wake)

    def sink(self, channel: str, patience_s: float) -> FrameSink:
        """Return a sink on the interface `channel` as it is open now; call this again for later frames.

        Raises BusError while the interface is missing or down. `patience_s` as in PollableSource.
        """
        return self._links[self.interfaces.index(channel)].sink(patience_s)

    def close(self) -> None:
        """Close every bus and end every thread."""
        if not self._closed:
            self._closed = True
            for link in self._links:
                link.close()
            os.close(self._wake)


def _merged(batches: Sequence[FrameBatch]) -> FrameBatch:
    """Merge the batches of several interfaces in the order of time, with the interfaces numbered."""
    blocks = [batch.block if isinstance(batch, ReceivedFrames) else b"" for batch in batches]
    if kernel is not None and sum(map(len, blocks)) == ReceivedFrames.FRAME_BYTES * sum(map(len, batches)):
        return ReceivedFrames(kernel.merge(tuple(blocks)))
    numbered = [
        FrameBatch(
            batch.t_ns, batch.t_mono_ns, np.full(len(batch), at, np.uint8),
            batch.can_id, batch.dlc, batch.data, batch.flags,
        )
        for at, batch in enumerate(batches)
        if len(batch)
    ]  # fmt: skip
    together = FrameBatch.concatenate(numbered)
    if len(numbered) > 1:
        together = together[np.argsort(together.t_mono_ns, kind="stable")]
    return together
