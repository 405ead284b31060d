"""The gate: the only way by which the daemon sends to boards, if its configuration allows it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import BusError
from .frames import FrameBatch
from .rules import not_sent, refusal
from .sink import FrameSink


class Gate:
    """Sends to one interface, if `configure` (`boards.configure` of the configuration) is true."""

    def __init__(self, sink: Callable[[], FrameSink] | None, configure: bool) -> None:
        """`sink` is called for every frame, because an interface may disappear and return; None: no interface."""
        self.sent = self.refused = 0
        self._sink, self._configure = sink, configure

    def check_open(self) -> None:
        """Raise BusError if even an allowed frame could not be sent."""
        self._open_sink()

    def send(self, can_id: int, payload: bytes, flags: int = 0) -> None:
        """Send one frame; raises BusError if it is not allowed, or if the interface does not take it."""
        why = refusal(can_id, payload, flags)
        try:
            if why is not None:
                raise not_sent(can_id, payload, why)
            self._open_sink().send(_batch(can_id, payload))
        except BusError:
            self.refused += 1
            raise
        self.sent += 1

    def _open_sink(self) -> FrameSink:
        if not self._configure:
            raise BusError(
                "nothing is sent to the boards: the daemon's configuration does not say 'boards: {configure: true}'. "
                "Set it and start the daemon again"
            )
        if self._sink is None:
            raise BusError("nothing is sent to the boards: this daemon does not read a bus that can be sent to")
        return self._sink()


def _batch(can_id: int, payload: bytes) -> FrameBatch:
    zero = np.zeros(1, np.int64)
    nothing = np.zeros(1, np.uint8)
    data = np.zeros((1, 8), np.uint8)
    data[0, : len(payload)] = list(payload)
    return FrameBatch(
        zero, zero, nothing, np.array([can_id], np.uint32), np.array([len(payload)], np.uint8), data, nothing
    )
