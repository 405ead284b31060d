"""One browser at the other end of a WebSocket: the newest there is, as fast as it takes it.

The page answers every message it got. What is under way is bounded by a window that grows with every answer and is
halved when one takes much longer than the fastest did: so a queue never builds up on a slow link, on which a viewer
gets fewer cycles and never older ones. Words (health, events) are kept for it, cycles are not: where the window has no
room, the newest of each foot replaces the one that waits.
"""

from __future__ import annotations

import asyncio
from collections import deque
from time import monotonic

_LARGEST = 64  # messages under way: half a second of both feet
_FIRST = 4
_SLACK_S = 0.1  # an answer that much later than the fastest has waited in a queue
_WORDS = 200


class Window:
    """How many messages may be under way, from how long the answers take."""

    def __init__(self) -> None:
        self._sent_s: deque[float] = deque()
        self._size, self._fastest_s, self._halved_s = float(_FIRST), float("inf"), 0.0

    @property
    def room(self) -> float:
        """How many more may be sent; less than 1: none."""
        return self._size - len(self._sent_s)

    def sent(self, now_s: float) -> None:
        """One has gone."""
        self._sent_s.append(now_s)

    def answered(self, now_s: float) -> None:
        """The oldest has arrived; answers to nothing are passed over."""
        if not self._sent_s:
            return
        sent_s = self._sent_s.popleft()
        took_s = now_s - sent_s
        self._fastest_s = min(self._fastest_s, took_s)
        if took_s <= self._fastest_s + _SLACK_S:
            self._size = min(self._size + 1.0, _LARGEST)
        elif sent_s >= self._halved_s:  # of what was sent before it was halved, nothing more can be learned
            self._size, self._halved_s = max(self._size / 2, 1.0), now_s


class Viewer:
    """What waits for one browser."""

    def __init__(self) -> None:
        self._words: deque[str] = deque(maxlen=_WORDS)
        self._cycles: deque[tuple[int, bytes]] = deque()  # of which foot
        self._window = Window()
        self._changed = asyncio.Event()

    def say(self, words: str) -> None:
        """Have a text sent, before any cycle."""
        self._words.append(words)
        self._changed.set()

    def show(self, foot: int, packet: bytes) -> None:
        """Have a cycle sent, unless the link is busy until a newer one of the same foot comes."""
        if self._window.room <= len(self._cycles):
            self._cycles = deque(each for each in self._cycles if each[0] != foot)
        self._cycles.append((foot, packet))
        self._changed.set()

    def answered(self) -> None:
        """The browser has got a message."""
        self._window.answered(monotonic())
        self._changed.set()

    def take(self) -> str | bytes | None:
        """What is to be sent now, None where nothing waits or enough is under way."""
        if self._window.room < 1 or not (self._words or self._cycles):
            return None
        self._window.sent(monotonic())
        return self._words.popleft() if self._words else self._cycles.popleft()[1]

    async def next(self) -> str | bytes:
        """The same; waits for something, and for the link."""
        while (message := self.take()) is None:
            self._changed.clear()
            await self._changed.wait()
        return message
