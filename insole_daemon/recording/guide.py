"""Track which phases of a trial protocol are covered while the load is recorded, to guide a person through it.

The load is that of the reference if one sends readings, else the mean pressure by the calibration. With the built-in
calibration that pressure is not accurate, but it rises and falls with the load, which is enough here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch
from ..config import Foot, Publish
from ..physics import calibration as calibrations
from ..physics import zero as zeros
from ..physics.static_curve import StaticCurve
from ..skin.validity import Validity
from .copies import InsoleContents
from .coverage import Item, Protocol, compute_coverage
from .cycles import new_reader
from .document import REFERENCE_COLUMNS, Kind
from .instrument import Instrument
from .loading import as_configured

_BIN_S = 0.2  # averaging interval, so that noise is not taken for a reversal


class Guide:
    """Coverage of the protocol by one recording with the given insoles and kind."""

    def __init__(self, insoles: Sequence[InsoleContents], kind: Kind, protocol: Protocol) -> None:
        self._kind, self._protocol = kind, protocol
        self._reader = new_reader([insole.layout for insole in insoles])
        self._mean_pressures = {insole.foot: _MeanPressure(insole) for insole in insoles}
        self._loads: dict[Foot, _BinnedLoad] = {insole.foot: _BinnedLoad() for insole in insoles}
        self._feet_with_reference: set[Foot] = set()

    def add_frames(self, batch: FrameBatch) -> None:
        """Add frames from the bus."""
        for (foot, mean_pressure), closed in zip(self._mean_pressures.items(), self._reader.feed(batch), strict=True):
            for cycles in closed if foot not in self._feet_with_reference else ():
                valid = mean_pressure.validity(cycles.counts, cycles.status, cycles.age_ns)
                self._loads[foot].add(
                    np.asarray(cycles.t_mono_ns * 1e-9, np.float64), mean_pressure.mean_pa(cycles.counts, valid)
                )

    def add_cycle(self, foot: Foot, raw: Any) -> None:
        """Add a cycle that a daemon published."""
        if foot not in self._feet_with_reference:
            mean_pa = self._mean_pressures[foot].mean_pa(raw.counts[None], raw.valid[None].astype(bool))
            self._loads[foot].add(np.array([raw.t_ns * 1e-9]), mean_pa)

    def add_reference(self, instrument: Instrument, rows: str, now_s: float) -> None:
        """Add rows of reference.csv that arrived at `now_s`."""
        if instrument.foot not in self._feet_with_reference:
            self._feet_with_reference.add(instrument.foot)
            self._loads[instrument.foot] = _BinnedLoad()  # the load from the counts has another unit
        column = instrument.header.strip().split(",").index(REFERENCE_COLUMNS[self._kind][0])
        cells = [row.split(",")[column] for row in rows.splitlines()]
        load = np.array([float(cell) for cell in cells if cell])
        self._loads[instrument.foot].add(np.full(len(load), now_s), load)

    def coverage_by_foot(self) -> Mapping[Foot, tuple[Item, ...]]:
        """Return every phase of the protocol with its coverage, by foot."""
        return {foot: compute_coverage(*load.series(), self._protocol) for foot, load in self._loads.items()}

    def summary(self, coverage_by_foot: Mapping[Foot, tuple[Item, ...]]) -> dict[str, Any]:
        """Return what recording.yaml stores: for each foot the covered and the missing phases."""
        return {
            foot: {
                "load_from": "reference" if foot in self._feet_with_reference else "counts",
                "seen": {item.name: item.seen for item in items},
                "missing": [item.name for item in items if item.done < 1.0],
            }
            for foot, items in coverage_by_foot.items()
        }


class _MeanPressure:
    """Mean pressure of an insole by its calibration."""

    def __init__(self, insole: InsoleContents) -> None:
        boards = [as_configured(board) for board in insole.boards]
        if isinstance(insole.calibration, Path):
            calibration = calibrations.load(insole.calibration, insole.layout)
        else:
            calibration = insole.calibration or calibrations.default(insole.layout, boards)
        if insole.zero is not None:
            calibration = zeros.apply(calibration, insole.zero)
        self._curve = StaticCurve(calibration, 0.0)
        self.validity = Validity(
            insole.layout, {board.address: board for board in boards}, round(Publish().stale_after_ms * 1e6)
        )

    def mean_pa(self, counts: NDArray[np.uint8], valid: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return (n,) mean pressures from counts and valid (n, n_triangles, 12); NaN if no taxel is valid."""
        pressure = np.where(valid & self._curve.usable, self._curve.pressure_pa(counts), 0.0)
        n_valid = (valid & self._curve.usable).sum(axis=(1, 2))
        return np.where(n_valid > 0, pressure.sum(axis=(1, 2)) / np.maximum(n_valid, 1), np.nan)


class _BinnedLoad:
    """A load over time, averaged in bins."""

    def __init__(self) -> None:
        self._t_s: list[float] = []
        self._load: list[float] = []
        self._bin: list[float] = []
        self._bin_start_s = -np.inf

    def add(self, t_s: NDArray[np.float64], load: NDArray[np.float64]) -> None:
        """Add `load` (n,) at times `t_s` (n,); NaN is ignored."""
        for time_s, value in zip(t_s.tolist(), load.tolist(), strict=True):
            if np.isnan(value):
                continue
            if time_s - self._bin_start_s >= _BIN_S:
                self._close()
                self._bin_start_s = time_s
            self._bin.append(value)

    def series(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times in s (n,) and mean loads (n,) of the complete bins."""
        return np.array(self._t_s), np.array(self._load)

    def _close(self) -> None:
        if self._bin:
            self._t_s.append(self._bin_start_s)
            self._load.append(sum(self._bin) / len(self._bin))
            self._bin = []
