"""Quality of recorded or live data: the share of the cycles due that brought new readings, and a verdict on it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from ..config import Board, Publish

Verdict = Literal["good", "usable", "not usable"]

GOOD_SHARE, USABLE_SHARE = 0.99, 0.95
WINDOW_S = 10  # of live data: the period of the verdict in health
_EDGE_CYCLES = 1  # one cycle may cross the edge of a stretch of time; it does not count as missing


@dataclass(frozen=True, slots=True)
class Quality:
    """Counts of cycles of one foot."""

    expected: int  # due by the clock
    received: int  # with new readings
    skipped: int  # neither received nor repeated
    repeated: int  # published although nothing had arrived
    late: int  # of those received: closed by time, with halves missing

    @classmethod
    def over(cls, span_ns: int, period_ns: int, received: int, repeated: int, late: int) -> Quality:
        """Return the quality of `span_ns` in which a cycle was due every `period_ns`."""
        expected = round(span_ns / period_ns)
        if abs(expected - received - repeated) <= _EDGE_CYCLES:
            expected = received + repeated
        expected = max(expected, received)  # a delayed frame splits one cycle into two
        return cls(expected, received, max(0, expected - received - repeated), repeated, late)

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Quality:
        """Return the quality in `document`, the inverse of `document()`; raises KeyError, TypeError or ValueError."""
        return cls(*(int(document[name]) for name in cls.__slots__))

    @property
    def share(self) -> float:
        """Received cycles per expected one, at most 1; 0 where none was expected."""
        return min(1.0, self.received / self.expected) if self.expected else 0.0

    @property
    def verdict(self) -> Verdict:
        """`good` from a share of 0.99 on, `usable` from 0.95 on."""
        return "good" if self.share >= GOOD_SHARE else "usable" if self.share >= USABLE_SHARE else "not usable"

    @property
    def sentence(self) -> str:
        """The verdict with its reason."""
        if not self.expected:
            return f"{self.verdict}: no cycle"
        counts = {"skipped": self.skipped, "repeated": self.repeated, "late": self.late}
        reasons = "".join(f", {count} {name}" for name, count in counts.items() if count)
        return f"{self.verdict}: {self.received} of {self.expected} cycles ({self.percent} %){reasons}"

    @property
    def percent(self) -> str:
        """The share in percent, rounded down, so that 100.0 means all."""
        return f"{int(self.share * 1000) / 10:.1f}"

    def document(self) -> dict[str, Any]:
        """Return the map that recording.yaml and `health` carry."""
        return {**asdict(self), "share": round(self.share, 4), "verdict": self.verdict}


def period_ns_of(boards: Iterable[Board], rate_hz: float = Publish().rate_hz) -> int:
    """Return the time between two cycles with new readings: boards may send less often than is published."""
    fastest_ms = min((board.period_ms for board in boards), default=0)
    return max(round(1e9 / rate_hz), fastest_ms * 1_000_000)


class QualityWindow:
    """Counts the cycles of one foot as they are published; the verdict is on the last WINDOW_S seconds."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._received = self._repeated = self._late = 0
        self._past: deque[tuple[int, int, int, int]] = deque(maxlen=WINDOW_S + 1)

    def count(self, late: bool, repeated: bool) -> None:
        """Count one published cycle."""
        if not self._past:
            self._past.append((time.monotonic_ns(), 0, 0, 0))
        if repeated:
            self._repeated += 1
        else:
            self._received += 1
            self._late += late

    def report(self, now_ns: int) -> Quality:
        """Return the quality up to `now_ns`, monotonic; to be called once a second."""
        if not self._past:
            return Quality(0, 0, 0, 0, 0)
        self._past.append((now_ns, self._received, self._repeated, self._late))
        then_ns, received, repeated, late = self._past[0]
        return Quality.over(
            now_ns - then_ns, self._period_ns, self._received - received, self._repeated - repeated, self._late - late
        )
