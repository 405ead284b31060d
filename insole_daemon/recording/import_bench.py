"""Import a bench's CSV: time, reference and counts in one table, recognised by the column names.

    time_s,reference,count_5_3_0,count_5_3_1
    0.00,12.5,238,240

`time_s` in seconds; `count_<board>_<triangle>_<taxel>` whole numbers from 0 to 255, an empty cell is missing.
`pressure_pa`, or `fz_n`, `mx_nm` and `my_nm`, or `reference` determine the kind of the recording (chamber, shoe or
bench; free without any of them). Further columns are copied to reference.csv.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..config import Foot
from ..errors import FileError
from ..skin import layout as layouts
from ..skin.geometry import N_TAXELS
from ..skin.layout import TRIANGLE_10_MM2, Layout, Triangle
from . import reference as references
from .columns import to_bytes, to_nanoseconds
from .copies import InsoleContents
from .counts import CountsTable
from .document import REFERENCE_COLUMNS, Kind, RecordedBoard
from .reference import TIME
from .writer import ReferenceContents, write

_COUNT = re.compile(r"count_([0-9]{1,3})_([0-9]{1,3})_([0-9]{1,3})")
_GRID_COLUMNS = 8
_KINDS: tuple[Kind, ...] = ("chamber", "shoe", "bench")


def import_bench(source: Path, out: Path, foot: Foot, layout: Layout | None) -> Path:
    """Write the recording `out` from the table `source`; FileError or DocumentError if it is not such a table."""
    table, _ = references.read(source, "free", foot, "can")
    taxels = {name: tuple(map(int, m.groups())) for name in table.columns if (m := _COUNT.fullmatch(name))}
    if table.time_s is None or not taxels or not len(table):
        raise FileError(
            f"{source}: expected the columns {TIME} and count_<board>_<triangle>_<taxel> and rows of them, found "
            f"{', '.join(table.columns)} and {len(table)} rows; tables of other kinds are MATLAB files, YARP dumps and "
            "CAN logs"
        )
    invented: list[str] = []
    if layout is None:
        layout = _grid_layout(foot, [(board, triangle) for board, triangle, _ in taxels.values()])
        invented.append("where the triangles lie: in a grid, in the order of the columns")
    rows = layout.rows
    counts = np.zeros((len(table), len(layout), N_TAXELS), np.uint8)
    names = list(taxels)
    values = np.stack([table[name] for name in names], axis=-1)
    missing = np.isnan(values)
    byte_values = to_bytes(np.where(missing, 0.0, values), str(source), names)
    for column, (board, triangle, taxel) in enumerate(taxels.values()):
        if (board, triangle) not in rows or taxel >= N_TAXELS:
            raise FileError(
                f"{source}: {names[column]}: expected a taxel 0 to {N_TAXELS - 1} of a triangle of the layout, which "
                f"has {', '.join(f'{b}.{t}' for b, t in rows)} (board.triangle)"
            )
        counts[:, rows[board, triangle], taxel] = byte_values[:, column]
    if missing.any() or len(taxels) < counts[0].size:
        missing_counts = f"{counts[0].size - len(taxels)} taxels without a column and {int(missing.sum())} empty cells"
        invented.append(f"counts of {missing_counts}: 0, which is never valid")
    others = {name: column for name, column in table.columns.items() if name not in taxels}
    kind = next((kind for kind in _KINDS if set(REFERENCE_COLUMNS[kind]) <= others.keys()), None)
    reference = []
    if kind is not None:
        first = {name: others.pop(name) for name in REFERENCE_COLUMNS[kind]}
        reference = [ReferenceContents(foot, "can", {TIME: table.time_s, **first, **others})]
    addresses = dict.fromkeys(layout.identities[:, 0].tolist())
    t_ns = (to_nanoseconds(table.time_s, str(source)) + 500) // 1000 * 1000  # a float holds a time since 1970 to 1 µs
    return write(
        out,
        kind=kind or "free",
        can_origin="reencoded" if invented else "recorded",
        insoles=[InsoleContents(foot, [RecordedBoard(address=address) for address in addresses], layout)],
        counts={foot: CountsTable(t_ns, counts)},
        reference=reference,
        invented=invented,
        source=source.name,
    )


def _grid_layout(foot: Foot, identities: list[tuple[int, int]]) -> Layout:
    """Lay the triangles out in a grid, spaced to fit a foot and to be recognisable as millimetres."""
    triangles = tuple(
        Triangle(
            board=board,
            triangle=triangle,
            patch="bench",
            x_mm=60.0 * (number % _GRID_COLUMNS),
            y_mm=40.0 * (number // _GRID_COLUMNS),
            rotation_deg=0.0,
        )
        for number, (board, triangle) in enumerate(dict.fromkeys(identities))
    )
    return layouts.of(foot, TRIANGLE_10_MM2 * 1e-6, None, triangles)
