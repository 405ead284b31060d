"""Derive the messages that a daemon would have published during a recording: health once a second, and board events.

Uses the cycles alone, so it works for any recording; the words are those of the messages.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from ..config import Publish
from .loading import FootRecording

_SECOND_NS = 1_000_000_000


def derive_health(foot: FootRecording) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield (t_ns, health) at the end of every second of the recording."""
    if not len(foot):
        return
    board = foot.layout.identities[:, 0]
    changed = np.zeros(foot.counts.shape[:2], np.bool_)
    changed[1:] = (foot.counts[1:] != foot.counts[:-1]).any(axis=2)
    second = (foot.t_ns - foot.t_ns[0]) // _SECOND_NS
    edges = [0, *(np.flatnonzero(np.diff(second)) + 1).tolist(), len(foot)]
    for first, end in pairwise(edges):
        rows = slice(first, end)
        spans_s = max(int(foot.t_ns[end - 1] - foot.t_ns[max(0, first - 1)]), 1) * 1e-9
        boards = []
        for address in dict.fromkeys(board.tolist()):
            of_board = board == address
            age_ns = int(foot.age_ns[end - 1, of_board].max())
            boards.append(
                {
                    "address": address,
                    "state": _board_state(age_ns),
                    "change_rate_hz": round(float(changed[rows][:, of_board].sum(axis=0).max()) / spans_s, 2),
                    "missing": int(foot.missing[rows][:, of_board].sum()),
                }
            )
        streaming = [entry["state"] == "streaming" for entry in boards]
        yield (
            int(foot.t_ns[end - 1]),
            {
                "state": "ok" if all(streaming) else "degraded" if any(streaming) else "no data",
                "publish_rate_hz": round((end - max(1, first)) / spans_s, 2),
                "late": int(foot.late[rows].sum()),
                "repeated": int(foot.repeated[rows].sum()),
                "valid_fraction": round(float(foot.valid[end - 1].sum()) / (10 * len(foot.layout)), 4),
                "boards": boards,
            },
        )


def derive_events(foot: FootRecording) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield (t_ns, event) for every board that began to send or fell silent, in order of time."""
    board = foot.layout.identities[:, 0]
    dated_events = []
    for address in dict.fromkeys(board.tolist()):
        age_ns = foot.age_ns[:, board == address].max(axis=1, initial=-1)
        states = np.select([age_ns < 0, age_ns > Publish().stale_after_ms * 1e6], [0, 2], 1)
        before = "never seen"
        for row in [0, *(np.flatnonzero(np.diff(states)) + 1).tolist()] if len(states) else []:
            state = _board_state(int(age_ns[row]))
            if state != before:
                kind = {"streaming": "board_streaming", "silent": "board_silent"}.get(state, "board_never_seen")
                text = f"board {address}: {before} → {state}"
                dated_events.append((int(foot.t_ns[row]), {"kind": kind, "text": text, "boards": [address]}))
            before = state
    yield from sorted(dated_events, key=lambda event: event[0])


def _board_state(age_ns: int) -> str:
    if age_ns < 0:
        return "never seen"
    return "silent" if age_ns > Publish().stale_after_ms * 1e6 else "streaming"
