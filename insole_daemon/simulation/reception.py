"""Simulate the reception of frames by the host: some are stamped late, some are lost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..bus.frames import FrameBatch
from ..physics.sampling import Jitter, Losses


class Reception:
    """Consecutive frames of one bus as the host receives them."""

    def __init__(self, jitter: Mapping[int, Jitter], losses: Mapping[int, Losses]) -> None:
        """`jitter` and `losses` are by address of the sending board; other boards' frames arrive at once and
        completely.
        """
        self._jitter, self._losses = jitter, losses
        self._newest_ns = -(2**63)

    def __call__(self, batch: FrameBatch) -> FrameBatch:
        """Return the received frames of `batch` in the same order, with their receive times."""
        if not (self._jitter or self._losses) or not len(batch):
            return batch
        sender = batch.can_id >> np.uint32(4) & np.uint32(0xF)
        t_ns = batch.t_ns.copy()
        is_received = np.ones(len(batch), np.bool_)
        for address, jitter in self._jitter.items():
            of_board = sender == address
            t_ns[of_board] += np.rint(jitter.draw_delays_s(int(of_board.sum())) * 1e9).astype(np.int64)
        for address, losses in self._losses.items():
            of_board = sender == address
            is_received[of_board] = ~losses.draw_losses(int(of_board.sum()))
        t_ns = np.maximum(np.maximum.accumulate(t_ns), self._newest_ns)
        self._newest_ns = int(t_ns[-1])
        received = FrameBatch(t_ns, t_ns, batch.interface, batch.can_id, batch.dlc, batch.data, batch.flags)
        return received[is_received]
