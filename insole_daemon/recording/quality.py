"""Quality of a recording: count it while recording, store it in recording.yaml, and compute it if it is not stored."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import yaml

from ..bus.frames import FrameBatch
from ..config import Board, Foot, Publish
from ..skin.cycles import Cycles
from ..skin.quality import Quality, period_ns_of
from .copies import InsoleContents
from .cycles import new_reader
from .document import FILE
from .loading import FootRecording, Recording, as_configured

KEY = "quality"  # under `extensions` of recording.yaml
_CLOCK_STEP_NS = (
    500_000_000  # a larger difference between receive times and the monotonic clock means that a clock was set
)
_SILENT_NS = 250_000_000  # a longer silence at the end counts as part of the recording


class QualityCount:
    """Counts the cycles of one foot while they are recorded."""

    def __init__(self, boards: Iterable[Board], rate_hz: float) -> None:
        self._period_ns = period_ns_of(boards, rate_hz)
        self._began_ns = time.monotonic_ns()
        self._received = self._repeated = self._late = 0
        self._t_ns: tuple[int, int] | None = None  # receive time of the first and the newest cycle, CLOCK_REALTIME
        self._arrived_ns = (0, 0)  # the same two, monotonic

    def add_cycles(self, cycles: Cycles) -> None:
        """Count cycles that were assembled from frames."""
        if len(cycles):
            self._add_counts(len(cycles), int(cycles.repeated.sum()), int(cycles.late.sum()))
            self._extend_span(int(cycles.t_mono_ns[0]), int(cycles.t_mono_ns[-1]), time.monotonic_ns())

    def add_message(self, message: Any) -> None:
        """Count one cycle that a daemon published."""
        self._add_counts(1, int(message.repeated), int(message.late))
        self._extend_span(int(message.t_ns), int(message.t_ns), time.monotonic_ns())

    def quality(self) -> Quality:
        """Return the quality up to now."""
        now_ns = time.monotonic_ns()
        if self._t_ns is None:
            return Quality.over(now_ns - self._began_ns, self._period_ns, 0, 0, 0)
        span_ns, arrival_ns = self._t_ns[1] - self._t_ns[0], self._arrived_ns[1] - self._arrived_ns[0]
        if abs(span_ns - arrival_ns) > _CLOCK_STEP_NS:
            span_ns = arrival_ns
        silent_ns = now_ns - self._arrived_ns[1]
        if silent_ns > _SILENT_NS:
            span_ns += silent_ns
        # n cycles span n − 1 periods
        return Quality.over(span_ns + self._period_ns, self._period_ns, self._received, self._repeated, self._late)

    def _add_counts(self, n: int, repeated: int, late: int) -> None:
        self._received += n - repeated
        self._repeated += repeated
        self._late += late

    def _extend_span(self, first_ns: int, last_ns: int, arrived_ns: int) -> None:
        if self._t_ns is None:
            self._t_ns, self._arrived_ns = (first_ns, last_ns), (arrived_ns - (last_ns - first_ns), arrived_ns)
        self._t_ns, self._arrived_ns = (self._t_ns[0], last_ns), (self._arrived_ns[0], arrived_ns)


class RecorderQuality:
    """Counts the quality of every foot for the folder that is being recorded."""

    def __init__(self, insoles: Iterable[InsoleContents]) -> None:
        self._insoles = tuple(insoles)
        self.restart()

    def restart(self) -> None:
        """Reset all counts for a new folder."""
        self._reader = new_reader([insole.layout for insole in self._insoles])
        self._counts: dict[Foot, QualityCount] = {
            insole.foot: QualityCount([as_configured(board) for board in insole.boards], Publish().rate_hz)
            for insole in self._insoles
        }

    def add_frames(self, batch: FrameBatch, now_ns: int) -> None:
        """Add the frames received from the bus until `now_ns`, on the clock of the frames."""
        for closed in (self._reader.feed(batch), self._reader.advance(now_ns)):
            for count, portions in zip(self._counts.values(), closed, strict=True):
                for cycles in portions:
                    count.add_cycles(cycles)

    def add_cycle(self, foot: Foot, raw: Any) -> None:
        """Add a cycle that a daemon published."""
        self._counts[foot].add_message(raw)

    def qualities(self) -> dict[Foot, Quality]:
        """Return the quality of every foot up to now."""
        return {foot: count.quality() for foot, count in self._counts.items()}


def document(qualities: Mapping[Foot, Quality]) -> dict[str, Any]:
    """Return the entry of recording.yaml for the qualities."""
    return {foot: quality.document() for foot, quality in qualities.items()}


def quality(recording: Recording) -> dict[Foot, Quality]:
    """Return the quality of every foot: the stored one, else one computed from the cycles.

    Only the recorder knows about silence at the end; the cycles do not show it.
    """
    stored = _stored_qualities(recording)
    return {foot.foot: stored.get(foot.foot) or _compute_quality(foot) for foot in recording.feet}


def _stored_qualities(recording: Recording) -> dict[str, Quality]:
    """Return the qualities stored in recording.yaml, by foot."""
    document_of_recording = yaml.safe_load((recording.folder / FILE).read_text(encoding="utf-8"))
    qualities = {}
    for foot, entry in ((document_of_recording.get("extensions") or {}).get(KEY) or {}).items():
        try:
            qualities[foot] = Quality.of(entry)
        except (KeyError, TypeError, ValueError):
            continue  # written by another program; unknown extensions are ignored
    return qualities


def _compute_quality(foot: FootRecording) -> Quality:
    """Compute the quality from the cycles of a foot."""
    period_ns = period_ns_of(as_configured(board) for board in foot.boards)
    if not len(foot):
        return Quality(0, 0, 0, 0, 0)
    intervals_ns = np.diff(foot.t_ns)
    repeated = int(foot.repeated.sum())
    # A repeated cycle carries the time of the readings that it repeats, so it adds no time.
    span_ns = int(intervals_ns[intervals_ns > 0].sum()) + period_ns
    return Quality.over(span_ns, period_ns, len(foot) - repeated, repeated, int(foot.late.sum()))
