"""Run `insole record`: read a bus or a daemon, and reference instruments, into a LiveRecorder until stopped."""

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
from .live import LiveRecorder, cycle_record
from .quality import KEY, RecorderQuality, document

_REPORT_PERIOD_S = 1.0
_BATCH_S = 0.01  # frames that arrive within this time are written together: waking for each one would load a core
_WAIT_S = 0.1


@dataclass(slots=True)
class Progress:
    """State of a running recording."""

    frames: int = 0
    cycles: int = 0
    lost: int = 0  # frames that the kernel dropped, or cycles lost on the network
    bytes: int = 0
    folders: int = 1
    seconds: float = 0.0
    instruments: tuple[Instrument, ...] = field(default=(), repr=False)
    quality: Mapping[Foot, Quality] = field(default_factory=dict, repr=False)
    covered: Mapping[Foot, tuple[Item, ...]] = field(default_factory=dict, repr=False)  # only if guided


class MergedQueue:
    """Merges the items of several iterators into one queue; each iterator is read in its own thread."""

    def __init__(self) -> None:
        """Create an empty queue."""
        self._items: queue.SimpleQueue[tuple[Any, Any]] = queue.SimpleQueue()

    def read(self, tag: Any, items: Iterable[Any]) -> None:
        """Start reading `items`: each arrives with `tag`, and an exception arrives as the last item."""

        def pump() -> None:
            try:
                for item in items:
                    self._items.put((tag, item))
            except Exception as error:
                self._items.put((tag, error))

        # A thread that waits on a terminal cannot be interrupted, and must not keep the process alive.
        threading.Thread(target=pump, name="inbox", daemon=True).start()

    def take(self, timeout_s: float) -> list[tuple[Any, Any]]:
        """Return all waiting items, or wait up to `timeout_s` for the first one."""
        items = []
        try:
            items.append(self._items.get(timeout=timeout_s) if timeout_s > 0 else self._items.get_nowait())
            while True:
                items.append(self._items.get_nowait())
        except queue.Empty:
            return items


@dataclass(slots=True)
class Session:
    """One running recording: its recorder, when it ends, and callbacks for its progress."""

    recorder: LiveRecorder
    stop: threading.Event
    seconds: float | None = None
    report_progress: Callable[[Progress], None] = lambda progress: None
    report_change: Callable[[str], None] = lambda text: None  # called when an interface goes down or comes back
    instruments: Sequence[Instrument] = ()
    guide: Guide | None = None
    merged_queue: MergedQueue = field(default_factory=MergedQueue)
    _quality: RecorderQuality = field(init=False)
    _folder: Path = field(init=False)  # the folder whose quality is counted

    def __post_init__(self) -> None:
        """Start counting the quality."""
        self._quality, self._folder = RecorderQuality(self.recorder.insoles), self.recorder.folder

    def from_bus(self, source: FrameSource) -> Progress:
        """Record every frame of `source` until stopped, and return the final progress."""
        progress, clock = self._begin()
        while not (self._is_over(clock) or source.exhausted):
            source.wait(_WAIT_S)
            time.sleep(_BATCH_S)
            source.receive()
            batch = source.drain()
            dropped = source.counters.overflows - progress.lost
            if dropped:
                self.recorder.note_dropped(dropped)
            self.recorder.write_frames(batch)
            self._quality.add_frames(batch, source.clock_ns())
            if self.guide is not None:
                self.guide.add_frames(batch)
            progress.frames += len(batch)
            progress.lost = source.counters.overflows
            if isinstance(source, RecoveringSource):
                for change in source.changes():
                    self.report_change(change.text)
            for tag, item in self.merged_queue.take(0):
                self._write_reference(tag, item)
            self._report_if_due(progress, clock)
        return self._end(progress, clock)

    def from_daemon(self, raws: Iterable[Any]) -> Progress:
        """Record the cycles that `raws` yields (insole_daemon.connect().raws()), and return the final progress."""
        progress, clock = self._begin()
        self.merged_queue.read(None, raws)
        while not self._is_over(clock):
            for tag, item in self.merged_queue.take(_WAIT_S):
                if tag is not None:
                    self._write_reference(tag, item)
                elif isinstance(item, Exception):
                    raise item
                elif item.foot in self.recorder.feet:  # a daemon of the other foot may have started since
                    self.recorder.write_cycle(item.foot, cycle_record(item))
                    self._quality.add_cycle(item.foot, item)
                    if self.guide is not None:
                        self.guide.add_cycle(item.foot, item)
                    progress.cycles += 1
                    progress.lost += item.lost
            self._report_if_due(progress, clock)
        return self._end(progress, clock)

    def _begin(self) -> tuple[Progress, list[float]]:
        now = time.monotonic()
        return Progress(instruments=tuple(self.instruments)), [now, now]

    def _is_over(self, clock: list[float]) -> bool:
        return self.stop.is_set() or (self.seconds is not None and time.monotonic() - clock[0] >= self.seconds)

    def _report_if_due(self, progress: Progress, clock: list[float]) -> None:
        if time.monotonic() - clock[1] >= _REPORT_PERIOD_S:
            clock[1] += _REPORT_PERIOD_S
            self._update_progress(progress, clock)
            self.report_progress(progress)

    def _end(self, progress: Progress, clock: list[float]) -> Progress:
        for tag, item in self.merged_queue.take(0):
            if tag is not None:
                self._write_reference(tag, item)
        self._update_progress(progress, clock)
        return progress

    def _update_progress(self, progress: Progress, clock: list[float]) -> None:
        """Update the progress, and store quality and coverage in recording.yaml."""
        if self._folder == self.recorder.folder:
            progress.quality = self._quality.qualities()
            self.recorder.note(KEY, document(progress.quality))
        else:
            self._folder = self.recorder.folder
            self._quality.restart()
        if self.guide is not None:
            progress.covered = self.guide.coverage_by_foot()
            self.recorder.note("coverage", self.guide.summary(progress.covered))
        progress.bytes, progress.folders = self.recorder.size, len(self.recorder.folders)
        progress.seconds = time.monotonic() - clock[0]

    def _write_reference(self, instrument: Instrument, item: Any) -> None:
        """Write a reading, a line of text or a message's payload, with the time at which it arrived."""
        if isinstance(item, Exception):
            raise InsoleError(f"the reference of the {instrument.foot} foot cannot be read: {item}") from item
        received_s, reading = item
        rows = (
            instrument.take_line(reading, received_s)
            if isinstance(reading, str)
            else instrument.take_json(reading, received_s)
        )
        if rows:
            self.recorder.write_reference(instrument.foot, instrument.clock, instrument.header, rows)
            if self.guide is not None:
                self.guide.add_reference(instrument, rows, received_s)


def read_lines(descriptor: int) -> Iterator[str]:
    """Yield the lines read from a file descriptor, until its end.

    `sys.stdin` is not used: a waiting thread holds its lock, which crashes the interpreter at exit.
    """
    rest = b""
    while read := os.read(descriptor, 1 << 16):
        *lines, rest = (rest + read).split(b"\n")
        for line in lines:
            yield line.decode("utf-8", "replace")
    if rest:
        yield rest.decode("utf-8", "replace")


def with_time(items: Iterable[Any]) -> Iterator[tuple[float, Any]]:
    """Yield each item with the time it arrived, in seconds of CLOCK_REALTIME."""
    for item in items:
        yield time.time(), item
