"""Draw an insole from above, toes up, with a value or a word for every taxel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from html import escape

import numpy as np
from numpy.typing import NDArray

from ..skin import geometry
from ..skin.layout import Layout
from .colours import category, magnitude
from .foot_outline import foot_outline_mm

Array = NDArray[np.float64]

_PER_MM, _EDGE, _BAR = 2.0, 12, 66
_RADIUS = 4.6
_STEPS = 24  # colour steps of the scale
_MAX_LETTERED = 24  # with more taxels of one word, letters would overlap


def value_map(layout: Layout, values: Array, label: str, title: str, highest: float | None = None) -> str:
    """Return SVG of values (n_triangles · 12,) ≥ 0, with NaN left empty; the scale ends at the 98th percentile.

    `highest` is the upper end of the scale, for maps that share one.
    """
    known = values[np.isfinite(values)]
    high = (float(np.percentile(known, 98)) if len(known) else 1.0) if highest is None else highest
    high = high if high > 0 else 1.0
    colours = [magnitude(v / high) if np.isfinite(v) else None for v in values.tolist()]
    marks, width, height = _draw_taxels(layout, colours)
    top, scale_height = _EDGE + 14, height - 2 * _EDGE - 28
    steps = [
        f'<rect x="{width}" y="{top + scale_height * (1 - (step + 1) / _STEPS):.1f}" width="14" '
        f'height="{scale_height / _STEPS + 0.5:.1f}" fill="{magnitude((step + 0.5) / _STEPS)}"/>'
        for step in range(_STEPS)
    ]
    ends = [
        f'<text x="{width + 18}" y="{y:.0f}" class="tick">{value:.3g}</text>'
        for value, y in ((high, top + 5), (high / 2, top + scale_height / 2 + 4), (0.0, top + scale_height + 4))
    ]
    unit = f'<text x="{width}" y="{_EDGE + 4}">{escape(label)}</text>'
    return _svg(title, width + _BAR, height, [*marks, *steps, *ends, unit])


def word_map(layout: Layout, words: Mapping[int, str], usual: str, title: str) -> str:
    """Return SVG of one word per slot; words other than `usual` have a colour.

    Words with few taxels are also marked by their first two letters.
    """
    order = [usual, *sorted({word for word in words.values() if word != usual})]
    slots = len(layout) * geometry.N_TAXELS
    colours = [None if (word := words.get(slot)) is None else _colour(order.index(word)) for slot in range(slots)]
    counts = Counter(words.values())
    lettered = {word for word in order[1:] if counts[word] <= _MAX_LETTERED}
    letters = [word[:2] if (word := words.get(slot)) in lettered and word else "" for slot in range(slots)]
    marks, width, height = _draw_taxels(layout, colours, letters)
    legend = []
    for row, word in enumerate(order):
        y = _EDGE + 16 + 20 * row
        legend.append(f'<circle cx="{width + 6}" cy="{y - 4}" r="{_RADIUS}" fill="{_colour(row)}"/>')
        legend.append(f'<text x="{width + 16}" y="{y}">{escape(word)} {counts[word]}</text>')
    return _svg(title, width + 120, height, [*marks, *legend])


def outlines_mm(layout: Layout) -> Array:
    """Return (n_triangles, corners, 2) the triangles' corners: x forward, y to the wearer's left."""
    outlines: Array = 1e3 * geometry.place_points(
        geometry.OUTLINE_MM,
        [(t.x_mm, t.y_mm) for t in layout.triangles],
        [t.rotation_deg for t in layout.triangles],
        [t.mirrored for t in layout.triangles],
    )
    return outlines


def _colour(index: int) -> str:
    return "var(--quiet)" if index == 0 else category(index)


def _draw_taxels(
    layout: Layout, colours: list[str | None], letters: list[str] | None = None
) -> tuple[list[str], float, float]:
    """Return the marks of foot, triangles and taxels, and the width and height of the drawing."""
    outlines, foot = outlines_mm(layout), foot_outline_mm(layout.xy_m.reshape(-1, 2) * 1e3)
    low, high = foot.min(axis=0), foot.max(axis=0)

    def to_pixels(xy_mm: Array) -> Array:
        """Return (…, 2) pixels: x forward is up, y to the wearer's left is left."""
        return np.stack([(high[1] - xy_mm[..., 1]), (high[0] - xy_mm[..., 0])], axis=-1) * _PER_MM + _EDGE

    marks = [f'<path d="M{_points(to_pixels(foot))}Z" class="frame"><title>{layout.foot} foot</title></path>']
    for triangle, corners in zip(layout.triangles, to_pixels(outlines), strict=True):
        points = _points(corners)
        name = f"board {triangle.board}, triangle {triangle.triangle}"
        marks.append(f'<polygon points="{points}" class="frame"><title>{name}</title></polygon>')
    pressure = np.tile(geometry.PRESSURE_TAXELS, len(layout))
    for slot, (u, v) in enumerate(to_pixels(layout.xy_m.reshape(-1, 2) * 1e3).tolist()):
        if not pressure[slot]:
            continue
        colour = colours[slot]
        fill = f'fill="{colour}"' if colour is not None else 'fill="none" class="grid"'
        marks.append(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{_RADIUS}" {fill}/>')
        if letters and letters[slot]:
            marks.append(f'<text x="{u + 6:.1f}" y="{v + 3:.1f}" class="tick">{letters[slot]}</text>')
    width, height = ((high - low)[::-1] * _PER_MM + 2 * _EDGE).tolist()
    return marks, width, height


def _points(corners: Array) -> str:
    return " ".join(f"{u:.1f},{v:.1f}" for u, v in corners.tolist())


def _svg(title: str, width: float, height: float, marks: list[str]) -> str:
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img" '
        f'xmlns="http://www.w3.org/2000/svg" class="map">'
        f"<title>{escape(title)}</title>{''.join(marks)}</svg>"
    )
