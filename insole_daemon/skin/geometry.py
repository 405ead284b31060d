"""Positions of the 12 taxels of a triangle, in its own frame and in a foot's frame.

The triangle's own frame has its origin at the centre, which is taxel 3, and its tip towards +y.
Sources: Triangle_10pad.h of iCubSkinGui (positions in mils, lines 35-63), agreeing to 0.01 mm with the CAD
of icub-taxel-positions and with left_foot.txt of skinGui; the tiling was measured on left_foot.txt.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

N_TAXELS = 12
THERMAL_PADS = (6, 10)  # they measure temperature, not pressure

PRESSURE_TAXELS: NDArray[np.bool_] = np.ones(N_TAXELS, bool)  # (12,) False at the thermal pads
PRESSURE_TAXELS[list(THERMAL_PADS)] = False
PRESSURE_TAXELS.setflags(write=False)

TAXELS_MM: NDArray[np.float64] = np.array(  # (12, 2) in the triangle's own frame, row = taxel
    [
        (6.533, 0.000), (9.800, -5.660), (3.267, -5.660), (0.000, 0.000),
        (-3.267, -5.660), (-9.800, -5.660), (-6.510, -3.750), (-6.533, 0.000),
        (-3.267, 5.660), (0.000, 11.317), (0.000, 7.532), (3.267, 5.660),
    ]
)  # fmt: skip
TAXELS_MM.setflags(write=False)

# Corners of the printed triangle: base 27.9 mm, height 24.3 mm.
OUTLINE_MM: NDArray[np.float64] = np.array([(-13.970, -8.255), (13.970, -8.255), (0.000, 16.002)])  # (3, 2)
OUTLINE_MM.setflags(write=False)

# Flat triangles lie on a tiling by equilateral cells; this is the distance between the centres of neighbours.
NEIGHBOUR_MM = 19.32
CELL_SIDE_MM = NEIGHBOUR_MM * 3**0.5  # 33.46
CELL_HEIGHT_MM = NEIGHBOUR_MM * 1.5  # 28.98


def place_points(
    points_mm: NDArray[np.float64], centres_mm: ArrayLike, rotation_deg: ArrayLike, mirrored: ArrayLike
) -> NDArray[np.float64]:
    """Transform points of the triangle's own frame into the foot's frame, for every triangle.

    points_mm (k, 2); centres_mm (n, 2); rotation_deg (n,) counter-clockwise seen from above (+z);
    mirrored (n,) bool: x flipped in the triangle's own frame, before it is rotated.
    Returns (n, k, 2) in metres, float64.
    """
    centres = np.asarray(centres_mm, float).reshape(-1, 1, 2)
    angle = np.deg2rad(np.asarray(rotation_deg, float))[:, None]
    x = points_mm[:, 0] * np.where(np.asarray(mirrored, bool), -1.0, 1.0)[:, None]
    y = points_mm[:, 1]
    turned = np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)], axis=-1)
    placed: NDArray[np.float64] = (centres + turned) * 1e-3
    return placed


def taxel_positions(centres_mm: ArrayLike, rotation_deg: ArrayLike, mirrored: ArrayLike) -> NDArray[np.float64]:
    """Return the positions of all taxels and thermal pads, (n_triangles, 12, 2) in m; see `place_points`."""
    return place_points(TAXELS_MM, centres_mm, rotation_deg, mirrored)
