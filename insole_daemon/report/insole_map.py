"""The insole from above, toes up: a value or a word for every taxel."""

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
_STEPS = 24  # of the scale beside it
_FEW = 24  # taxels of one word: more are an area, in which letters cover each other


def value_map(layout: Layout, values: Array, label: str, title: str, highest: float | None = None) -> str:
    """SVG of values (n_triangles · 12,) ≥ 0, NaN left empty; the scale begins at 0 and ends above 98 % of them.

    `highest` is the upper end of the scale, where several maps share one.
    """
    known = values[np.isfinite(values)]
    high = (float(np.percentile(known, 98)) if len(known) else 1.0) if highest is None else highest
    high = high if high > 0 else 1.0
    colours = [magnitude(v / high) if np.isfinite(v) else None for v in values.tolist()]
    marks, width, height = _taxels(layout, colours)
    top, tall = _EDGE + 14, height - 2 * _EDGE - 28
    steps = [
        f'<rect x="{width}" y="{top + tall * (1 - (at + 1) / _STEPS):.1f}" width="14" '
        f'height="{tall / _STEPS + 0.5:.1f}" fill="{magnitude((at + 0.5) / _STEPS)}"/>'
        for at in range(_STEPS)
    ]
    ends = [
        f'<text x="{width + 18}" y="{y:.0f}" class="tick">{value:.3g}</text>'
        for value, y in ((high, top + 5), (high / 2, top + tall / 2 + 4), (0.0, top + tall + 4))
    ]
    unit = f'<text x="{width}" y="{_EDGE + 4}">{escape(label)}</text>'
    return _svg(title, width + _BAR, height, [*marks, *steps, *ends, unit])


def word_map(layout: Layout, words: Mapping[int, str], usual: str, title: str) -> str:
    """SVG of a word by slot; those that are not `usual` have a colour, and their first two letters
    where they are few.
    """
    order = [usual, *sorted({word for word in words.values() if word != usual})]
    slots = len(layout) * geometry.N_TAXELS
    colours = [None if (word := words.get(slot)) is None else _colour(order.index(word)) for slot in range(slots)]
    number = Counter(words.values())
    lettered = {word for word in order[1:] if number[word] <= _FEW}
    letters = [word[:2] if (word := words.get(slot)) in lettered and word else "" for slot in range(slots)]
    marks, width, height = _taxels(layout, colours, letters)
    named = []
    for at, word in enumerate(order):
        y = _EDGE + 16 + 20 * at
        named.append(f'<circle cx="{width + 6}" cy="{y - 4}" r="{_RADIUS}" fill="{_colour(at)}"/>')
        named.append(f'<text x="{width + 16}" y="{y}">{escape(word)} {number[word]}</text>')
    return _svg(title, width + 120, height, [*marks, *named])


def outlines_mm(layout: Layout) -> Array:
    """(n_triangles, corners, 2) x forward and y to the wearer's left of every triangle's corners."""
    outlines: Array = 1e3 * geometry.place_points(
        geometry.OUTLINE_MM,
        [(t.x_mm, t.y_mm) for t in layout.triangles],
        [t.rotation_deg for t in layout.triangles],
        [t.mirrored for t in layout.triangles],
    )
    return outlines


def _colour(at: int) -> str:
    return "var(--quiet)" if at == 0 else category(at)


def _taxels(
    layout: Layout, colours: list[str | None], letters: list[str] | None = None
) -> tuple[list[str], float, float]:
    """Marks of the foot, its triangles and taxels, and how wide and high they are."""
    outlines, foot = outlines_mm(layout), foot_outline_mm(layout.xy_m.reshape(-1, 2) * 1e3)
    low, high = foot.min(axis=0), foot.max(axis=0)

    def placed(xy_mm: Array) -> Array:
        """(…, 2) pixels: x forward is up, y to the wearer's left is left."""
        return np.stack([(high[1] - xy_mm[..., 1]), (high[0] - xy_mm[..., 0])], axis=-1) * _PER_MM + _EDGE

    marks = [f'<path d="M{_points(placed(foot))}Z" class="frame"><title>{layout.foot} foot</title></path>']
    for triangle, corners in zip(layout.triangles, placed(outlines), strict=True):
        points = _points(corners)
        name = f"board {triangle.board}, triangle {triangle.triangle}"
        marks.append(f'<polygon points="{points}" class="frame"><title>{name}</title></polygon>')
    pressure = np.tile(geometry.PRESSURE_TAXELS, len(layout))
    for slot, (u, v) in enumerate(placed(layout.xy_m.reshape(-1, 2) * 1e3).tolist()):
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
