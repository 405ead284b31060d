"""What the daemon tells its log: nothing over and over, and how often it would have."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

QUIET_NS = 10_000_000_000  # in which the same is said once


@dataclass(slots=True)
class _Said:
    level: int
    until_ns: int  # monotonic; then it may be said again
    held_back: int = 0


class Journal:
    """Says each text at most once in QUIET_NS, and then how often it was held back meanwhile.

    A bus whose plug is loose goes down and comes back many times a second. Whoever subscribes gets an event each
    time; a log on a disk is not filled with it.
    """

    def __init__(self, log: logging.Logger, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._log, self._clock_ns = log, clock_ns
        self._said: dict[str, _Said] = {}

    def tell(self, level: int, text: str) -> None:
        """Say it, or count it where it was said a moment ago."""
        said = self._said.get(text)
        if said is not None:
            said.held_back += 1
            return
        self._log.log(level, "%s", text)
        self._said[text] = _Said(level, self._clock_ns() + QUIET_NS)

    def sum_up(self) -> None:
        """Say what was held back long enough; to be called every now and then."""
        now_ns = self._clock_ns()
        for text, said in [*self._said.items()]:
            if now_ns < said.until_ns:
                continue
            del self._said[text]
            if said.held_back:
                self._said[text] = _Said(said.level, now_ns + QUIET_NS)
                again = "once more" if said.held_back == 1 else f"{said.held_back} times more"
                self._log.log(said.level, "%s in %.0f s: %s", again, QUIET_NS * 1e-9, text)
