"""The loops of `insole record`: a bus or a daemon, and instruments, into a LiveRecorder until told to stop."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..bus.recovering import RecoveringSource
from ..bus.source import FrameSource
from ..config import Foot
from ..errors import InsoleError
from ..skin.quality import Quality
from .coverage import Item
from .guide import Guide
from .instrument import Instrument
from .live import LiveRecorder, record_of
from .quality import KEY, RecorderQuality, document

_TELL_S = 1.0
_GATHER_S = 0.01  # frames of so long are written together: waking for each would cost a core
_WAIT_S = 0.1


@dataclass(slots=True)
class Progress:
    """What a recording has so far."""

    frames: int = 0
    cycles: int = 0
    lost: int = 0  # frames the kernel dropped, or cycles that did not come over the network
    bytes: int = 0
    folders: int = 1
    seconds: float = 0.0
    instruments: tuple[Instrument, ...] = field(default=(), repr=False)
    quality: Mapping[Foot, Quality] = field(default_factory=dict, repr=False)
    covered: Mapping[Foot, tuple[Item, ...]] = field(default_factory=dict, repr=False)  # of the protocol, if guided


class Inbox:
    """What several iterators yield, in one queue; each is read in a thread of its own."""

    def __init__(self) -> None:
        """With nothing to read yet."""
        self._items: queue.SimpleQueue[tuple[Any, Any]] = queue.SimpleQueue()

    def read(self, tag: Any, items: Iterable[Any]) -> None:
        """Read `items` from now on; what it yields comes with `tag`, and an error instead of the rest."""

        def pump() -> None:
            try:
                for item in items:
                    self._items.put((tag, item))
            except Exception as error:
                self._items.put((tag, error))

        # A thread that waits on a terminal cannot be told to end, and must not hold up the process.
        threading.Thread(target=pump, name="inbox", daemon=True).start()

    def take(self, timeout_s: float) -> list[tuple[Any, Any]]:
        """All that is there, or the first thing that comes within the time."""
        found = []
        try:
            found.append(self._items.get(timeout=timeout_s) if timeout_s > 0 else self._items.get_nowait())
            while True:
                found.append(self._items.get_nowait())
        except queue.Empty:
            return found


@dataclass(slots=True)
class Session:
    """One recording at work: who ends it, and who is told how it goes."""

    recorder: LiveRecorder
    stop: threading.Event
    seconds: float | None = None
    tell: Callable[[Progress], None] = lambda progress: None
    note: Callable[[str], None] = lambda text: None  # an interface that goes, or is back
    instruments: Sequence[Instrument] = ()
    guide: Guide | None = None
    inbox: Inbox = field(default_factory=Inbox)
    _quality: RecorderQuality = field(init=False)
    _folder: Path = field(init=False)  # that the quality is of

    def __post_init__(self) -> None:
        """Count the quality from now on."""
        self._quality, self._folder = RecorderQuality(self.recorder.insoles), self.recorder.folder

    def from_bus(self, source: FrameSource) -> Progress:
        """Record every frame of `source`; what there was in the end."""
        progress, clock = self._begin()
        while not (self._over(clock) or source.exhausted):
            source.wait(_WAIT_S)
            time.sleep(_GATHER_S)
            source.receive()
            batch = source.drain()
            dropped = source.counters.overflows - progress.lost
            if dropped:
                self.recorder.note_dropped(dropped)
            self.recorder.write_frames(batch)
            self._quality.frames(batch, source.clock_ns())
            if self.guide is not None:
                self.guide.frames(batch)
            progress.frames += len(batch)
            progress.lost = source.counters.overflows
            if isinstance(source, RecoveringSource):
                for change in source.changes():
                    self.note(change.text)
            for tag, item in self.inbox.take(0):
                self._reference(tag, item)
            self._tell(progress, clock)
        return self._end(progress, clock)

    def from_daemon(self, raws: Iterable[Any]) -> Progress:
        """Record the cycles that `raws` yields (insole_daemon.connect().raws()); what there was in the end."""
        progress, clock = self._begin()
        self.inbox.read(None, raws)
        while not self._over(clock):
            for tag, item in self.inbox.take(_WAIT_S):
                if tag is not None:
                    self._reference(tag, item)
                elif isinstance(item, Exception):
                    raise item
                elif item.foot in self.recorder.feet:  # a daemon of the other foot may have come since
                    self.recorder.write_cycle(item.foot, record_of(item))
                    self._quality.cycle(item.foot, item)
                    if self.guide is not None:
                        self.guide.cycle(item.foot, item)
                    progress.cycles += 1
                    progress.lost += item.lost
            self._tell(progress, clock)
        return self._end(progress, clock)

    def _begin(self) -> tuple[Progress, list[float]]:
        now = time.monotonic()
        return Progress(instruments=tuple(self.instruments)), [now, now]

    def _over(self, clock: list[float]) -> bool:
        return self.stop.is_set() or (self.seconds is not None and time.monotonic() - clock[0] >= self.seconds)

    def _tell(self, progress: Progress, clock: list[float]) -> None:
        if time.monotonic() - clock[1] >= _TELL_S:
            clock[1] += _TELL_S
            self._count(progress, clock)
            self.tell(progress)

    def _end(self, progress: Progress, clock: list[float]) -> Progress:
        for tag, item in self.inbox.take(0):
            if tag is not None:
                self._reference(tag, item)
        self._count(progress, clock)
        return progress

    def _count(self, progress: Progress, clock: list[float]) -> None:
        if self._folder == self.recorder.folder:
            progress.quality = self._quality.of_feet()
            self.recorder.note(KEY, document(progress.quality))
        else:
            self._folder = self.recorder.folder
            self._quality.restart()
        if self.guide is not None:
            progress.covered = self.guide.covered()
            self.recorder.note("coverage", self.guide.summary(progress.covered))
        progress.bytes, progress.folders = self.recorder.size, len(self.recorder.folders)
        progress.seconds = time.monotonic() - clock[0]

    def _reference(self, instrument: Instrument, item: Any) -> None:
        """A line of text or the payload of a message, and when it arrived."""
        if isinstance(item, Exception):
            raise InsoleError(f"the reference of the {instrument.foot} foot cannot be read: {item}") from item
        received_s, said = item
        rows = (
            instrument.take_line(said, received_s) if isinstance(said, str) else instrument.take_json(said, received_s)
        )
        if rows:
            self.recorder.write_reference(instrument.foot, instrument.clock, instrument.header, rows)
            if self.guide is not None:
                self.guide.rows(instrument, rows, received_s)


def lines_of(descriptor: int) -> Iterator[str]:
    """The lines that come from a descriptor, until its end.

    Not from `sys.stdin`: its lock, held by a thread that waits, would crash the interpreter at its end.
    """
    held = b""
    while read := os.read(descriptor, 1 << 16):
        *lines, held = (held + read).split(b"\n")
        for line in lines:
            yield line.decode("utf-8", "replace")
    if held:
        yield held.decode("utf-8", "replace")


def stamped(items: Iterable[Any]) -> Iterator[tuple[float, Any]]:
    """The items with the moment each came, seconds of CLOCK_REALTIME."""
    for item in items:
        yield time.time(), item
