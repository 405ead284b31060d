"""Positions of the taxels of an insole: `insole-layout/1`, or the built-in approximation of a size 42.

The layout of the real insole is not public. `load` reads it from a file; `builtin` is the approximation without one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..documents import Key, Reading, Section, at_least, read, spell, within
from ..files import write_text
from . import geometry

FORMAT = "insole-layout/1"

Foot = Literal["left", "right"]
Coordinate = Annotated[float, within(-500, 500)]  # mm; nobody's foot is longer

TRIANGLE_10_MM2 = 32.4  # a tenth of the printed triangle: what the published calibrations integrate with
MIN_SPAN_MM = 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Triangle(Section):
    """One triangle in its foot's frame: x forward, y to the wearer's left, millimetres."""

    board: Annotated[int, within(1, 14)]
    triangle: Annotated[int, within(0, 15)]
    patch: str
    x_mm: Coordinate  # of the centre, taxel 3
    y_mm: Coordinate
    rotation_deg: Annotated[float, within(-360, 360)]  # counter-clockwise seen from above (+z)
    mirrored: bool = False  # x flipped in the triangle's own frame, before it is rotated


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The triangles of one foot, in the order all arrays follow (n_triangles of them, 12 slots each)."""

    foot: Foot
    taxel_area_m2: float  # area of one taxel's pressure
    area_meaning: str | None
    triangles: tuple[Triangle, ...]
    xy_m: NDArray[np.float64]  # (n_triangles, 12, 2) thermal pads included
    builtin: bool = False
    extensions: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.triangles)

    @property
    def identities(self) -> NDArray[np.uint8]:
        """Board and triangle number of every row, (n_triangles, 2)."""
        return np.array([(t.board, t.triangle) for t in self.triangles], np.uint8).reshape(-1, 2)

    @property
    def rows(self) -> dict[tuple[int, int], int]:
        """Row of the arrays by (board, triangle)."""
        return {(t.board, t.triangle): row for row, t in enumerate(self.triangles)}


@dataclass(frozen=True, slots=True, kw_only=True)
class _File(Section):
    foot: Foot
    taxel_area_mm2: Annotated[float, within(1, 200)]
    area_meaning: str | None = None
    triangles: Annotated[tuple[Triangle, ...], at_least(1)]


def load(path: str | PathLike[str], foot: Foot | None = None, addresses: Collection[int] | None = None) -> Layout:
    """Return the layout in file `path`; DocumentError lists all its problems.

    If given, `foot` must be that of the layout, and `addresses` must contain all its boards.
    """
    file = read(path, _File, FORMAT, _check(foot, addresses))
    return _layout(file.foot, file.taxel_area_mm2, file.area_meaning, file.triangles, extensions=file.extensions)


def write(path: str | PathLike[str], layout: Layout, remark: str = "") -> None:
    """Write `layout` as a file that `load` reads, all or nothing; `remark` becomes a comment at its top.

    Raises OSError if it cannot be written; no partial file remains.
    """
    lines = [f"# {line}".rstrip() for line in remark.splitlines()]
    lines += [f"format: {FORMAT}", f"foot: {layout.foot}", f"taxel_area_mm2: {layout.taxel_area_m2 * 1e6:.6g}"]
    if layout.area_meaning is not None:
        lines.append(f"area_meaning: {json.dumps(layout.area_meaning, ensure_ascii=False)}")
    lines.append("triangles:")
    lines += [
        f"  - {{board: {t.board}, triangle: {t.triangle}, patch: {json.dumps(t.patch, ensure_ascii=False)}, "
        f"x_mm: {t.x_mm:.6g}, y_mm: {t.y_mm:.6g}, rotation_deg: {t.rotation_deg:.6g}, "
        f"mirrored: {'true' if t.mirrored else 'false'}}}"
        for t in layout.triangles
    ]
    write_text(Path(path), "\n".join(lines) + "\n")


def assigned(template: Layout, triangles: tuple[Triangle, ...]) -> Layout:
    """Return the layout of `triangles` with everything else as in `template`."""
    area_mm2 = template.taxel_area_m2 * 1e6
    return _layout(template.foot, area_mm2, template.area_meaning, triangles)


def of(
    foot: Foot, taxel_area_m2: float, area_meaning: str | None, triangles: tuple[Triangle, ...], builtin: bool = False
) -> Layout:
    """Return the layout of `triangles`; `builtin` marks it as the approximation."""
    return _layout(foot, taxel_area_m2 * 1e6, area_meaning, triangles, builtin=builtin)


def _layout(foot: Foot, area_mm2: float, meaning: str | None, triangles: tuple[Triangle, ...], **more: Any) -> Layout:
    xy_m = geometry.taxel_positions(
        [(t.x_mm, t.y_mm) for t in triangles],
        [t.rotation_deg for t in triangles],
        [t.mirrored for t in triangles],
    )
    xy_m.setflags(write=False)
    return Layout(foot, area_mm2 * 1e-6, meaning, triangles, xy_m, **more)


