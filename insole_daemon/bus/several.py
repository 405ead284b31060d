"""Several buses read as one, in the order of time."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from .frames import FrameBatch
from .source import BusCounters, FrameSource


class PollableSource(FrameSource, Protocol):
    """A source that can be waited for together with others."""

    def fileno(self) -> int:
        """A descriptor that is readable when frames wait."""
        ...


class SeveralSources:
    """The frames of `sources`, `interface` counted through all of them; a batch is sorted by receive time."""

    def __init__(self, sources: Sequence[PollableSource]) -> None:
        self.sources = tuple(sources)
        self.interfaces = tuple(name for source in sources for name in source.interfaces)

    @property
    def counters(self) -> BusCounters:
        """The sums over the sources."""
        total = BusCounters()
        for source in self.sources:
            total.add(source.counters)
        return total

    @property
    def exhausted(self) -> bool:
        """Whether every source is."""
        return all(source.exhausted for source in self.sources)

    def receive(self) -> int:
        """See FrameSource."""
        return sum([source.receive() for source in self.sources])

    def drain(self) -> FrameBatch:
        """See FrameSource."""
        return merged([source.drain() for source in self.sources], [len(source.interfaces) for source in self.sources])

    def clock_ns(self) -> int:
        """The monotonic clock."""
        return time.monotonic_ns()

    def wait(self, timeout_s: float) -> None:
        """See FrameSource."""
        select.select([source.fileno() for source in self.sources], [], [], max(0.0, timeout_s))

    def close(self) -> None:
        """Close every source."""
        for source in self.sources:
            source.close()


def merged(batches: Sequence[FrameBatch], widths: Sequence[int]) -> FrameBatch:
    """The batches of sources that have `widths` interfaces each as one batch, in the order of time."""
    numbered, first = [], 0
    for batch, width in zip(batches, widths, strict=True):
        if len(batch):
            numbered.append(replace(batch, interface=batch.interface + np.uint8(first)))
        first += width
    together = FrameBatch.concatenate(numbered)
    if len(numbered) > 1:
        together = together[np.argsort(together.t_mono_ns, kind="stable")]
    return together
