"""A recording's frames into the cycles of its feet: by the SkinReader that reads live, portion by portion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bus.candump import CandumpReader, LogCounters
from ..config import Publish
from ..skin.cycles import Cycles
from ..skin.layout import Layout
from ..skin.reader import SkinReader


def new_reader(layouts: Sequence[Layout]) -> SkinReader:
    """With the daemon's defaults for the period and the slack of a cycle."""
    publish = Publish()
    return SkinReader(layouts, round(1e9 / publish.rate_hz), round(publish.slack_ms * 1e6))


def read_log(path: Path, layouts: Sequence[Layout]) -> tuple[list[Cycles], LogCounters, tuple[str, ...]]:
    """The cycles of every layout, what the log holds, and a sentence for each oddity; LogError where it is none."""
    if path.exists() and not path.stat().st_size:  # its recorder was killed before the first frame
        return [Cycles.concatenate([], len(layout)) for layout in layouts], LogCounters(), (f"{path}: no frame in it",)
    skin = new_reader(layouts)
    closed: list[list[Cycles]] = [[] for _ in layouts]
    end_ns = 0
    with CandumpReader(path) as reader:
        for batch in reader.pieces():
            for own, cycles in zip(closed, skin.feed(batch), strict=True):
                own += cycles
            end_ns = int(batch.t_mono_ns[-1])
        counters, warnings = reader.counters, reader.warnings
    for own, cycles in zip(closed, skin.advance(end_ns), strict=True):  # what the log leaves open at its end
        own += cycles
    refused = skin.streams.refused
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


def age_ns_of(age_ms: NDArray[np.float32]) -> NDArray[np.int64]:
    """Ages as Cycles have them, ns and -1 for never, of ages as messages have them, ms and NaN."""
    return np.where(np.isnan(age_ms), -1, np.rint(np.nan_to_num(age_ms).astype(np.float64) * 1e6)).astype(np.int64)
