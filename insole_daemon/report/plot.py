"""A plot with two axes as SVG text: lines, bands, and a legend below."""

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
WIDTH, WHOLE_WIDTH = 480, 1012  # pixels: two plots fill a row of a page, or one
_MOST_POINTS = 1600  # of one line: as many as there are pixels


@dataclass(frozen=True, slots=True)
class Axis:
    """What stands along it, and from where to where."""

    label: str
    low: float
    high: float
    logarithmic: bool = False

    def at(self, values: Array) -> Array:
        """(n,) where values lie, 0 at the low end and 1 at the high one."""
        if self.logarithmic:
            share: Array = np.log10(values / self.low) / log10(self.high / self.low)
        else:
            share = (values - self.low) / (self.high - self.low)
        return share

    def ticks(self) -> list[tuple[float, str]]:
        """Round values within it, and how they are written."""
        if self.logarithmic:
            powers = range(round(log10(self.low)), round(log10(self.high)) + 1)
            return [(10.0**power, f"10{_raised(power)}") for power in powers]
        step = _round_step((self.high - self.low) / 6)
        first = np.ceil(self.low / step - 1e-9) * step
        digits = max(0, -floor(log10(step) + 1e-9))
        values = np.arange(first, self.high + step * 1e-6, step)
        return [
            (float(v), f"{v:.{digits}f}".replace("-", "−")) for v in np.where(np.abs(values) < step / 2, 0.0, values)
        ]


def axis(label: str, *values: Array) -> Axis:
    """One that holds all finite `values`, with a little room."""
    every = np.concatenate([np.ravel(each) for each in values]) if values else np.empty(0)
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
    room = 0.04 * (high - low) or 1.0
    return Axis(label, low if low == 0 else low - room, high + room)


