"""Error frames of the CAN driver, counted by kind.

An error frame carries no message: its identifier has a bit for each class of error (linux/can/error.h).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from .frames import ERROR, FrameBatch

KINDS: Final = {
    0x001: "tx_timeout",  # the controller could not get rid of a frame
    0x002: "lost_arbitration",
    0x004: "controller",  # its buffers overflowed, or its error counters reached a limit
    0x008: "protocol",  # a violation: bit, form, stuff or CRC error
    0x010: "transceiver",  # a wire is open or shorted
    0x020: "no_ack",  # nobody else on the bus acknowledged a frame
    0x040: "bus_off",  # the controller has left the bus
    0x080: "bus_error",
    0x100: "restarted",  # the controller is back after bus_off
    0x200: "error_counters",  # the frame tells the controller's error counters
}
OTHER: Final = "other"  # no bit that is known here


def count_kinds(batch: FrameBatch, error_frames: dict[str, int]) -> None:
    """Add the error frames of `batch` to the counts by kind; a frame may count for several kinds."""
    error = (batch.flags & ERROR) != 0
    if not error.any():
        return
    classes = batch.can_id[error]
    for bit, kind in KINDS.items():
        count = int(np.count_nonzero(classes & np.uint32(bit)))
        if count:
            error_frames[kind] = error_frames.get(kind, 0) + count
    known = np.uint32(sum(KINDS))
    unknown = int(np.count_nonzero((classes & known) == 0))
    if unknown:
        error_frames[OTHER] = error_frames.get(OTHER, 0) + unknown
