"""Tables and text that fit the terminal; a table that is too wide is printed with its rows as columns."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

_GAP = 2  # spaces beside a column


def fold(line: str, indent: int) -> str:
    """Return `line` wrapped between words to the terminal's width, with `indent` from line 2 on; else unchanged."""
    width = terminal_width(0)
    if not width:
        return line
    return textwrap.fill(line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)


def terminal_width(elsewhere: int) -> int:
    """Return the columns of the terminal, or of COLUMNS, or `elsewhere` if there is neither."""
    return shutil.get_terminal_size((elsewhere, 24)).columns


def print_table(console: Console, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print `rows` below `columns`; the first column names the row and is left-aligned, the others right-aligned."""
    if _width(columns, rows) <= console.width:
        _print(console, columns, rows)
        return
    names = max(map(len, columns))
    while rows:
        count, width = 0, names + 2 * _GAP
        while count < len(rows):
            width += max(map(len, rows[count])) + 2 * _GAP
            if count and width > console.width:
                break
            count += 1
        portion, rows = rows[:count], rows[count:]
        _print(console, [columns[0], *(row[0] for row in portion)], list(zip(columns, *portion, strict=True))[1:])


def _width(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> int:
    widths = [max(map(len, cells)) for cells in zip(columns, *rows, strict=True)]
    return sum(widths) + 2 * _GAP * len(widths)


def _print(console: Console, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich.box import SIMPLE
    from rich.table import Table

    table = Table(box=SIMPLE)
    for at, column in enumerate(columns):
        table.add_column(column, justify="right" if at else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    console.print(table, markup=False)
