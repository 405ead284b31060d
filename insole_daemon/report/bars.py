"""Horizontal bars with words beside them, as SVG text: what is compared has names, not numbers."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from .colours import category

_LABEL, _VALUE, _ROW, _EDGE = 200, 76, 26, 8
_WIDTH = 640


def bars(rows: Sequence[tuple[str, float, str, int]], title: str, mark: tuple[float, str] | None = None) -> str:
    """SVG of rows (name, length, its text, number of a category's colour); `mark`: a line across all, and its name."""
    most = max([length for _, length, _, _ in rows] + ([mark[0]] if mark else [])) or 1.0
    room = _WIDTH - _LABEL - _VALUE
    height = _ROW * len(rows) + 2 * _EDGE + (18 if mark else 0)
    marks = []
    for at, (name, length, text, colour) in enumerate(rows):
        y = _EDGE + _ROW * at
        long = max(room * length / most, 1.0)
        marks.append(f'<text x="{_LABEL - 8}" y="{y + 15}" text-anchor="end">{escape(name)}</text>')
        marks.append(
            f'<rect x="{_LABEL}" y="{y + 3}" width="{long:.1f}" height="{_ROW - 8}" rx="2" fill="{category(colour)}"/>'
        )
        marks.append(f'<text x="{_LABEL + long + 6:.1f}" y="{y + 15}" class="tick">{escape(text)}</text>')
    if mark:
        x, bottom = _LABEL + room * mark[0] / most, _EDGE + _ROW * len(rows)
        marks.append(f'<path d="M{x:.1f} {_EDGE - 2}V{bottom}" stroke="var(--ink)" stroke-dasharray="4 3"/>')
        marks.append(f'<text x="{x:.1f}" y="{bottom + 14}" class="tick" text-anchor="middle">{escape(mark[1])}</text>')
    return (
        f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" xmlns="http://www.w3.org/2000/svg">'
        f"<title>{escape(title)}</title>{''.join(marks)}</svg>"
    )
