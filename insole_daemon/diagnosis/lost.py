"""Readings that were due and did not come, or came again as if they were new."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..recording.loading import FootRecording
from ..recording.read_times import OVERDUE, arrived, median_interval_ns, overdue


def lost(foot: FootRecording) -> NDArray[np.bool_]:
    """(n, n_triangles) cycles in which a new reading was due, at the interval each triangle has them, and did not come.

    A board that sends seldom, and a converter that is slower than its board, lose nothing.
    """
    t_ns = np.maximum.accumulate(foot.t_ns)
    read_ns = t_ns[:, None] - foot.behind_ns
    sent_ns, new_ns = (
        np.array([median_interval_ns(read_ns[flags, column]) for column, flags in enumerate(each.T)])
        for each in (arrived(read_ns), foot.is_new)
    )
    # What a slow converter has ready is sent with the next frame of its board.
    late_ns = np.where(new_ns > OVERDUE * sent_ns, sent_ns, 0.0)
    found: NDArray[np.bool_] = foot.missing | overdue(foot.is_new, read_ns, t_ns, late_ns)
    return found
