"""Read and write reference.csv: the readings of the reference instrument, a header and one row per reading.

    time_s,pressure_pa,temperature_c
    1741532714.287982,244.0,26.63

`time_s` may be missing; further columns may follow. An empty cell is a missing value.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..errors import DocumentError, Problem
from ..files import unreadable
from .document import REFERENCE_COLUMNS, Clock, Kind

TIME = "time_s"
_MOST_PROBLEMS = 10  # reported for one file
_UNIT = re.compile(r"(.+)_([a-z0-9]+)")


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The n readings of one foot's reference.

    `time_s` is on the clock of the CAN frames if `clock` is "can", else on the instrument's own. It is None if the
    instrument gave no times; then its sampling rate is unknown too.
    """

    foot: Foot
    clock: Clock
    time_s: NDArray[np.float64] | None  # (n,) never decreases
    columns: Mapping[str, NDArray[np.float64]]  # (n,) arrays, unit in the name; NaN: missing

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(next(iter(self.columns.values())))

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        """Return (n,) the readings of one column, such as "pressure_pa"."""
        return self.columns[column]


def read(path: Path, kind: Kind, foot: Foot, clock: Clock) -> tuple[Reference, tuple[str, ...]]:
    """Read the reference in `path`, and a sentence for each irregularity; DocumentError lists all problems."""
    lines, complete = _read_lines(path)
    header = [name.strip() for name in next(csv.reader(lines[:1]))]
    problems = _find_header_problems(header, kind)
    if problems:
        raise DocumentError(str(path), problems)
    warnings: tuple[str, ...] = ()
    rows = [line.split(",") for line in lines[1:]]
    if rows and not complete and len(rows[-1]) < len(header):
        warnings = (f"{path}: line {len(lines)} is incomplete and ignored",)
        rows.pop()
    while rows and rows[-1] == [""]:
        rows.pop()
    table = _parse_table(path, rows, header)
    columns = {name: table[:, i] for i, name in enumerate(header)}
    time_s = columns.pop(TIME, None)
    if time_s is not None:
        _check_times(path, time_s)
    if not rows:
        warnings += (f"{path}: the reference has no readings",)
    for name in REFERENCE_COLUMNS[kind]:
        missing = int(np.isnan(columns[name]).sum())
        if rows and missing == len(rows):
            warnings += (f"{path}: {name} is missing in every row",)
    table.setflags(write=False)
    return Reference(foot, clock, time_s, columns), warnings


def text(columns: Mapping[str, Sequence[float] | NDArray[np.float64]]) -> str:
    """Return the text of a reference.csv with `columns`; NaN becomes an empty cell, `time_s` has six decimals."""
    names = list(columns)
    cells = [[_format_cell(name, value) for value in map(float, column)] for name, column in columns.items()]
    rows = "".join(",".join(row) + "\n" for row in zip(*cells, strict=True))
    return ",".join(names) + "\n" + rows


def _format_cell(name: str, value: float) -> str:
    if math.isnan(value):
        return ""
    return f"{value:.6f}" if name == TIME else repr(value).removesuffix(".0")


def _read_lines(path: Path) -> tuple[list[str], bool]:
    """Return the lines of the file, and whether the last one is terminated."""
    try:
        content = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise DocumentError(str(path), [Problem(None, "", unreadable(error))]) from error
    except UnicodeDecodeError as error:
        what = f"expected text (UTF-8) with commas, found other bytes from byte {error.start} on"
        raise DocumentError(str(path), [Problem(None, "", what)]) from error
    lines = content.splitlines()
    if not lines:
        raise DocumentError(str(path), [Problem(None, "", "expected a header with columns, found an empty file")])
    return lines, content.endswith("\n")


def _find_header_problems(header: list[str], kind: Kind) -> list[Problem]:
    """Return the problems of the header for a recording of `kind`."""
    problems = []
    if all(_is_number(cell) for cell in header):
        what = f"expected a header such as {TIME},{','.join(REFERENCE_COLUMNS[kind])}, found numbers"
        return [Problem(1, "(header)", what)]
    for name in REFERENCE_COLUMNS[kind]:
        if name in header:
            continue
        stem = name.rpartition("_")[0] or name
        near = [other for other in header if stem in (other, (_UNIT.fullmatch(other) or [""] * 2)[1])]
        hint = f": found {near[0]}; the unit is part of the name, convert the values" if near else ""
        what = f"missing column: expected {name} in a reference of kind {kind}, found {', '.join(header)}{hint}"
        problems.append(Problem(1, name, what))
    for name in {name for name in header if header.count(name) > 1}:
        problems.append(Problem(1, name, "this column appears twice: keep one"))
    if "" in header:
        problems.append(Problem(1, "(header)", f"column {header.index('') + 1} has no name"))
    return problems


def _parse_table(path: Path, rows: list[list[str]], header: list[str]) -> NDArray[np.float64]:
    """Return (n, columns) numbers, NaN for empty cells; DocumentError for anything else."""
    problems = [
        Problem(number, "(row)", f"expected {len(header)} cells, found {len(row)}")
        for number, row in enumerate(rows, 2)
        if len(row) != len(header)
    ]
    if not problems:
        cells = np.array(rows, str).reshape(len(rows), len(header))
        empty = np.char.strip(cells) == "" if len(rows) else np.zeros(cells.shape, np.bool_)
        try:
            table = np.where(empty, "nan", cells).astype(np.float64)
            wrong = ~np.isfinite(table) & ~empty
        except ValueError:
            wrong = np.array([[not _is_number(cell) for cell in row] for row in rows]) & ~empty
        if not wrong.any():
            return table
        problems = [
            Problem(row + 2, header[column], f"expected a number, or an empty cell where there is none, "
                    f"found {rows[row][column]!r}")
            for row, column in np.argwhere(wrong).tolist()
        ]  # fmt: skip
    raise DocumentError(str(path), _first_problems(problems))


def _check_times(path: Path, time_s: NDArray[np.float64]) -> None:
    """Raise DocumentError if a time is missing or times decrease."""
    problems = [
        Problem(row + 2, TIME, "expected a time in every row or no such column, found an empty cell")
        for row in np.flatnonzero(np.isnan(time_s)).tolist()
    ]
    problems += [
        Problem(row + 3, TIME, f"time goes backwards, from {time_s[row]:.6f} to {time_s[row + 1]:.6f} s: "
                "take the rows out, or split the recording there")
        for row in np.flatnonzero(np.diff(time_s) < 0).tolist()
    ]  # fmt: skip
    if problems:
        raise DocumentError(str(path), _first_problems(problems))


def _first_problems(problems: list[Problem]) -> list[Problem]:
    more = len(problems) - _MOST_PROBLEMS
    return problems if more <= 0 else [*problems[:_MOST_PROBLEMS], Problem(None, "", f"and {more} more like these")]


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False
