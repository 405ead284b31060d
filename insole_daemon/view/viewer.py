"""The message queue of one browser behind a WebSocket: the newest cycles, as fast as the link permits.

The page acknowledges every message. A window limits the unacknowledged messages: it grows with every acknowledgement
and is halved when one takes much longer than the fastest. A slow link therefore builds up no queue; its viewer gets
fewer cycles, never older ones. Texts (health, events) are kept; if the window is full, the newest cycle of each foot
replaces the waiting one.
"""

from __future__ import annotations

import asyncio
from collections import deque
from time import monotonic

_LARGEST = 64  # unacknowledged messages: half a second of both feet
_FIRST = 4
_SLACK_S = 0.1  # an acknowledgement this much later than the fastest has waited in a queue
_WORDS = 200


class Window:
    """The permitted number of unacknowledged messages, from the time of the acknowledgements."""

    def __init__(self) -> None:
        self._sent_s: deque[float] = deque()
        self._size, self._fastest_s, self._halved_s = float(_FIRST), float("inf"), 0.0

    @property
    def room(self) -> float:
        """Number of further messages that may be sent; less than 1: none."""
        return self._size - len(self._sent_s)

    def sent(self, now_s: float) -> None:
        """Record a sent message."""
        self._sent_s.append(now_s)

    def answered(self, now_s: float) -> None:
        """Record the acknowledgement of the oldest message; ignore it if none is outstanding."""
        if not self._sent_s:
            return
        sent_s = self._sent_s.popleft()
        took_s = now_s - sent_s
        self._fastest_s = min(self._fastest_s, took_s)
        if took_s <= self._fastest_s + _SLACK_S:
            self._size = min(self._size + 1.0, _LARGEST)
        elif sent_s >= self._halved_s:  # messages sent before the last halving do not count
            self._size, self._halved_s = max(self._size / 2, 1.0), now_s


class Viewer:
    """The waiting messages of one browser."""

    def __init__(self) -> None:
        self._words: deque[str] = deque(maxlen=_WORDS)
        self._cycles: deque[tuple[int, bytes]] = deque()  # of which foot
        self._window = Window()
        self._changed = asyncio.Event()

    def queue_text(self, words: str) -> None:
        """Queue a text; texts are sent before cycles."""
        self._words.append(words)
        self._changed.set()

    def queue_cycle(self, foot: int, packet: bytes) -> None:
        """Queue a cycle; if the link is busy, it replaces the waiting one of the same foot."""
        if self._window.room <= len(self._cycles):
            self._cycles = deque(waiting for waiting in self._cycles if waiting[0] != foot)
        self._cycles.append((foot, packet))
        self._changed.set()

    def answered(self) -> None:
        """Record that the browser acknowledged a message."""
        self._window.answered(monotonic())
        self._changed.set()

    def take(self) -> str | bytes | None:
        """Return the message to send now, or None if none waits or the window is full."""
        if self._window.room < 1 or not (self._words or self._cycles):
            return None
        self._window.sent(monotonic())
        return self._words.popleft() if self._words else self._cycles.popleft()[1]

    async def next(self) -> str | bytes:
        """Wait for a message and for the link, and return the message to send."""
        while (message := self.take()) is None:
            self._changed.clear()
            await self._changed.wait()
        return message
