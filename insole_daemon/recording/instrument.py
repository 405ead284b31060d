"""A reference instrument while it talks: lines of CSV or maps of numbers into rows of reference.csv.

Without a time of its own a reading is stamped with the moment it arrived, on the clock of the frames; with one
(`time_s`), the moment of arrival follows as `received_s`, which is what the two clocks can be matched by.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping

import numpy as np

from ..config import Foot
from ..errors import FileError
from ..untrusted import parse_json
from .document import REFERENCE_COLUMNS, Clock, Kind
from .force_shoe import COLUMNS as SHOE_COLUMNS
from .force_shoe import ShoeSensors
from .reference import TIME

RECEIVED = "received_s"


class Instrument:
    """The readings of one foot's reference; `shoe` makes one wrench out of a force shoe's two sensors.

    `rows` are given out once. A reading that is none is counted in `refused`, and `why` says what was wrong with the
    last one: a recording is not ended by a bad line.
    """

    def __init__(self, foot: Foot, kind: Kind, shoe: ShoeSensors | None = None) -> None:
        if shoe is not None and shoe.foot != foot:
            raise FileError(f"expected the shoe of the {foot} foot, found that of the {shoe.foot} foot")
        self.foot, self._kind, self._shoe = foot, kind, shoe
        self._columns: tuple[str, ...] | None = None  # as they come
        self.header = ""  # of reference.csv; "" until the first reading
        self.clock: Clock = "can"
        self.readings = self.refused = 0
        self.why = ""

    def take_line(self, line: str, now_s: float) -> str:
        """The rows of reference.csv that a line of CSV gives: none for the header, which is the first line."""
        cells = [cell.strip() for cell in next(csv.reader([line]), [])]
        if not any(cells):
            return ""
        if self._columns is None:
            self._begin(tuple(cells))
            return ""
        if len(cells) != len(self._columns):
            return self._refuse(f"expected {len(self._columns)} cells, found {len(cells)}")
        try:
            values = {name: float(cell) if cell else math.nan for name, cell in zip(self._columns, cells, strict=True)}
        except ValueError as error:
            return self._refuse(str(error))
        return self._row(values, now_s)

    def take_json(self, payload: bytes, now_s: float) -> str:
        """The rows that a message gives: a JSON object of numbers by column, or null where a value is missing."""
        try:
            said = parse_json(payload)
        except ValueError as error:
            return self._refuse(f"expected a JSON object, found {payload[:40]!r} ({error})")
        if not isinstance(said, dict) or not all(
            value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in said.values()
        ):
            return self._refuse(f"expected a JSON object of numbers by column, found {payload[:40]!r}")
        if self._columns is None:
            self._begin(tuple(said))
        assert self._columns is not None
        try:
            values = {name: math.nan if said.get(name) is None else float(said[name]) for name in self._columns}
        except OverflowError as error:
            return self._refuse(str(error))
        return self._row(values, now_s)

    def _begin(self, columns: tuple[str, ...]) -> None:
        needed = SHOE_COLUMNS if self._shoe is not None else REFERENCE_COLUMNS[self._kind]
        missing = [name for name in needed if name not in columns]
        if missing or len(set(columns)) < len(columns):
            raise FileError(
                f"the reference of the {self.foot} foot: expected the columns {', '.join(needed)} (and {TIME}, if it "
                f"has a clock), each once, found {', '.join(columns)}; missing: {', '.join(missing) or 'none'}"
            )
        self._columns = columns
        self.clock = "own" if TIME in columns else "can"
        own = tuple(name for name in columns if name not in (TIME, RECEIVED))
        combined = REFERENCE_COLUMNS["shoe"] if self._shoe is not None else ()
        names = (TIME, *combined, *own) + ((RECEIVED,) if TIME in columns else ())
        self.header = ",".join(names) + "\n"

    def _row(self, values: Mapping[str, float], now_s: float) -> str:
        assert self._columns is not None
        if any(math.isinf(value) for value in values.values()) or math.isnan(values.get(TIME, 0.0)):
            return self._refuse("expected finite numbers and a time in every row")
        own = {name: value for name, value in values.items() if name not in (TIME, RECEIVED)}
        combined: dict[str, float] = {}
        if self._shoe is not None:
            wrench = self._shoe.wrench({name: np.array([values[name]]) for name in SHOE_COLUMNS})
            combined = {name: float(array[0]) for name, array in wrench.items()}
        cells = [f"{values.get(TIME, now_s):.6f}"]
        cells += ["" if math.isnan(value) else f"{value:.9g}" for value in (combined | own).values()]
        if TIME in values:
            cells.append(f"{now_s:.6f}")
        self.readings += 1
        return ",".join(cells) + "\n"

    def _refuse(self, why: str) -> str:
        self.refused += 1
        self.why = why
        return ""
