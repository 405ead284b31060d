"""Convert tables of published readings, one row per sample, into the counts of one foot.

| columns  | content |
|----------|---------|
| 10 · k   | the ten pressure taxels (0-5, 7-9, 11) of k triangles; 280 for an insole |
| 12 · k   | all twelve slots of k triangles |
| 192 · b  | all slots of b boards with 16 triangles each: 576 per foot, 1152 for both |

The k triangles are in the order of the layout. The order of the published 280 columns was inferred from the data:
faults (the fingerprint of an open triangle) and dead boards appear in both published forms of the right insole at the
positions that boards of 12, 5 and 11 triangles in ascending order give.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..errors import FileError
from ..skin import layout as layouts
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..skin.layout import Layout
from .copies import InsoleContents
from .document import RecordedBoard

_SLOTS = 16 * N_TAXELS  # per board
LATEST_S = 9.2e9  # latest time whose nanoseconds fit into 64 bits: in the year 2261
_ADDRESSES: dict[Foot, tuple[int, int, int]] = {"left": (5, 6, 7), "right": (8, 9, 10)}
_PADS = f"thermal pads of the {{foot}} foot (taxels {' and '.join(map(str, np.flatnonzero(~PRESSURE_TAXELS)))}): 0"


def insole_of_published(foot: Foot, layout: Layout | None, invented: list[str]) -> InsoleContents:
    """Return the insole of published numbers with unknown settings left out; append what was assumed to `invented`."""
    if layout is None:
        layout = layouts.builtin(foot, _ADDRESSES[foot])
        invented.append(
            f"board addresses and triangle numbers of the {foot} foot: the built-in layout's, in its order; "
            "only their order is known"
        )
    addresses = dict.fromkeys(layout.identities[:, 0].tolist())
    return InsoleContents(foot, [RecordedBoard(address=address) for address in addresses], layout)


def counts_of(values: NDArray[np.float64], layout: Layout, where: str, invented: list[str]) -> NDArray[np.uint8]:
    """Return (n, n_triangles, 12) counts from (n, columns) values, 0 where a taxel has no column.

    Appends what was assumed to `invented`. Raises FileError if the columns do not fit the layout or are not counts.
    """
    k, width = len(layout), values.shape[1]
    byte_values = to_bytes(values, where)
    counts = np.zeros((len(values), k, N_TAXELS), np.uint8)
    if width == k * N_TAXELS:
        counts[:] = byte_values.reshape(-1, k, N_TAXELS)
    elif width == k * (N_TAXELS - 2):
        counts[:, :, PRESSURE_TAXELS] = byte_values.reshape(-1, k, N_TAXELS - 2)
        invented.append(_PADS.format(foot=layout.foot))
    elif width % _SLOTS == 0 and width // _SLOTS == len(set(layout.identities[:, 0].tolist())):
        slots = byte_values.reshape(len(values), -1, N_TAXELS)
        boards = list(dict.fromkeys(layout.identities[:, 0].tolist()))
        rows = [16 * boards.index(board) + triangle for board, triangle in layout.identities.tolist()]
        counts[:] = slots[:, rows]
        unmapped = np.setdiff1d(np.flatnonzero((slots != slots[:1]).any(axis=(0, 2))), rows)
        if len(unmapped):
            names = ", ".join(f"{boards[slot // 16]}.{slot % 16}" for slot in unmapped.tolist())
            raise FileError(
                f"{where}: slots that are not in the layout of the {layout.foot} foot have readings "
                f"(board.triangle: {names}): name a layout that has them with --layout"
            )
    else:
        raise FileError(
            f"{where}: expected 10 or 12 columns for each of the {k} triangles of the layout, or 192 a board, "
            f"found {width} columns of values: name the layout they are of with --layout"
        )
    return counts


def to_bytes(values: NDArray[np.float64], where: str, names: Sequence[str] | None = None) -> NDArray[np.uint8]:
    """Return the values as bytes; FileError if one is not a whole number from 0 to 255."""
    wrong = ~((values >= 0) & (values <= 255) & (values == np.floor(values)))
    if wrong.any():
        row, column = np.argwhere(wrong)[0].tolist()
        name = names[column] if names is not None else str(column)
        raise FileError(
            f"{where}: expected counts, whole numbers from 0 to 255, found {values[row, column]:g} in row {row}, "
            f"column {name}, and {int(wrong.sum()) - 1} more like it: are these filtered, or pressures?"
        )
    return values.astype(np.uint8)


def to_nanoseconds(time_s: NDArray[np.float64], where: str) -> NDArray[np.int64]:
    """Convert times in s (n,) to integer ns; FileError if one is not finite or does not fit into 64 bits."""
    wrong = ~(np.abs(time_s) <= LATEST_S)
    if wrong.any():
        row = int(wrong.argmax())
        raise FileError(f"{where}: expected times in seconds, up to {LATEST_S:.0f}, found {time_s[row]:g} in row {row}")
    return np.round(time_s * 1e9).astype(np.int64)


def is_both_feet(width: int) -> bool:
    """Return whether a table of this width holds the six boards of two feet."""
    return width == 2 * 3 * _SLOTS
