"""Import the text export of another sensor, as steps or as a reference; a mapping file names its columns.

    format: insole-table/1
    foot: left
    separator: ";"                            # between columns; default: a comma
    decimal: ","                              # default: a point
    lines_before_names: 2                     # default: 0
    time: {column: "Time [ms]", unit: ms}     # s | ms
    force: {column: "Fz", unit: N}            # N | kN
    cop_x: {column: "COPx", unit: mm}         # m | mm | cm, from heel to toe; cop_y to the wearer's left; optional
    cop_y: {column: "COPy", unit: mm}
    pressure: {columns: ["S1", "S2"], unit: kPa, area_mm2: 60.0}   # Pa | kPa | N/cm2; optional: contact area

The file keeps its own clock: seconds count from its own zero.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from ..config import Contact, Foot
from ..documents import Section, at_least, read, within
from ..errors import FileError
from ..files import unreadable
from ..mechanics.gait.figures import FootCourse
from ..mechanics.gait.steps import Steps, find_steps
from ..mechanics.region_map import RegionMap
from ..mechanics.wrench import WrenchSeries
from .reference import TIME

FORMAT = "insole-table/1"
_TO_SI = {
    "s": 1.0,
    "ms": 1e-3,
    "N": 1.0,
    "kN": 1e3,
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "Pa": 1.0,
    "kPa": 1e3,
    "N/cm2": 1e4,
}

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeColumn(Section):
    """Column of the time."""

    column: str
    unit: Literal["s", "ms"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceColumn(Section):
    """Column of the vertical force."""

    column: str
    unit: Literal["N", "kN"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceColumn(Section):
    """Column of one coordinate of the CoP."""

    column: str
    unit: Literal["m", "cm", "mm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureColumns(Section):
    """Columns of the sensors, which all have the same area."""

    columns: Annotated[tuple[str, ...], at_least(1)]
    unit: Literal["Pa", "kPa", "N/cm2"]
    area_mm2: Annotated[float, within(0.1, 10_000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableMapping(Section):
    """Content of a mapping file."""

    foot: Foot
    separator: str = ","
    decimal: Literal[".", ","] = "."
    lines_before_names: Annotated[int, within(0, 1000)] = 0
    time: TimeColumn
    force: ForceColumn
    cop_x: PlaceColumn | None = None
    cop_y: PlaceColumn | None = None
    pressure: PressureColumns | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """The n readings of another sensor of one foot, in SI units."""

    foot: Foot
    time_s: Array  # (n,) increasing
    f_z_n: Array  # (n,)
    m_x_nm: Array  # (n,) from force and CoP; NaN without a CoP
    m_y_nm: Array
    cop_x_m: Array  # (n,) NaN: unknown
    cop_y_m: Array
    pressure_pa: Array  # (n, sensors)
    area_m2: float  # per sensor; NaN without pressure


def read_table(source: Path, mapping: Path) -> TextTable:
    """Read the text file `source`; FileError or DocumentError if it does not match the mapping file."""
    table_mapping = read(mapping, TableMapping, FORMAT)
    table = _read_columns(source, table_mapping)

    def column(named: TimeColumn | ForceColumn | PlaceColumn) -> Array:
        return table[named.column] * _TO_SI[named.unit]

    t_s, f_z = column(table_mapping.time), column(table_mapping.force)
    if len(t_s) < 2 or not np.all(np.diff(t_s) > 0):
        raise FileError(
            f"{source}: {table_mapping.time.column}: expected times that increase, found {len(t_s)} that do not"
        )
    nothing = np.full(len(t_s), np.nan)
    cop_x = nothing if table_mapping.cop_x is None else column(table_mapping.cop_x)
    cop_y = nothing if table_mapping.cop_y is None else column(table_mapping.cop_y)
    pressure, area_m2 = np.empty((len(t_s), 0)), np.nan
    if table_mapping.pressure is not None:
        pressure = (
            np.stack([table[name] for name in table_mapping.pressure.columns], axis=1)
            * _TO_SI[table_mapping.pressure.unit]
        )
        area_m2 = table_mapping.pressure.area_mm2 * 1e-6
    # Without load the CoP is undefined, but the moments are 0.
    m_x, minus_m_y = (
        np.where(np.isfinite(cop), cop, 0.0 if np.isfinite(cop).any() else np.nan) * f_z for cop in (cop_y, cop_x)
    )
    return TextTable(table_mapping.foot, t_s, f_z, m_x, -minus_m_y, cop_x, cop_y, pressure, area_m2)


def reference_of_table(source: Path, mapping: Path) -> tuple[Foot, dict[str, Array]]:
    """Return the foot and the columns of a reference.csv; FileError if the file has no CoP, which moments need."""
    table = read_table(source, mapping)
    columns = {TIME: table.time_s, "fz_n": table.f_z_n, "mx_nm": table.m_x_nm, "my_nm": table.m_y_nm}
    if not np.isfinite(table.m_x_nm + table.m_y_nm).any():
        raise FileError(
            f"{source}: a reference needs moments, and they need the CoP: name cop_x and cop_y in {mapping}. "
            "Without them, steps_of_table still gives its steps"
        )
    return table.foot, columns


def steps_of_table(source: Path, mapping: Path) -> Steps:
    """Return the steps in the text file `source`; FileError or DocumentError if it does not match the mapping file."""
    table = read_table(source, mapping)
    unknown = np.full(len(table.time_s), np.nan)
    valid = np.isfinite(table.pressure_pa)
    contact_area_m2 = np.count_nonzero(table.pressure_pa >= Contact().min_pressure_pa, axis=1) * table.area_m2
    wrench = WrenchSeries(
        table.f_z_n, table.m_x_nm, table.m_y_nm, table.cop_x_m, table.cop_y_m, unknown, unknown, unknown,
        contact_area_m2, valid.mean(axis=1) if valid.shape[1] else unknown,
    )  # fmt: skip
    regions = RegionMap((), np.full(valid.shape[1], -1, np.int8), ())
    course = FootCourse(
        table.foot, table.time_s, wrench, table.pressure_pa.astype(np.float32), valid, lambda rows: None, regions,
        table.area_m2, Contact().min_pressure_pa, source.name,
    )  # fmt: skip
    return find_steps([course], 0, [f"from {source.name}, which has only the {table.foot} foot"])


def _read_columns(source: Path, table_mapping: TableMapping) -> dict[str, Array]:
    """Return the columns that the mapping names, in their own units; an empty cell is NaN."""
    wanted = [
        named.column
        for named in (table_mapping.time, table_mapping.force, table_mapping.cop_x, table_mapping.cop_y)
        if named is not None
    ]
    wanted += table_mapping.pressure.columns if table_mapping.pressure is not None else ()
    try:
        lines = source.read_text(encoding="utf-8-sig").splitlines()[table_mapping.lines_before_names :]
    except OSError as error:
        raise FileError(f"{source}: {unreadable(error)}") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{source}: expected text (UTF-8), found other bytes from byte {error.start} on") from error
    rows = list(csv.reader(lines, delimiter=table_mapping.separator))
    names = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in wanted if name not in names]
    if missing:
        raise FileError(f"{source}: expected the columns {', '.join(missing)}, found {', '.join(names) or 'none'}")
    columns: dict[str, Array] = {}
    for name in wanted:
        index, values = names.index(name), []
        for number, row in enumerate(rows[1:], table_mapping.lines_before_names + 2):
            cell = row[index].strip().replace(table_mapping.decimal, ".") if index < len(row) else ""
            try:
                values.append(float(cell) if cell else np.nan)
            except ValueError as error:
                raise FileError(f"{source}: line {number}: {name}: expected a number, found {cell!r}") from error
        columns[name] = np.array(values)
    return columns