def _check(foot: Foot | None, addresses: Collection[int] | None) -> Callable[[Reading], None]:
    def check(reading: Reading) -> None:
        file_foot = reading.document.get("foot")
        if foot is not None and file_foot in ("left", "right") and file_foot != foot:
            reading.problem(("foot",), f"expected the layout of the {foot} foot, found that of the {file_foot} foot")
        triangles = reading.of(Triangle)
        first: dict[tuple[int, int], Key] = {}
        strangers: set[int] = set()
        for key, t in triangles:
            identity = (t.board, t.triangle)
            if identity in first:
                where = spell(first[identity])
                reading.problem(key, f"triangle {t.triangle} of board {t.board} is listed twice, first in {where}")
            first.setdefault(identity, key)
            if addresses is not None and t.board not in addresses and t.board not in strangers:
                strangers.add(t.board)  # report each board once
                configured = ", ".join(map(str, sorted(addresses)))
                reading.problem(
                    (*key, "board"), f"board {t.board} is not one of this insole's boards, which are: {configured}"
                )
        span_mm = np.ptp([(t.x_mm, t.y_mm) for _, t in triangles], axis=0).max() if triangles else 0.0
        if len(first) > 1 and span_mm < MIN_SPAN_MM:
            reading.problem(
                ("triangles",),
                f"all centres lie within {span_mm:.3g} mm, not even {MIN_SPAN_MM:g} mm: "
                "are these metres, or inches? x_mm and y_mm are millimetres",
            )

    return check


# ---- the built-in layout


@dataclass(frozen=True, slots=True)
class _Patch:
    """Triangles on one tiling by equilateral cells.

    Columns of a row are half a cell apart. Cells point up if row + column is even, else down.
    """

    name: str
    origin_mm: tuple[float, float]  # base of row 0, in the middle of column 0
    turn_deg: float  # of the tiling: 0 has rows along x and cells that point to +y and -y
    cells: tuple[tuple[int, int], ...]  # (row, column)
    triangles: tuple[int, ...]  # as sparse as on the real insole: 12 + 5 + 11 of 3 × 16

    def placed(self) -> list[tuple[float, float, float]]:
        """Return (x_mm, y_mm, rotation_deg) of every cell's centre."""
        turn = np.deg2rad(self.turn_deg)
        centres = []
        for row, column in self.cells:
            up = (row + column) % 2 == 0
            u = column * geometry.CELL_SIDE_MM / 2
            v = (row + (1 / 3 if up else 2 / 3)) * geometry.CELL_HEIGHT_MM
            x = self.origin_mm[0] + u * np.cos(turn) - v * np.sin(turn)
            y = self.origin_mm[1] + u * np.sin(turn) + v * np.cos(turn)
            centres.append((round(float(x), 3), round(float(y), 3), self.turn_deg + (0.0 if up else 180.0)))
        return centres


# Of the left foot. Cells were chosen so that the printed triangles stay inside OUTLINE_MM: two rows under the
# heel, a patch turned by 90 degrees under the lateral midfoot, three rows under the ball and the big toe.
_PATCHES = (
    _Patch(
        "front", (28.0, geometry.CELL_HEIGHT_MM / 2), 0.0,
        ((-2, 9), (-2, 10), (-2, 11), (-2, 12), (-2, 13), (-1, 9), (-1, 10), (-1, 11), (-1, 12), (-1, 13),
         (0, 9), (0, 10)),
        (0, 1, 4, 6, 8, 9, 10, 11, 12, 13, 14, 15),
    ),
    _Patch("middle", (139.8, 24.0), 90.0, ((0, -2), (0, -1), (0, 0), (-1, -1), (-1, 0)), (4, 5, 6, 7, 15)),
    _Patch(
        "rear", (15.5, 0.0), 0.0,
        ((-1, 0), (-1, 1), (-1, 2), (-1, 3), (-1, 4), (0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (0, 5)),
        (0, 1, 2, 3, 5, 6, 7, 9, 10, 11, 14),
    ),
)  # fmt: skip

# A left insole of size 42, about 260 mm long, 94 mm wide at the ball and 67 mm at the heel (42 × 6.67 mm is a
# last of 280 mm, toe allowance included); the proportions are an assumption. Medial is y < 0.
OUTLINE_MM = np.array([
    (0, 0), (3, 13), (10, 23), (22, 30.5), (40, 34), (65, 35), (95, 36), (125, 38), (150, 41), (175, 44),
    (195, 45.5), (212, 44.5), (227, 40), (240, 32), (250, 21), (257, 6), (260, -10), (259, -24), (253, -36),
    (242, -43), (225, -47), (205, -48.5), (185, -47), (165, -40), (145, -27), (125, -21), (100, -22),
    (80, -28), (60, -32), (40, -33.5), (22, -30.5), (10, -23), (3, -13),
], float)  # fmt: skip
OUTLINE_MM.setflags(write=False)


def builtin(foot: Foot, addresses: tuple[int, int, int]) -> Layout:
    """Return the approximation of an insole of size 42: 28 triangles, `addresses` = (front, middle, rear).

    The outlines of the right foot's triangles are mirror images of the left foot's. The triangles themselves are not
    `mirrored`, because real ones have the same handedness on both feet. A rotation r becomes 180° − r: the triangle
    then covers the mirror image of its outline and of its pressure taxels' places, in another order.
    """
    triangles = []
    for patch, board in zip(_PATCHES, addresses, strict=True):
        for number, (x, y, rotation) in zip(patch.triangles, patch.placed(), strict=True):
            if foot == "right":
                y, rotation = -y, 180.0 - rotation
            triangles.append(
                Triangle(
                    board=board,
                    triangle=number,
                    patch=patch.name,
                    x_mm=x,
                    y_mm=y,
                    rotation_deg=rotation % 360.0,
                )
            )
    return _layout(foot, TRIANGLE_10_MM2, "triangle/10", tuple(triangles), builtin=True)
