"""A person led through a trial: what is covered so far, told from the load as it comes, and what to do next.

The load is the reference's where it says something, else the mean pressure that the calibration makes of the counts;
with the built-in calibration that is no pressure anyone should believe, but it is high where the load is.
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
from .coverage import Item, Protocol, coverage
from .cycles import new_reader
from .document import REFERENCE_COLUMNS, Kind
from .instrument import Instrument
from .loading import as_configured

_BIN_S = 0.2  # over which a load is averaged: noise is no turn


class Guide:
    """What one recording has covered; `insoles` and `kind` are the recording's."""

    def __init__(self, insoles: Sequence[InsoleContents], kind: Kind, protocol: Protocol) -> None:
        self._kind, self._protocol = kind, protocol
        self._reader = new_reader([insole.layout for insole in insoles])
        self._gauges = {insole.foot: _Gauge(insole) for insole in insoles}
        self._loads: dict[Foot, _Load] = {insole.foot: _Load() for insole in insoles}
        self._referenced: set[Foot] = set()

    def frames(self, batch: FrameBatch) -> None:
        """Take in what came from the bus."""
        for (foot, gauge), closed in zip(self._gauges.items(), self._reader.feed(batch), strict=True):
            for cycles in closed if foot not in self._referenced else ():
                valid = gauge.validity(cycles.counts, cycles.status, cycles.age_ns)
                self._loads[foot].add(
                    np.asarray(cycles.t_mono_ns * 1e-9, np.float64), gauge.mean_pa(cycles.counts, valid)
                )

    def cycle(self, foot: Foot, raw: Any) -> None:
        """Take in a cycle that a daemon published."""
        if foot not in self._referenced:
            mean_pa = self._gauges[foot].mean_pa(raw.counts[None], raw.valid[None].astype(bool))
            self._loads[foot].add(np.array([raw.t_ns * 1e-9]), mean_pa)

    def rows(self, instrument: Instrument, rows: str, now_s: float) -> None:
        """Take in rows of reference.csv that came `now_s`."""
        if instrument.foot not in self._referenced:
            self._referenced.add(instrument.foot)
            self._loads[instrument.foot] = _Load()  # what was told from the counts is in another unit
        column = instrument.header.strip().split(",").index(REFERENCE_COLUMNS[self._kind][0])
        cells = [row.split(",")[column] for row in rows.splitlines()]
        load = np.array([float(cell) for cell in cells if cell])
        self._loads[instrument.foot].add(np.full(len(load), now_s), load)

    def covered(self) -> Mapping[Foot, tuple[Item, ...]]:
        """Every part of the protocol, for every foot."""
        return {foot: coverage(*load.series(), self._protocol) for foot, load in self._loads.items()}

    def summary(self, covered: Mapping[Foot, tuple[Item, ...]]) -> dict[str, Any]:
        """What a recording says of it: for each foot what was seen, and what is missing."""
        return {
            foot: {
                "load_from": "reference" if foot in self._referenced else "counts",
                "seen": {item.name: item.seen for item in items},
                "missing": [item.name for item in items if item.done < 1.0],
            }
            for foot, items in covered.items()
        }


class _Gauge:
    """The mean pressure that an insole's calibration makes of its counts."""

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
        """(n,) of counts and valid (n, n_triangles, 12); a cycle in which nothing is valid is left out as NaN."""
        pressure = np.where(valid & self._curve.usable, self._curve.pressure_pa(counts), 0.0)
        number = (valid & self._curve.usable).sum(axis=(1, 2))
        return np.where(number > 0, pressure.sum(axis=(1, 2)) / np.maximum(number, 1), np.nan)


class _Load:
    """A load over time, in bins."""

    def __init__(self) -> None:
        self._t_s: list[float] = []
        self._load: list[float] = []
        self._bin: list[float] = []
        self._since_s = -np.inf

    def add(self, t_s: NDArray[np.float64], load: NDArray[np.float64]) -> None:
        """Take in `load` (n,) at `t_s` (n,); NaN is left out."""
        for at, value in zip(t_s.tolist(), load.tolist(), strict=True):
            if np.isnan(value):
                continue
            if at - self._since_s >= _BIN_S:
                self._close()
                self._since_s = at
            self._bin.append(value)

    def series(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) s and (n,) loads of the bins that are full."""
        return np.array(self._t_s), np.array(self._load)

    def _close(self) -> None:
        if self._bin:
            self._t_s.append(self._since_s)
            self._load.append(sum(self._bin) / len(self._bin))
            self._bin = []
