"""An insole that does not lie where its map says: turned, of another size, or shifted."""

from __future__ import annotations

import numpy as np

from ...skin.layout import Layout
from ..law import Array, Law, Parameter, Values
from ..portable import sin_turns

_CENTRE = 3  # the taxel in the middle of a triangle


def _places(values: Values, xy_m: Array, layout: Layout) -> Array:
    """(n_triangles, 12, 2) m where taxels are that are believed to be at `xy_m`."""
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
        Parameter("x_mm", "mm", -300.0, 300.0, (-10.0, 10.0), "how far forward it lies"),
        Parameter("y_mm", "mm", -300.0, 300.0, (-10.0, 10.0), "how far to the wearer's left it lies"),
        Parameter("rotation_deg", "deg", -180, 180, (-5, 5), "how far it is turned counter-clockwise, seen from above"),
        Parameter("scale", "1", 0.5, 2.0, (0.9, 1.1), "how much larger it is"),
    ),
    scopes=("insole",),
    inverse_is="none needed: readings stay as they are, and belong to the places of `Chain.xy_m`",
    places=_places,
)
