"""A force shoe: two six-axis sensors, front and rear, into one wrench about the insole's origin.

    F = Σ_s s·R_s f_s          M = Σ_s (s·R_s m_s + p_s × s·R_s f_s)          R = R_z(yaw) · R_y(pitch) · R_x(roll)

with the sensor's readings f, m in its own axes, its rotation R into the insole's frame, the place p of its measuring
origin there, and s = −1 where it reports what the foot does to the ground. Where the sensors are is `insole-shoe/1`:

    format: insole-shoe/1
    foot: left
    front: {x_mm: 190, y_mm: -5, z_mm: -20, roll_deg: 180, pitch_deg: 0, yaw_deg: 0, reports: ground_on_foot}
    rear: {x_mm: 35, y_mm: 0, z_mm: -20, roll_deg: 180, pitch_deg: 0, yaw_deg: 0, reports: ground_on_foot}

Shoes with two six-axis sensors each are those of Sorrentino et al. 2020, section 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..documents import Section, read, within
from ..errors import FileError

FORMAT = "insole-shoe/1"
_AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
COLUMNS = tuple(f"{sensor}_{axis}" for sensor in ("front", "rear") for axis in _AXES)  # of the readings

Millimetres = Annotated[float, within(-500, 500)]
Degrees = Annotated[float, within(-360, 360)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor(Section):
    """Where one six-axis sensor sits in the insole's frame: x forward, y to the wearer's left, z up."""

    x_mm: Millimetres  # of the point its moments are about
    y_mm: Millimetres
    z_mm: Millimetres  # below the insole's surface: negative
    roll_deg: Degrees = 0.0
    pitch_deg: Degrees = 0.0
    yaw_deg: Degrees = 0.0
    reports: Literal["ground_on_foot", "foot_on_ground"]

    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) from the sensor's axes into the insole's."""
        (cr, cp, cy), (sr, sp, sy) = (
            f(np.deg2rad([self.roll_deg, self.pitch_deg, self.yaw_deg])) for f in (np.cos, np.sin)
        )
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ShoeSensors(Section):
    """Both sensors of one shoe."""

    foot: Foot
    front: Sensor
    rear: Sensor

    def wrench(self, readings: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        """fz_n, mx_nm, my_nm (n,) about the insole's origin, of COLUMNS (n,); NaN where one of them is."""
        missing = [name for name in COLUMNS if name not in readings]
        if missing:
            raise FileError(
                f"expected the columns {', '.join(COLUMNS)} of a force shoe, missing: {', '.join(missing)}; "
                "name them so, or record without --shoe what is one wrench already"
            )
        force, moment = np.zeros((2, len(readings[COLUMNS[0]]), 3))
        for name, sensor in (("front", self.front), ("rear", self.rear)):
            own = np.stack([readings[f"{name}_{axis}"] for axis in _AXES], axis=-1)
            sign = 1.0 if sensor.reports == "ground_on_foot" else -1.0
            turned = sign * sensor.rotation()
            f, m = own[:, :3] @ turned.T, own[:, 3:] @ turned.T
            force += f
            moment += m + np.cross(np.array([sensor.x_mm, sensor.y_mm, sensor.z_mm]) * 1e-3, f)
        return {"fz_n": force[:, 2], "mx_nm": moment[:, 0], "my_nm": moment[:, 1]}


def load(path: str | PathLike[str]) -> ShoeSensors:
    """The shoe in file `path`; DocumentError lists all that is wrong with it."""
    return read(path, ShoeSensors, FORMAT)