class Plot:
    """Drawn in the order of the calls; `svg` is the text. A colour is the number of a category."""

    def __init__(self, x: Axis, y: Axis, width: float = WIDTH, height: float = 280) -> None:
        self._x, self._y, self._width, self._height = x, y, width, height
        self._marks: list[str] = []
        self._legend: list[tuple[str, int]] = []

    @classmethod
    def to_scale(cls, x: Axis, y: Axis, height: float) -> Plot:
        """One on which a unit is as long along both axes."""
        per_unit = (height - _TOP - _BOTTOM) / (y.high - y.low)
        return cls(x, y, round(_LEFT + _RIGHT + per_unit * (x.high - x.low), 1), height)

    def line(self, x: Array, y: Array, colour: int = 0, name: str = "", faint: bool = False) -> None:
        """Through the points (n,), interrupted where one is NaN; `name` puts it into the legend."""
        style = f'stroke="{category(colour)}" stroke-width="{0.6 if faint else 1.6}"'
        style += ' stroke-opacity="0.35"' if faint else ""
        self._marks.append(f'<path d="{self._path(*_thinned(x, y))}" fill="none" {style}/>')
        self._name(name, colour)

    def outline(self, x: Array, y: Array) -> None:
        """The closed shape with these corners (n,), as quiet as the frame."""
        self._marks.append(f'<path d="{self._path(x, y)}Z" class="frame"/>')

    def band(self, x: Array, low: Array, high: Array, colour: int = 0, name: str = "") -> None:
        """The area between two lines (n,)."""
        there = np.isfinite(low) & np.isfinite(high)
        around = self._path(np.concatenate([x[there], x[there][::-1]]), np.concatenate([low[there], high[there][::-1]]))
        self._marks.append(f'<path d="{around}Z" fill="{category(colour)}" fill-opacity="0.22" stroke="none"/>')
        self._name(name, colour)

    def svg(self, title: str) -> str:
        """The drawing; `title` says in words what a person sees who cannot see it."""
        height = self._height + (_LEGEND if self._legend else 0)
        inside = (
            f'x="{_LEFT}" y="{_TOP}" width="{self._width - _LEFT - _RIGHT}" height="{self._height - _TOP - _BOTTOM}"'
        )
        clip = f"c{crc32((title + ''.join(self._marks)).encode()):08x}"  # one of its own on any page
        return (
            f'<svg viewBox="0 0 {self._width:g} {height:g}" width="{self._width:g}" height="{height:g}" role="img" '
            f'xmlns="http://www.w3.org/2000/svg">'
            f'<title>{escape(title)}</title><clipPath id="{clip}"><rect {inside}/></clipPath>'
            f'{self._axes()}<g clip-path="url(#{clip})">{"".join(self._marks)}</g>{self._named()}</svg>'
        )

    def _places(self, x: Array, y: Array) -> tuple[Array, Array]:
        u = _LEFT + self._x.at(x) * (self._width - _LEFT - _RIGHT)
        v = self._height - _BOTTOM - self._y.at(y) * (self._height - _TOP - _BOTTOM)
        return u, v

    def _path(self, x: Array, y: Array) -> str:
        parts, pen = [], False
        for u, v in zip(*self._places(x, y), strict=True):
            if np.isfinite(u) and np.isfinite(v):
                parts.append(f"{'L' if pen else 'M'}{u:.1f} {v:.1f}")
                pen = True
            else:
                pen = False
        return "".join(parts)

    def _axes(self) -> str:
        bottom, right = self._height - _BOTTOM, self._width - _RIGHT
        parts = [f'<rect x="{_LEFT}" y="{_TOP}" width="{right - _LEFT}" height="{bottom - _TOP}" class="frame"/>']
        for value, text in self._x.ticks():
            u = float(self._places(np.array([value]), np.array([self._y.low]))[0][0])
            parts.append(f'<path d="M{u:.1f} {_TOP}V{bottom}" class="grid"/>')
            parts.append(f'<text x="{u:.1f}" y="{bottom + 15}" class="tick" text-anchor="middle">{text}</text>')
        for value, text in self._y.ticks():
            v = float(self._places(np.array([self._x.low]), np.array([value]))[1][0])
            parts.append(f'<path d="M{_LEFT} {v:.1f}H{right}" class="grid"/>')
            parts.append(f'<text x="{_LEFT - 6}" y="{v + 4:.1f}" class="tick" text-anchor="end">{text}</text>')
        middle_x, middle_y = (_LEFT + right) / 2, (_TOP + bottom) / 2
        parts.append(f'<text x="{middle_x}" y="{bottom + 34}" text-anchor="middle">{escape(self._x.label)}</text>')
        turned = f'transform="translate(14 {middle_y}) rotate(-90)"'
        parts.append(f'<text {turned} text-anchor="middle">{escape(self._y.label)}</text>')
        return "".join(parts)

    def _name(self, name: str, colour: int) -> None:
        if name:
            self._legend.append((name, colour))

    def _named(self) -> str:
        parts, u = [], float(_LEFT)
        for name, colour in self._legend:
            parts.append(f'<rect x="{u:.0f}" y="{self._height + 6}" width="14" height="4" fill="{category(colour)}"/>')
            parts.append(f'<text x="{u + 19:.0f}" y="{self._height + 12}">{escape(name)}</text>')
            u += 40 + 6.4 * len(name)
        return "".join(parts)


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """The same to the eye: the lowest and the highest of each stretch that makes a pixel."""
    if len(x) <= _MOST_POINTS:
        return x, y
    edges = np.linspace(0, len(x), _MOST_POINTS // 2 + 1).astype(int)
    kept: list[int] = []
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        part = y[a:b]
        if np.isnan(part).all():
            kept.append(a)
        else:
            kept += sorted({a + int(np.nanargmin(part)), a + int(np.nanargmax(part))})
    return x[kept], y[kept]


def _round_step(step: float) -> float:
    """The next of 1, 2, 5, 10, …"""
    size = 10.0 ** floor(log10(step))
    return next((m * size for m in (1, 2, 5) if step <= m * size * (1 + 1e-9)), 10 * size)


def _raised(power: int) -> str:
    return "".join("⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".index(digit)] for digit in str(power))
