"""What becomes of frames on the way from the bus to who stamps them: some come late, some never."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..bus.frames import FrameBatch
from ..physics.sampling import Jitter, Losses


class Reception:
    """Consecutive frames of one bus, as they are received."""

    def __init__(self, jitter: Mapping[int, Jitter], losses: Mapping[int, Losses]) -> None:
        """By address of the board that sends; of the others every frame comes, and at once."""
        self._jitter, self._losses = jitter, losses
        self._newest_ns = -(2**63)

    def __call__(self, batch: FrameBatch) -> FrameBatch:
        """What is received of `batch`, in the same order, with the stamps it gets."""
        if not (self._jitter or self._losses) or not len(batch):
            return batch
        sender = batch.can_id >> np.uint32(4) & np.uint32(0xF)
        t_ns = batch.t_ns.copy()
        comes = np.ones(len(batch), np.bool_)
        for address, jitter in self._jitter.items():
            mine = sender == address
            t_ns[mine] += np.rint(jitter.late_s(int(mine.sum())) * 1e9).astype(np.int64)
        for address, losses in self._losses.items():
            mine = sender == address
            comes[mine] = ~losses.next(int(mine.sum()))
        t_ns = np.maximum(np.maximum.accumulate(t_ns), self._newest_ns)
        self._newest_ns = int(t_ns[-1])
        received = FrameBatch(t_ns, t_ns, batch.interface, batch.can_id, batch.dlc, batch.data, batch.flags)
        return received[comes]
