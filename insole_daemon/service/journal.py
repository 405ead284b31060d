"""The daemon's log, with repeated messages counted instead of written."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

QUIET_NS = 10_000_000_000  # in which a text is written once


@dataclass(slots=True)
class _WrittenText:
    level: int
    until_ns: int  # monotonic; then it may be written again
    n_suppressed: int = 0


class Journal:
    """Writes each text at most once in QUIET_NS, and then how often it was suppressed meanwhile.

    A bus with a loose plug goes down and comes back many times a second. Subscribers get an event each time, but the
    log on the disk must not be filled.
    """

    def __init__(self, log: logging.Logger, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._log, self._clock_ns = log, clock_ns
        self._written: dict[str, _WrittenText] = {}

    def tell(self, level: int, text: str) -> None:
        """Write `text`, or count it if it was written within QUIET_NS."""
        written = self._written.get(text)
        if written is not None:
            written.n_suppressed += 1
            return
        self._log.log(level, "%s", text)
        self._written[text] = _WrittenText(level, self._clock_ns() + QUIET_NS)

    def sum_up(self) -> None:
        """Write how often texts were suppressed, for those older than QUIET_NS; call it about once a second."""
        now_ns = self._clock_ns()
        for text, written in [*self._written.items()]:
            if now_ns < written.until_ns:
                continue
            del self._written[text]
            if written.n_suppressed:
                self._written[text] = _WrittenText(written.level, now_ns + QUIET_NS)
                again = "once more" if written.n_suppressed == 1 else f"{written.n_suppressed} times more"
                self._log.log(written.level, "%s in %.0f s: %s", again, QUIET_NS * 1e-9, text)
