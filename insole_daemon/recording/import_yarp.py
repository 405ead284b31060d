"""Import what yarpdatadumper writes of a skin port: `data.log`, one line per sample.

    counter  time_s  [time_received_s]  v0 v1 …

A line has 576 values for one foot, 1152 for both (six boards in the order of canBusSkin's ids).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..errors import FileError
from ..files import unreadable
from ..skin.layout import Layout
from .columns import counts_of, insole_of_published, is_both_feet, to_nanoseconds
from .counts import CountsTable
from .writer import write

_NO_BRACKETS = str.maketrans("()", "  ")


def import_yarp(source: Path, out: Path, foot: Foot | None, layout: Layout | None) -> Path:
    """Write the recording `out` from a dump, its folder or its data.log; FileError if it is not one."""
    path = source / "data.log" if source.is_dir() else source
    table = _read_table(path)
    n_leading = 3 if _has_receive_time(table) else 2
    values = table[:, n_leading:]
    invented = ["times: when YARP published the row; no frame's receive time is known"]
    t_ns = to_nanoseconds(table[:, 1], str(path))
    feet: list[tuple[Foot, Layout | None, NDArray[np.float64]]] = []
    if is_both_feet(values.shape[1]) and foot is None and layout is None:
        half = values.shape[1] // 2
        feet = [("left", None, values[:, :half]), ("right", None, values[:, half:])]
        invented.append("which foot is which: the first three of the six boards are taken for the left one")
    elif foot is None:
        raise FileError(f"{path}: {values.shape[1]} values a line are those of one foot: state which with --foot")
    else:
        feet = [(foot, layout, values)]
    insoles, tables = [], dict[str, CountsTable]()
    for name, layout_of_foot, values_of_foot in feet:
        insole = insole_of_published(name, layout_of_foot, invented)
        insoles.append(insole)
        tables[name] = CountsTable(t_ns, counts_of(values_of_foot, insole.layout, str(path), invented))
    return write(
        out, kind="free", can_origin="reencoded", insoles=insoles, counts=tables, invented=invented, source=path.name
    )


def _read_table(path: Path) -> NDArray[np.float64]:
    """Return (n, columns) the numbers of a dump; FileError if a line has another number of cells."""
    try:
        lines = path.read_text("utf-8").translate(_NO_BRACKETS).splitlines()
    except OSError as error:
        raise FileError(f"{path}: expected what yarpdatadumper writes, and it {unreadable(error)}") from error
    except UnicodeDecodeError as error:
        what = f"found other bytes from byte {error.start} on"
        raise FileError(f"{path}: expected the text that yarpdatadumper writes, {what}") from error
    rows = [line.split() for line in lines if line.strip()]
    width = len(rows[0]) if rows else 0
    if len(rows) > 1 and len(rows[-1]) < width:
        rows.pop()  # the dumper was stopped while it wrote a line
    for number, row in enumerate(rows, 1):
        if len(row) != width or width < 3:
            raise FileError(
                f"{path}: line {number}: expected a counter, a time and the same number of values in every line, "
                f"found {len(row)} cells after lines of {width}"
            )
    try:
        return np.array(rows, np.float64).reshape(len(rows), width)
    except ValueError as error:
        raise FileError(f"{path}: expected numbers alone, found: {error}") from error


def _has_receive_time(table: NDArray[np.float64]) -> bool:
    """Return whether the third column is a time, as with the dumper's --txTime --rxTime; counts never exceed 255."""
    return bool(table.shape[1] % 2 == 1 and len(table) and (table[:, 2] > 255).any())
