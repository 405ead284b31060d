"""Curves over time as an SVG: panels beside each other, all with the same scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 460, 260, 46, 30, 40
MOST_POINTS = 400
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One file."""

    title: str
    t_s: Array  # (n,)
    curves: Sequence[tuple[str, str, Array]]  # name, colour, (n,) values


def drawn(panels: Sequence[Panel], y_label: str, low: float, high: float) -> str:
    """The picture; what lies beyond `low` and `high` is cut off."""
    size = f'width="{WIDTH * len(panels)}" height="{HEIGHT}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="11">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for number, panel in enumerate(panels):
        parts += _panel(panel, WIDTH * number, y_label, low, high)
    return "\n".join([*parts, "</svg>\n"])


def _panel(panel: Panel, at: int, y_label: str, low: float, high: float) -> list[str]:
    left, right, bottom = at + LEFT, at + WIDTH - 14, HEIGHT - BOTTOM
    end_s = float(panel.t_s[-1])

    def y(value: float) -> float:
        return bottom - (min(max(value, low), high) - low) / (high - low) * (bottom - TOP)

    parts = [f'<text x="{left}" y="16" font-weight="bold">{panel.title}</text>']
    for value in np.linspace(low, high, 7):
        parts.append(f'<path d="M{left} {y(value):.1f}H{right}" stroke="#ddd" fill="none"/>')
        parts.append(f'<text x="{left - 4}" y="{y(value) + 4:.1f}" text-anchor="end">{value:.1f}</text>')
    parts.append(f'<text x="{right}" y="{bottom + 14}" text-anchor="end">{end_s:.0f} s</text>')
    parts.append(f'<text x="{left}" y="{bottom + 14}">0</text>')
    parts.append(f'<text x="{left}" y="{bottom + 30}">{y_label}:</text>')
    step = max(1, len(panel.t_s) // MOST_POINTS)
    t_s = _means(panel.t_s, step)
    for row, (name, colour, values) in enumerate(panel.curves):
        places = zip(t_s, _means(values, step), strict=True)
        points = " ".join(f"{left + t / end_s * (right - left):.1f},{y(v):.1f}" for t, v in places)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
        parts.append(f'<text x="{left + 110 + 82 * row}" y="{bottom + 30}" fill="{colour}">{name}</text>')
    return parts


def _means(values: Array, step: int) -> Array:
    whole = len(values) // step * step
    return values[:whole].reshape(-1, step).mean(axis=1)
