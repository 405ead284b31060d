"""A recording's frames into the cycles of its feet: by the assembler that reads live, portion by portion.

A cycle is due when the fastest board of its foot has sent again: what the frames show, whatever the board was told.
Boards that send every 20 ms are read as the daemon does live.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bus.candump import CandumpReader, LogCounters
from ..config import Publish
from ..skin.cycles import CycleAssembler, Cycles
from ..skin.layout import Layout
from ..skin.reader import SkinReader
from ..skin.streams import Streams
from .read_times import median_interval_ns

SHOWN_NS = 60_000_000_000  # of the log, that show how often its boards send
SAME_PERIOD = 0.1  # by less a period is what it was set to


def new_reader(layouts: Sequence[Layout]) -> SkinReader:
    """With the daemon's defaults for the period and the slack of a cycle."""
    publish = Publish()
    return SkinReader(layouts, round(1e9 / publish.rate_hz), round(publish.slack_ms * 1e6))


def read_log(
    path: Path, layouts: Sequence[Layout], progress: Callable[[float], None] = lambda share: None
) -> tuple[list[Cycles], LogCounters, tuple[str, ...]]:
    """The cycles of every layout, what the log holds, and a sentence for each oddity; LogError where it is none.

    `progress` is told the share that has been read.
    """
    if path.exists() and not path.stat().st_size:  # its recorder was killed before the first frame
        return [Cycles.concatenate([], len(layout)) for layout in layouts], LogCounters(), (f"{path}: no frame in it",)
    streams, assemblers = Streams(layouts), _assemblers(path, layouts)
    closed: list[list[Cycles]] = [[] for _ in layouts]
    end_ns = 0
    with CandumpReader(path) as reader:
        for batch in reader.pieces():
            slots = streams.slots(batch)
            for own, assembler in zip(closed, assemblers, strict=True):
                own += assembler.feed(slots, batch.data, batch.t_ns, batch.t_mono_ns)
            end_ns = int(batch.t_mono_ns[-1])
            progress(reader.fraction_read)
        counters, warnings = reader.counters, reader.warnings
    for own, assembler in zip(closed, assemblers, strict=True):  # what the log leaves open at its end
        own += assembler.advance(end_ns)
    refused = streams.refused
    for address, count in sorted(refused.unconfigured_board.items()):
        warnings += (f"{path}: {count} skin frames of board {address}, which recording.yaml does not list",)
    if refused.unconfigured_triangle:
        warnings += (f"{path}: {refused.unconfigured_triangle} frames of triangles that are not in the layout",)
    whole = [Cycles.concatenate(own, len(layout)) for own, layout in zip(closed, layouts, strict=True)]
    for layout, every in zip(layouts, whole, strict=True):
        never: list[bool] = np.all(every.age_ns < 0, axis=0).tolist()
        silent = [identity for identity, yes in zip(layout.identities.tolist(), never, strict=True) if yes]
        if silent:
            names = ", ".join(f"{board}.{triangle}" for board, triangle in silent)
            warnings += (f"{path}: never sent by the {layout.foot} foot (board.triangle): {names}",)
    return whole, counters, warnings


def _assemblers(path: Path, layouts: Sequence[Layout]) -> list[CycleAssembler]:
    """One for each layout, with the period of its fastest board."""
    publish, found, first_slot = Publish(), [], 0
    intervals_ns = _intervals_ns(path, layouts)
    slack_ns = round(publish.slack_ms * 1e6)
    for layout in layouts:
        end = first_slot + 2 * len(layout)
        own = intervals_ns[first_slot:end]
        period_ns = usual_ns = round(1e9 / publish.rate_hz)
        boards = np.repeat(layout.identities[:, 0], 2)
        shown = [np.median(each) for board in np.unique(boards) if (each := own[(boards == board) & (own > 0)]).size]
        if shown and abs(min(shown) - usual_ns) > SAME_PERIOD * usual_ns:
            period_ns = round(float(min(shown)))
        found.append(CycleAssembler(layout.identities[:, 0], period_ns, min(slack_ns, period_ns // 2), first_slot))
        first_slot = end
    return found


def _intervals_ns(path: Path, layouts: Sequence[Layout]) -> NDArray[np.float64]:
    """(2 · triangles of all layouts,) median time between two arrivals of each half; NaN where it came too seldom."""
    streams, slots, times = Streams(layouts), [], []
    with CandumpReader(path) as reader:
        for batch in reader.pieces():
            slots.append(streams.slots(batch))
            times.append(batch.t_mono_ns)
            if times[-1][-1] - times[0][0] > SHOWN_NS:
                break
    slot, t_mono_ns = np.concatenate(slots), np.concatenate(times)
    n = 2 * sum(len(layout) for layout in layouts)
    return np.array([median_interval_ns(t_mono_ns[slot == each]) for each in range(n)])


def age_ns_of(age_ms: NDArray[np.float32]) -> NDArray[np.int64]:
    """Ages as Cycles have them, ns and -1 for never, of ages as messages have them, ms and NaN."""
    return np.where(np.isnan(age_ms), -1, np.rint(np.nan_to_num(age_ms).astype(np.float64) * 1e6)).astype(np.int64)
