"""Quality of a recording: counted while it is made, kept in recording.yaml, and computed where it is not there."""

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
_CLOCK_STEP_NS = 500_000_000  # the receive times of frames and the monotonic clock differ by more: a clock was set
_SILENT_NS = 250_000_000  # a pause before the end that is longer belongs to the recording


class QualityCount:
    """Cycles of one foot while they are recorded."""

    def __init__(self, boards: Iterable[Board], rate_hz: float) -> None:
        self._period_ns = period_ns_of(boards, rate_hz)
        self._began_ns = time.monotonic_ns()
        self._received = self._repeated = self._late = 0
        self._t_ns: tuple[int, int] | None = None  # receive time of the first and the newest cycle, CLOCK_REALTIME
        self._arrived_ns = (0, 0)  # the same two, monotonic

    def take(self, cycles: Cycles) -> None:
        """Count cycles that frames closed."""
        if len(cycles):
            self._count(len(cycles), int(cycles.repeated.sum()), int(cycles.late.sum()))
            self._span(int(cycles.t_mono_ns[0]), int(cycles.t_mono_ns[-1]), time.monotonic_ns())

    def take_message(self, raw: Any) -> None:
        """Count one cycle that a daemon published."""
        self._count(1, int(raw.repeated), int(raw.late))
        self._span(int(raw.t_ns), int(raw.t_ns), time.monotonic_ns())

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
        # n cycles lie n − 1 periods apart
        return Quality.over(span_ns + self._period_ns, self._period_ns, self._received, self._repeated, self._late)

    def _count(self, n: int, repeated: int, late: int) -> None:
        self._received += n - repeated
        self._repeated += repeated
        self._late += late

    def _span(self, first_ns: int, last_ns: int, arrived_ns: int) -> None:
        if self._t_ns is None:
            self._t_ns, self._arrived_ns = (first_ns, last_ns), (arrived_ns - (last_ns - first_ns), arrived_ns)
        self._t_ns, self._arrived_ns = (self._t_ns[0], last_ns), (self._arrived_ns[0], arrived_ns)


class RecorderQuality:
    """The quality of every foot of one folder while it is recorded."""

    def __init__(self, insoles: Iterable[InsoleContents]) -> None:
        self._insoles = tuple(insoles)
        self.restart()

    def restart(self) -> None:
        """Count anew: another folder has begun."""
        self._reader = new_reader([insole.layout for insole in self._insoles])
        self._counts: dict[Foot, QualityCount] = {
            insole.foot: QualityCount([as_configured(board) for board in insole.boards], Publish().rate_hz)
            for insole in self._insoles
        }

    def frames(self, batch: FrameBatch, now_ns: int) -> None:
        """Take in what came from the bus until `now_ns`, of the clock of the frames."""
        for closed in (self._reader.feed(batch), self._reader.advance(now_ns)):
            for count, portions in zip(self._counts.values(), closed, strict=True):
                for cycles in portions:
                    count.take(cycles)

    def cycle(self, foot: Foot, raw: Any) -> None:
        """Take in a cycle that a daemon published."""
        self._counts[foot].take_message(raw)

    def of_feet(self) -> dict[Foot, Quality]:
        """Return the quality of every foot up to now."""
        return {foot: count.quality() for foot, count in self._counts.items()}


def document(qualities: Mapping[Foot, Quality]) -> dict[str, Any]:
    """Return what recording.yaml says of it."""
    return {foot: quality.document() for foot, quality in qualities.items()}


def quality(recording: Recording) -> dict[Foot, Quality]:
    """Return the quality of every foot: as the recorder noted it, else computed from the cycles.

    The recorder knows of a silence at the end; the cycles alone do not.
    """
    noted = _noted(recording)
    return {foot.foot: noted.get(foot.foot) or _computed(foot) for foot in recording.feet}


def _noted(recording: Recording) -> dict[str, Quality]:
    said = yaml.safe_load((recording.folder / FILE).read_text(encoding="utf-8"))
    found = {}
    for foot, entry in ((said.get("extensions") or {}).get(KEY) or {}).items():
        try:
            found[foot] = Quality.of(entry)
        except (KeyError, TypeError, ValueError):
            continue  # another program's; extensions are read by nobody who does not know them
    return found


def _computed(foot: FootRecording) -> Quality:
    period_ns = period_ns_of(as_configured(board) for board in foot.boards)
    if not len(foot):
        return Quality(0, 0, 0, 0, 0)
    steps_ns = np.diff(foot.t_ns)
    repeated = int(foot.repeated.sum())
    # A repeated cycle carries the time of the readings it repeats: it takes up no time of its own here.
    span_ns = int(steps_ns[steps_ns > 0].sum()) + period_ns
    return Quality.over(span_ns, period_ns, len(foot) - repeated, repeated, int(foot.late.sum()))
