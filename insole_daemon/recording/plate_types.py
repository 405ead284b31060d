"""Loads on the types of force plates that C3D defines, from what their channels hold.

| type | channels | what they hold |
|---|---|---|
| 1 | Fx Fy Fz Px Py Tz | force, centre of pressure on the surface, free moment |
| 2 | Fx Fy Fz Mx My Mz | force, and moment about the transducer's origin |
| 3 | Fx12 Fx34 Fy14 Fy23 Fz1 Fz2 Fz3 Fz4 | forces on the sensors in the corners |
| 4 | six signals | CAL_MATRIX times them is what type 2 has |

In each of them z is down, and the load is the foot's action on the plate. ORIGIN leads from the transducer's origin to
the centre of the surface, so its z is negative; of type 3, its x and y are the distances of the sensors from the axes.
Types from 5 on are rare and not read.

Source: The C3D File Format, User Guide, the FORCE_PLATFORM group, https://www.c3d.org.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

OF_CENTRE, OF_CORNERS, WITH_MATRIX = 1, 3, 4

Array = NDArray[np.float64]


def load_of_type_1(channels: Array, origin_m: Array) -> Array:
    """Return (3, n) Fz, Mx and My about the centre of the surface; `channels` (6, n) hold N and m."""
    f_z, x_m, y_m = channels[2:5]
    load: Array = np.nan_to_num(np.stack([f_z, y_m * f_z, -x_m * f_z]))  # without a load some files have no centre
    return load


def load_of_type_2(channels: Array, origin_m: Array) -> Array:
    """Return (3, n) Fz, Mx and My about the centre of the surface; `channels` (6, n) hold N and N m.

    A file whose origin has a positive z gives the opposite vector.
    """
    f_x, f_y, f_z, m_x, m_y, _ = channels
    x_m, y_m, z_m = origin_m * (-1.0 if origin_m[2] > 0 else 1.0)
    return np.stack([f_z, m_x - (y_m * f_z - z_m * f_y), m_y - (z_m * f_x - x_m * f_z)])


def load_of_type_3(channels: Array, origin_m: Array) -> Array:
    """Return (3, n) Fz, Mx and My about the centre of the surface; `channels` (8, n) hold N.

    Corners 1 to 4 are at +x +y, −x +y, −x −y and +x −y.
    """
    fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4 = channels
    along_x_m, along_y_m, depth_m = np.abs(origin_m)
    moments = np.stack([along_y_m * (fz1 + fz2 - fz3 - fz4), along_x_m * (fz2 + fz3 - fz1 - fz4), 0 * fz1])
    forces = np.stack([fx12 + fx34, fy14 + fy23, fz1 + fz2 + fz3 + fz4])
    return load_of_type_2(np.concatenate([forces, moments]), np.array([0.0, 0.0, -depth_m]))


# Type 4 is type 2 after its matrix.
LOADS: Mapping[int, Callable[[Array, Array], Array]] = {
    1: load_of_type_1, 2: load_of_type_2, 3: load_of_type_3, 4: load_of_type_2,
}  # fmt: skip
N_CHANNELS: Mapping[int, int] = {1: 6, 2: 6, 3: 8, 4: 6}
