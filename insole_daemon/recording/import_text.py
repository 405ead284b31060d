"""A text export of another sensor, by a mapping file that names its columns: its steps, or a reference for ours.

    format: insole-table/1
    foot: left
    separator: ";"                            # between columns; left out: a comma
    decimal: ","                              # left out: a point
    lines_before_names: 2                     # left out: 0
    time: {column: "Time [ms]", unit: ms}     # s | ms
    force: {column: "Fz", unit: N}            # N | kN
    cop_x: {column: "COPx", unit: mm}         # m | mm | cm, from heel to toe; cop_y to the wearer's left; both optional
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
    """The column of the time."""

    column: str
    unit: Literal["s", "ms"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceColumn(Section):
    """The column of the vertical force."""

    column: str
    unit: Literal["N", "kN"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceColumn(Section):
    """A column of the CoP."""

    column: str
    unit: Literal["m", "cm", "mm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureColumns(Section):
    """The columns of the sensors, each of which stands for the same area."""

    columns: Annotated[tuple[str, ...], at_least(1)]
    unit: Literal["Pa", "kPa", "N/cm2"]
    area_mm2: Annotated[float, within(0.1, 10_000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableMapping(Section):
    """All of a mapping file."""

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
    """n readings of another sensor of one foot, in SI units."""

    foot: Foot
    time_s: Array  # (n,) increasing
    f_z_n: Array  # (n,)
    m_x_nm: Array  # (n,) by the CoP; NaN where the file has none
    m_y_nm: Array
    cop_x_m: Array  # (n,) NaN: not known
    cop_y_m: Array
    pressure_pa: Array  # (n, sensors)
    area_m2: float  # of a sensor; NaN without pressure


def read_table(source: Path, mapping: Path) -> TextTable:
    """The text file `source`; FileError or DocumentError where it is not as `mapping` says."""
    said = read(mapping, TableMapping, FORMAT)
    table = _read(source, said)

    def column(named: TimeColumn | ForceColumn | PlaceColumn) -> Array:
        return table[named.column] * _TO_SI[named.unit]

    t_s, f_z = column(said.time), column(said.force)
    if len(t_s) < 2 or not np.all(np.diff(t_s) > 0):
        raise FileError(f"{source}: {said.time.column}: expected times that increase, found {len(t_s)} that do not")
    nothing = np.full(len(t_s), np.nan)
    cop_x = nothing if said.cop_x is None else column(said.cop_x)
    cop_y = nothing if said.cop_y is None else column(said.cop_y)
    pressure, area_m2 = np.empty((len(t_s), 0)), np.nan
    if said.pressure is not None:
        pressure = np.stack([table[name] for name in said.pressure.columns], axis=1) * _TO_SI[said.pressure.unit]
        area_m2 = said.pressure.area_mm2 * 1e-6
    # Where nothing is borne, the CoP says nothing, and no moment is 0 all the same.
    m_x, minus_m_y = (
        np.where(np.isfinite(cop), cop, 0.0 if np.isfinite(cop).any() else np.nan) * f_z for cop in (cop_y, cop_x)
    )
    return TextTable(said.foot, t_s, f_z, m_x, -minus_m_y, cop_x, cop_y, pressure, area_m2)


def reference_of_table(source: Path, mapping: Path) -> tuple[Foot, dict[str, Array]]:
    """The foot and the columns of a reference.csv; FileError where the file has no CoP: moments need one."""
    table = read_table(source, mapping)
    columns = {TIME: table.time_s, "fz_n": table.f_z_n, "mx_nm": table.m_x_nm, "my_nm": table.m_y_nm}
    if not np.isfinite(table.m_x_nm + table.m_y_nm).any():
        raise FileError(
            f"{source}: a reference needs moments, and they need the CoP: name cop_x and cop_y in {mapping}. "
            "Without them, steps_of_table still gives its steps"
        )
    return table.foot, columns


def steps_of_table(source: Path, mapping: Path) -> Steps:
    """The steps in the text file `source`; FileError or DocumentError where it is not as `mapping` says."""
    table = read_table(source, mapping)
    nothing = np.full(len(table.time_s), np.nan)
    valid = np.isfinite(table.pressure_pa)
    touched = np.count_nonzero(table.pressure_pa >= Contact().min_pressure_pa, axis=1) * table.area_m2
    wrench = WrenchSeries(
        table.f_z_n, table.m_x_nm, table.m_y_nm, table.cop_x_m, table.cop_y_m, nothing, nothing, nothing, touched,
        valid.mean(axis=1) if valid.shape[1] else nothing,
    )  # fmt: skip
    regions = RegionMap((), np.full(valid.shape[1], -1, np.int8), ())
    course = FootCourse(
        table.foot, table.time_s, wrench, table.pressure_pa.astype(np.float32), valid, lambda rows: None, regions,
        table.area_m2, Contact().min_pressure_pa, source.name,
    )  # fmt: skip
    return find_steps([course], 0, [f"from {source.name}, which has only the {table.foot} foot"])


def _read(source: Path, said: TableMapping) -> dict[str, Array]:
    """The columns that the mapping names; an empty cell is NaN."""
    wanted = [named.column for named in (said.time, said.force, said.cop_x, said.cop_y) if named is not None]
    wanted += said.pressure.columns if said.pressure is not None else ()
    try:
        lines = source.read_text(encoding="utf-8-sig").splitlines()[said.lines_before_names :]
    except OSError as error:
        raise FileError(f"{source}: {unreadable(error)}") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{source}: expected text (UTF-8), found other bytes from byte {error.start} on") from error
    rows = list(csv.reader(lines, delimiter=said.separator))
    names = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in wanted if name not in names]
    if missing:
        raise FileError(f"{source}: expected the columns {', '.join(missing)}, found {', '.join(names) or 'none'}")
    columns: dict[str, Array] = {}
    for name in wanted:
        at, values = names.index(name), []
        for number, row in enumerate(rows[1:], said.lines_before_names + 2):
            cell = row[at].strip().replace(said.decimal, ".") if at < len(row) else ""
            try:
                values.append(float(cell) if cell else np.nan)
            except ValueError as error:
                raise FileError(f"{source}: line {number}: {name}: expected a number, found {cell!r}") from error
        columns[name] = np.array(values)
    return columns
