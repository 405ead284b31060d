"""Draw a plot with two axes as SVG: lines, bands, and a legend below."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from math import floor, log10
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from .colours import category

Array = NDArray[np.float64]

_LEFT, _RIGHT, _TOP, _BOTTOM, _LEGEND = 62, 12, 10, 42, 22
WIDTH, WHOLE_WIDTH = 480, 1012  # pixels, for two plots in a row of a page, or for one
_MAX_POINTS = 1600  # points per line, about one per pixel


@dataclass(frozen=True, slots=True)
class Axis:
    """The label and range of an axis."""

    label: str
    low: float
    high: float
    logarithmic: bool = False

    def fraction(self, values: Array) -> Array:
        """Return (n,) the positions of values: 0 at the low end, 1 at the high end."""
        if self.logarithmic:
            fraction: Array = np.log10(values / self.low) / log10(self.high / self.low)
        else:
            fraction = (values - self.low) / (self.high - self.low)
        return fraction

    def ticks(self) -> list[tuple[float, str]]:
        """Return round values within the range, with their text."""
        if self.logarithmic:
            powers = range(round(log10(self.low)), round(log10(self.high)) + 1)
            return [(10.0**power, f"10{_superscript(power)}") for power in powers]
        step = _round_step((self.high - self.low) / 6)
        first = np.ceil(self.low / step - 1e-9) * step
        digits = max(0, -floor(log10(step) + 1e-9))
        values = np.arange(first, self.high + step * 1e-6, step)
        return [
            (float(v), f"{v:.{digits}f}".replace("-", "−")) for v in np.where(np.abs(values) < step / 2, 0.0, values)
        ]


def axis(label: str, *values: Array) -> Axis:
    """Return an axis that contains all finite `values`, with a small margin."""
    all_values = np.concatenate([np.ravel(array) for array in values]) if values else np.empty(0)
    all_values = all_values[np.isfinite(all_values)]
    low, high = (float(all_values.min()), float(all_values.max())) if len(all_values) else (0.0, 1.0)
    margin = 0.04 * (high - low) or 1.0
    return Axis(label, low if low == 0 else low - margin, high + margin)


class Plot:
    """A plot that is drawn in the order of the calls; `svg` returns it. A colour is the number of a category."""

    def __init__(self, x: Axis, y: Axis, width: float = WIDTH, height: float = 280) -> None:
        self._x, self._y, self._width, self._height = x, y, width, height
        self._marks: list[str] = []
        self._legend: list[tuple[str, int]] = []

    @classmethod
    def to_scale(cls, x: Axis, y: Axis, height: float) -> Plot:
        """Return a plot with the same scale along both axes."""
        per_unit = (height - _TOP - _BOTTOM) / (y.high - y.low)
        return cls(x, y, round(_LEFT + _RIGHT + per_unit * (x.high - x.low), 1), height)

    def line(self, x: Array, y: Array, colour: int = 0, name: str = "", faint: bool = False) -> None:
        """Draw a line through the points (n,), interrupted at NaN; `name` adds it to the legend."""
        style = f'stroke="{category(colour)}" stroke-width="{0.6 if faint else 1.6}"'
        style += ' stroke-opacity="0.35"' if faint else ""
        self._marks.append(f'<path d="{self._path(*_reduce_points(x, y))}" fill="none" {style}/>')
        self._add_to_legend(name, colour)

    def outline(self, x: Array, y: Array) -> None:
        """Draw a closed shape with these corners (n,), in the style of the frame."""
        self._marks.append(f'<path d="{self._path(x, y)}Z" class="frame"/>')

    def band(self, x: Array, low: Array, high: Array, colour: int = 0, name: str = "") -> None:
        """Fill the area between two lines (n,)."""
        is_finite = np.isfinite(low) & np.isfinite(high)
        outline = self._path(
            np.concatenate([x[is_finite], x[is_finite][::-1]]), np.concatenate([low[is_finite], high[is_finite][::-1]])
        )
        self._marks.append(f'<path d="{outline}Z" fill="{category(colour)}" fill-opacity="0.22" stroke="none"/>')
        self._add_to_legend(name, colour)

    def svg(self, title: str) -> str:
        """Return the drawing; `title` describes it in words for readers who cannot see it."""
        height = self._height + (_LEGEND if self._legend else 0)
        plot_area = (
            f'x="{_LEFT}" y="{_TOP}" width="{self._width - _LEFT - _RIGHT}" height="{self._height - _TOP - _BOTTOM}"'
        )
        clip = f"c{crc32((title + ''.join(self._marks)).encode()):08x}"  # unique on any page
        return (
            f'<svg viewBox="0 0 {self._width:g} {height:g}" width="{self._width:g}" height="{height:g}" role="img" '
            f'xmlns="http://www.w3.org/2000/svg">'
            f'<title>{escape(title)}</title><clipPath id="{clip}"><rect {plot_area}/></clipPath>'
            f'{self._axes()}<g clip-path="url(#{clip})">{"".join(self._marks)}</g>{self._legend_svg()}</svg>'
        )

    def _to_pixels(self, x: Array, y: Array) -> tuple[Array, Array]:
        u = _LEFT + self._x.fraction(x) * (self._width - _LEFT - _RIGHT)
        v = self._height - _BOTTOM - self._y.fraction(y) * (self._height - _TOP - _BOTTOM)
        return u, v

    def _path(self, x: Array, y: Array) -> str:
        """Return SVG path commands through the points, interrupted at NaN."""
        commands, is_pen_down = [], False
        for u, v in zip(*self._to_pixels(x, y), strict=True):
            if np.isfinite(u) and np.isfinite(v):
                commands.append(f"{'L' if is_pen_down else 'M'}{u:.1f} {v:.1f}")
                is_pen_down = True
            else:
                is_pen_down = False
        return "".join(commands)

    def _axes(self) -> str:
        """Return frame, grid, ticks and labels."""
        bottom, right = self._height - _BOTTOM, self._width - _RIGHT
        marks = [f'<rect x="{_LEFT}" y="{_TOP}" width="{right - _LEFT}" height="{bottom - _TOP}" class="frame"/>']
        for value, text in self._x.ticks():
            u = float(self._to_pixels(np.array([value]), np.array([self._y.low]))[0][0])
            marks.append(f'<path d="M{u:.1f} {_TOP}V{bottom}" class="grid"/>')
            marks.append(f'<text x="{u:.1f}" y="{bottom + 15}" class="tick" text-anchor="middle">{text}</text>')
        for value, text in self._y.ticks():
            v = float(self._to_pixels(np.array([self._x.low]), np.array([value]))[1][0])
            marks.append(f'<path d="M{_LEFT} {v:.1f}H{right}" class="grid"/>')
            marks.append(f'<text x="{_LEFT - 6}" y="{v + 4:.1f}" class="tick" text-anchor="end">{text}</text>')
        middle_x, middle_y = (_LEFT + right) / 2, (_TOP + bottom) / 2
        marks.append(f'<text x="{middle_x}" y="{bottom + 34}" text-anchor="middle">{escape(self._x.label)}</text>')
        rotation = f'transform="translate(14 {middle_y}) rotate(-90)"'
        marks.append(f'<text {rotation} text-anchor="middle">{escape(self._y.label)}</text>')
        return "".join(marks)

    def _add_to_legend(self, name: str, colour: int) -> None:
        if name:
            self._legend.append((name, colour))

    def _legend_svg(self) -> str:
        marks, u = [], float(_LEFT)
        for name, colour in self._legend:
            marks.append(f'<rect x="{u:.0f}" y="{self._height + 6}" width="14" height="4" fill="{category(colour)}"/>')
            marks.append(f'<text x="{u + 19:.0f}" y="{self._height + 12}">{escape(name)}</text>')
            u += 40 + 6.4 * len(name)
        return "".join(marks)


def _reduce_points(x: Array, y: Array) -> tuple[Array, Array]:
    """Return fewer points that look the same: the lowest and the highest of every interval of a pixel."""
    if len(x) <= _MAX_POINTS:
        return x, y
    edges = np.linspace(0, len(x), _MAX_POINTS // 2 + 1).astype(int)
    rows: list[int] = []
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        interval = y[a:b]
        if np.isnan(interval).all():
            rows.append(a)
        else:
            rows += sorted({a + int(np.nanargmin(interval)), a + int(np.nanargmax(interval))})
    return x[rows], y[rows]


def _round_step(step: float) -> float:
    """Return the next larger step of 1, 2, 5, 10, …"""
    magnitude = 10.0 ** floor(log10(step))
    return next((factor * magnitude for factor in (1, 2, 5) if step <= factor * magnitude * (1 + 1e-9)), 10 * magnitude)


def _superscript(power: int) -> str:
    return "".join("⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".index(digit)] for digit in str(power))
