"""Convert the messages of a reference instrument, CSV lines or JSON objects, into rows of reference.csv.

A reading without a time is stamped with its time of arrival, on the clock of the frames. A reading with a time
(`time_s`) keeps it, and the time of arrival follows as `received_s`, which allows the two clocks to be matched.
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
    """Readings of one foot's reference; `shoe` combines the two sensors of a force shoe into one wrench.

    Every row is returned once. A bad reading does not end a recording: it is counted in `refused`, and `why` has the
    reason of the last one.
    """

    def __init__(self, foot: Foot, kind: Kind, shoe: ShoeSensors | None = None) -> None:
        if shoe is not None and shoe.foot != foot:
            raise FileError(f"expected the shoe of the {foot} foot, found that of the {shoe.foot} foot")
        self.foot, self._kind, self._shoe = foot, kind, shoe
        self._columns: tuple[str, ...] | None = None  # in the order of the instrument
        self.header = ""  # of reference.csv; "" until the first reading
        self.clock: Clock = "can"
        self.readings = self.refused = 0
        self.refusal = ""

    def take_line(self, line: str, now_s: float) -> str:
        """Return the rows of reference.csv for a line of CSV; none for the first line, which is the header."""
        cells = [cell.strip() for cell in next(csv.reader([line]), [])]
        if not any(cells):
            return ""
        if self._columns is None:
            self._set_columns(tuple(cells))
            return ""
        if len(cells) != len(self._columns):
            return self._refuse(f"expected {len(self._columns)} cells, found {len(cells)}")
        try:
            values = {name: float(cell) if cell else math.nan for name, cell in zip(self._columns, cells, strict=True)}
        except ValueError as error:
            return self._refuse(str(error))
        return self._format_row(values, now_s)

    def take_json(self, payload: bytes, now_s: float) -> str:
        """Return the rows for a message: a JSON object of numbers by column, or null where a value is missing."""
        try:
            message = parse_json(payload)
        except ValueError as error:
            return self._refuse(f"expected a JSON object, found {payload[:40]!r} ({error})")
        if not isinstance(message, dict) or not all(
            value is None or (isinstance(value, int | float) and not isinstance(value, bool))
            for value in message.values()
        ):
            return self._refuse(f"expected a JSON object of numbers by column, found {payload[:40]!r}")
        if self._columns is None:
            self._set_columns(tuple(message))
        assert self._columns is not None
        try:
            values = {name: math.nan if message.get(name) is None else float(message[name]) for name in self._columns}
        except OverflowError as error:
            return self._refuse(str(error))
        return self._format_row(values, now_s)

    def _set_columns(self, columns: tuple[str, ...]) -> None:
        """Set the columns and the header of reference.csv; FileError if a needed column is missing."""
        needed = SHOE_COLUMNS if self._shoe is not None else REFERENCE_COLUMNS[self._kind]
        missing = [name for name in needed if name not in columns]
        if missing or len(set(columns)) < len(columns):
            raise FileError(
                f"the reference of the {self.foot} foot: expected the columns {', '.join(needed)} (and {TIME}, if it "
                f"has a clock), each once, found {', '.join(columns)}; missing: {', '.join(missing) or 'none'}"
            )
        self._columns = columns
        self.clock = "own" if TIME in columns else "can"
        instrument_columns = tuple(name for name in columns if name not in (TIME, RECEIVED))
        combined = REFERENCE_COLUMNS["shoe"] if self._shoe is not None else ()
        names = (TIME, *combined, *instrument_columns) + ((RECEIVED,) if TIME in columns else ())
        self.header = ",".join(names) + "\n"

    def _format_row(self, values: Mapping[str, float], now_s: float) -> str:
        """Return the row of reference.csv for a reading; empty if it is refused."""
        assert self._columns is not None
        if any(math.isinf(value) for value in values.values()) or math.isnan(values.get(TIME, 0.0)):
            return self._refuse("expected finite numbers and a time in every row")
        instrument_values = {name: value for name, value in values.items() if name not in (TIME, RECEIVED)}
        combined: dict[str, float] = {}
        if self._shoe is not None:
            wrench = self._shoe.wrench({name: np.array([values[name]]) for name in SHOE_COLUMNS})
            combined = {name: float(array[0]) for name, array in wrench.items()}
        cells = [f"{values.get(TIME, now_s):.6f}"]
        cells += ["" if math.isnan(value) else f"{value:.9g}" for value in (combined | instrument_values).values()]
        if TIME in values:
            cells.append(f"{now_s:.6f}")
        self.readings += 1
        return ",".join(cells) + "\n"

    def _refuse(self, refusal: str) -> str:
        self.refused += 1
        self.refusal = refusal
        return ""
