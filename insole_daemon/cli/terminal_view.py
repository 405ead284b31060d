"""Both feet in a terminal: pressure map, wrench and age of the data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.text import Text

from ..skin.geometry import THERMAL_PADS
from ..wire.messages import Health, Message, Meta, Pressure, Wrench

_PIXEL_MM = 5.6  # half a line of text; a taxel's row spacing is 5.66 mm, finer shows nothing more
_REACH = 1.2  # a pixel shows the nearest taxel if it is within this many pixels
_OTHER_LINES = 12  # of the screen that are not map
_PANEL = 39  # columns of a foot: both stand side by side in 80
_FULL_SCALE_PA = 250_000.0  # a heel in walking
# Perceptually uniform, readable with colour-blind vision: eight steps of "viridis" (matplotlib, CC0).
_SCALE = ("#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725")
_INVALID = "#777777"


@dataclass
class FootView:
    """The newest messages of one foot and their display."""

    meta: Meta
    terminal_lines: int = 60
    pressure: Pressure | None = None
    wrench: Wrench | None = None
    health: Health | None = None
    lost: int = 0
    received: int = 0
    _pixel_mm: float = field(init=False)
    _corner_mm: NDArray[np.float64] = field(init=False)  # (x, y) of the map's upper left
    _pixels: NDArray[np.intp] = field(init=False)

    def __post_init__(self) -> None:
        xy_mm = self.meta.xy_m.reshape(-1, 2).astype(np.float64) * 1e3
        map_lines = max(6, self.terminal_lines - _OTHER_LINES)
        self._pixel_mm = max(_PIXEL_MM, float(np.ptp(xy_mm[:, 0])) / (2 * map_lines - 4))
        self._corner_mm = xy_mm.max(axis=0) + self._pixel_mm
        self._pixels = _nearest_taxel(xy_mm, self._corner_mm, self._pixel_mm)

    def take(self, message: Message) -> None:
        """Store a message of this foot."""
        if isinstance(message, Pressure):
            self.pressure = message
        elif isinstance(message, Wrench):
            self.wrench = message
            self.lost += message.lost
            self.received += 1
        elif isinstance(message, Health):
            self.health = message

    def line(self) -> str:
        """Format the numbers on one line."""
        wrench = self.wrench
        if wrench is None:
            return f"{self.meta.foot:5}  waiting for the first cycle"
        oldest = float(np.nanmax(wrench.age_ms)) if np.isfinite(wrench.age_ms).any() else math.nan
        rate = f"{self.health.publish_rate_hz:.1f} Hz" if self.health else "… Hz"
        return (
            f"{wrench.foot:5}  f_z {_number(wrench.f_z_n, 'N', 0)}  m_x {_number(wrench.m_x_nm, 'N·m')}  "
            f"m_y {_number(wrench.m_y_nm, 'N·m')}  CoP ({_number(wrench.cop_x_m, 'mm', 0, 1e3)}, "
            f"{_number(wrench.cop_y_m, 'mm', 0, 1e3)})  {rate}  age {oldest:.0f} ms  lost {self.lost}"
        )

    def panel(self) -> Panel:
        """Draw the numbers and the map."""
        wrench, health = self.wrench, self.health
        rows: list[RenderableType] = []
        if wrench is not None:
            oldest = float(np.nanmax(wrench.age_ms)) if np.isfinite(wrench.age_ms).any() else math.nan
            rows.append(
                Text(
                    f"f_z {_number(wrench.f_z_n, 'N', 0):>8}   contact {wrench.contact_area_m2 * 1e4:5.0f} cm²\n"
                    f"m_x {_number(wrench.m_x_nm, 'N·m'):>10}   m_y {_number(wrench.m_y_nm, 'N·m'):>10}\n"
                    f"CoP x {_number(wrench.cop_x_m, 'mm', 0, 1e3):>8}  y {_number(wrench.cop_y_m, 'mm', 0, 1e3):>8}\n"
                    f"valid {wrench.valid_fraction:4.0%}   age {oldest:3.0f} ms   lost {self.lost}"
                )
            )
        if health is not None:
            boards = " ".join(f"{board['rate_hz']:.0f}" for board in health.boards)
            rows.append(Text(f"{health.publish_rate_hz:.1f} Hz, its boards {boards} Hz", style="dim"))
        return Panel(Group(*rows, self._map()), title=self.meta.foot, width=_PANEL)

    def _map(self) -> Text:
        """Draw two pixels in each character, one above the other, and the CoP as a white cross."""
        colour = self._colours()
        height, width = self._pixels.shape
        cross = self._cop_pixel()
        text = Text(justify="center", no_wrap=True)
        for row in range(0, height - 1, 2):
            for column in range(width):
                upper, lower = colour[row][column], colour[row + 1][column]
                if cross is not None and (cross[0] // 2, cross[1]) == (row // 2, column):
                    text.append("┼", style=f"bold white on {upper or lower or 'default'}")
                elif upper or lower:
                    text.append(
                        "▀" if upper else "▄",
                        style=f"{upper or lower} on {(lower if upper else None) or 'default'}",
                    )
                else:
                    text.append("\N{NO-BREAK SPACE}")  # centring must not strip it
            text.append("\n")
        return text

    def _colours(self) -> list[list[str | None]]:
        names: list[str | None] = [_INVALID] * self.meta.xy_m[..., 0].size
        if self.pressure is not None:
            level = np.clip(self.pressure.pressure_pa / _FULL_SCALE_PA * len(_SCALE), 0, len(_SCALE) - 1)
            for taxel in np.flatnonzero(self.pressure.valid):
                names[taxel] = _SCALE[int(level.flat[taxel])]
        return [[names[taxel] if taxel >= 0 else None for taxel in row] for row in self._pixels.tolist()]

    def _cop_pixel(self) -> tuple[int, int] | None:
        wrench = self.wrench
        if wrench is None or wrench.cop_x_m is None or wrench.cop_y_m is None:
            return None
        x_top, y_left = self._corner_mm.tolist()
        row, column = (x_top - wrench.cop_x_m * 1e3) / self._pixel_mm, (y_left - wrench.cop_y_m * 1e3) / self._pixel_mm
        return int(row), int(column)


def screen(feet: Mapping[str, FootView], title: str) -> RenderableType:
    """Draw both feet, the left one on the left, with toes up."""
    panels = [feet[foot].panel() for foot in ("left", "right") if foot in feet]
    scale = Text("0 ")
    for colour in _SCALE:
        scale.append("██", style=colour)
    scale.append(f" {_FULL_SCALE_PA / 1e3:.0f} kPa   ")
    scale.append("██", style=_INVALID)
    scale.append(" not valid")
    return Group(Text(title, style="bold"), Columns(panels), scale)


def _nearest_taxel(xy_mm: NDArray[np.float64], corner_mm: NDArray[np.float64], pixel_mm: float) -> NDArray[np.intp]:
    """Return the taxel of each pixel, (rows, columns), −1 for none; toes up, the wearer's left on the left."""
    pressure = np.flatnonzero(~np.isin(np.arange(len(xy_mm)) % 12, THERMAL_PADS))
    rows, columns = np.ceil((corner_mm - xy_mm.min(axis=0)) / pixel_mm + 1).astype(int).tolist()
    x, y = (c - (np.arange(n) + 0.5) * pixel_mm for c, n in zip(corner_mm, (rows + rows % 2, columns), strict=True))
    distance = np.hypot(x[:, None, None] - xy_mm[pressure, 0], y[None, :, None] - xy_mm[pressure, 1])
    return np.where(distance.min(axis=2) <= _REACH * pixel_mm, pressure[distance.argmin(axis=2)], -1)


def _number(value: float | None, unit: str, digits: int = 1, factor: float = 1.0) -> str:
    return f"{value * factor:z.{digits}f} {unit}" if value is not None else f"– {unit}"
