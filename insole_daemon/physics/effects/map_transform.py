"""Map transform: an insole that is rotated, scaled or shifted relative to its layout."""

from __future__ import annotations

import numpy as np

from ...skin.layout import Layout
from ..law import Array, Law, Parameter, Values
from ..portable import sin_turns

_CENTRE = 3  # the centre taxel of a triangle


def _places(values: Values, xy_m: Array, layout: Layout) -> Array:
    """Return (n_triangles, 12, 2) the true positions, in m, of taxels with the layout positions `xy_m`."""
    x_mm, y_mm, rotation_deg, scale = (float(values[name][0]) for name in ("x_mm", "y_mm", "rotation_deg", "scale"))
    pivot = xy_m[:, _CENTRE].mean(axis=0)
    cos, sin = sin_turns([0.25 + rotation_deg / 360, rotation_deg / 360])
    x, y = np.moveaxis((xy_m - pivot) * scale, -1, 0)
    placed: Array = np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1) + pivot + np.array([x_mm, y_mm]) * 1e-3
    return placed


LAW = Law(
    word="map_transform",
    order=1,
    domain="place",
    equation="xy = R(rotation)·scale·(xy_believed − centre) + centre + (x, y), centre: mean of the triangles' centres",
    source="similarity transform in the plane; moments change by T × F, f_z does not",
    parameters=(
        Parameter("x_mm", "mm", -300.0, 300.0, (-10.0, 10.0), "shift forward"),
        Parameter("y_mm", "mm", -300.0, 300.0, (-10.0, 10.0), "shift to the wearer's left"),
        Parameter("rotation_deg", "deg", -180, 180, (-5, 5), "rotation counter-clockwise, seen from above"),
        Parameter("scale", "1", 0.5, 2.0, (0.9, 1.1), "factor of its size"),
    ),
    scopes=("insole",),
    inverse_is="none needed: readings stay as they are, and belong to the places of `Chain.xy_m`",
    places=_places,
)
