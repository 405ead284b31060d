"""Assemble the frames of a recording into cycles, with the assembler of the live path, batch by batch.

A cycle is due when the fastest board of its foot has sent again, as the frames show, whatever period the board was
configured with. Boards that send every 20 ms are read exactly as by the daemon.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bus.candump import CandumpReader, LogCounters
from ..config import Publish
from ..skin.assembler import CycleAssembler
from ..skin.cycles import Cycles
from ..skin.layout import Layout
from ..skin.reader import SkinReader
from ..skin.streams import Streams
from .read_times import median_interval_ns

PERIOD_SAMPLE_NS = 60_000_000_000  # duration of the log's beginning from which the boards' periods are measured
SAME_PERIOD = 0.1  # relative difference up to which a measured period counts as the configured one


def new_reader(layouts: Sequence[Layout]) -> SkinReader:
    """Return a reader with the daemon's default period and slack of a cycle."""
    publish = Publish()
    return SkinReader(layouts, round(1e9 / publish.rate_hz), round(publish.slack_ms * 1e6))


def read_log(
    path: Path, layouts: Sequence[Layout], progress: Callable[[float], None] = lambda share: None
) -> tuple[list[Cycles], LogCounters, tuple[str, ...]]:
    """Read the cycles of every layout; return them with the log's counters and a sentence for each irregularity.

    `progress` is called with the fraction read. Raises LogError if the file is no candump log.
    """
    if path.exists() and not path.stat().st_size:  # the recorder was killed before the first frame
        return [Cycles.concatenate([], len(layout)) for layout in layouts], LogCounters(), (f"{path}: no frame in it",)
    streams, assemblers = Streams(layouts), _build_assemblers(path, layouts)
    closed: list[list[Cycles]] = [[] for _ in layouts]
    end_ns = 0
    with CandumpReader(path) as reader:
        for batch in reader.pieces():
            slots = streams.slots(batch)
            for foot_cycles, assembler in zip(closed, assemblers, strict=True):
                foot_cycles += assembler.feed(slots, batch.data, batch.t_ns, batch.t_mono_ns)
            end_ns = int(batch.t_mono_ns[-1])
            progress(reader.fraction_read)
        counters, warnings = reader.counters, reader.warnings
    for foot_cycles, assembler in zip(closed, assemblers, strict=True):  # cycles that are open at the end of the log
        foot_cycles += assembler.advance(end_ns)
    refused = streams.refused
    for address, count in sorted(refused.unconfigured_board.items()):
        warnings += (f"{path}: {count} skin frames of board {address}, which recording.yaml does not list",)
    if refused.unconfigured_triangle:
        warnings += (f"{path}: {refused.unconfigured_triangle} frames of triangles that are not in the layout",)
    cycles = [Cycles.concatenate(foot_cycles, len(layout)) for foot_cycles, layout in zip(closed, layouts, strict=True)]
    for layout, cycles_of_foot in zip(layouts, cycles, strict=True):
        is_silent: list[bool] = np.all(cycles_of_foot.age_ns < 0, axis=0).tolist()
        silent = [
            identity
            for identity, is_silent_triangle in zip(layout.identities.tolist(), is_silent, strict=True)
            if is_silent_triangle
        ]
        if silent:
            names = ", ".join(f"{board}.{triangle}" for board, triangle in silent)
            warnings += (f"{path}: never sent by the {layout.foot} foot (board.triangle): {names}",)
    return cycles, counters, warnings


def _build_assemblers(path: Path, layouts: Sequence[Layout]) -> list[CycleAssembler]:
    """Build one assembler per layout, with the period of its fastest board."""
    publish, assemblers, first_slot = Publish(), [], 0
    intervals_ns = _half_intervals_ns(path, layouts)
    slack_ns = round(publish.slack_ms * 1e6)
    for layout in layouts:
        end = first_slot + 2 * len(layout)
        foot_intervals_ns = intervals_ns[first_slot:end]
        period_ns = usual_ns = round(1e9 / publish.rate_hz)
        boards = np.repeat(layout.identities[:, 0], 2)
        board_intervals_ns = [
            np.median(sent_ns)
            for board in np.unique(boards)
            if (sent_ns := foot_intervals_ns[(boards == board) & (foot_intervals_ns > 0)]).size
        ]
        if board_intervals_ns and abs(min(board_intervals_ns) - usual_ns) > SAME_PERIOD * usual_ns:
            period_ns = round(float(min(board_intervals_ns)))
        assemblers.append(CycleAssembler(layout.identities[:, 0], period_ns, min(slack_ns, period_ns // 2), first_slot))
        first_slot = end
    return assemblers


def _half_intervals_ns(path: Path, layouts: Sequence[Layout]) -> NDArray[np.float64]:
    """Return (2 · triangles of all layouts,) the median interval between arrivals of each half; NaN if too few."""
    streams, slots, times = Streams(layouts), [], []
    with CandumpReader(path) as reader:
        for batch in reader.pieces():
            slots.append(streams.slots(batch))
            times.append(batch.t_mono_ns)
            if times[-1][-1] - times[0][0] > PERIOD_SAMPLE_NS:
                break
    slot, t_mono_ns = np.concatenate(slots), np.concatenate(times)
    n = 2 * sum(len(layout) for layout in layouts)
    return np.array([median_interval_ns(t_mono_ns[slot == half]) for half in range(n)])


def age_ns_from_ms(age_ms: NDArray[np.float32]) -> NDArray[np.int64]:
    """Convert ages in ms with NaN for never, as in messages, to ns with -1 for never, as in Cycles."""
    return np.where(np.isnan(age_ms), -1, np.rint(np.nan_to_num(age_ms).astype(np.float64) * 1e6)).astype(np.int64)
