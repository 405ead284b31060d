"""Combine the two six-axis sensors of a force shoe, front and rear, into one wrench about the insole's origin.

    F = Σ_s s·R_s f_s          M = Σ_s (s·R_s m_s + p_s × s·R_s f_s)          R = R_z(yaw) · R_y(pitch) · R_x(roll)

f and m are a sensor's readings in its own axes, R its rotation into the insole's frame, p the position of its origin in
that frame, and s = −1 if it reports the foot's action on the ground. The sensors' poses are in `insole-shoe/1`:

    format: insole-shoe/1
    foot: left
    front: {x_mm: 190, y_mm: -5, z_mm: -20, roll_deg: 180, pitch_deg: 0, yaw_deg: 0, reports: ground_on_foot}
    rear: {x_mm: 35, y_mm: 0, z_mm: -20, roll_deg: 180, pitch_deg: 0, yaw_deg: 0, reports: ground_on_foot}

Shoes with two six-axis sensors each: Sorrentino et al. 2020, section 4.
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
COLUMNS = tuple(f"{sensor}_{axis}" for sensor in ("front", "rear") for axis in _AXES)  # of the readings of both sensors

Millimetres = Annotated[float, within(-500, 500)]
Degrees = Annotated[float, within(-360, 360)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor(Section):
    """Pose of one six-axis sensor in the insole's frame: x forward, y to the wearer's left, z up."""

    x_mm: Millimetres  # of the point that its moments refer to
    y_mm: Millimetres
    z_mm: Millimetres  # negative below the insole's surface
    roll_deg: Degrees = 0.0
    pitch_deg: Degrees = 0.0
    yaw_deg: Degrees = 0.0
    reports: Literal["ground_on_foot", "foot_on_ground"]

    def rotation(self) -> NDArray[np.float64]:
        """Return the (3, 3) rotation from the sensor's axes to the insole's."""
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
    """The poses of both sensors of one shoe."""

    foot: Foot
    front: Sensor
    rear: Sensor

    def wrench(self, readings: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        """Return fz_n, mx_nm, my_nm (n,) about the insole's origin from COLUMNS (n,); NaN where any reading is NaN.

        Raises FileError if a column is missing.
        """
        missing = [name for name in COLUMNS if name not in readings]
        if missing:
            raise FileError(
                f"expected the columns {', '.join(COLUMNS)} of a force shoe, missing: {', '.join(missing)}; "
                "rename the columns, or record without --shoe if the instrument already reports one wrench"
            )
        force, moment = np.zeros((2, len(readings[COLUMNS[0]]), 3))
        for name, sensor in (("front", self.front), ("rear", self.rear)):
            sensor_readings = np.stack([readings[f"{name}_{axis}"] for axis in _AXES], axis=-1)
            sign = 1.0 if sensor.reports == "ground_on_foot" else -1.0
            signed_rotation = sign * sensor.rotation()
            f, m = sensor_readings[:, :3] @ signed_rotation.T, sensor_readings[:, 3:] @ signed_rotation.T
            force += f
            moment += m + np.cross(np.array([sensor.x_mm, sensor.y_mm, sensor.z_mm]) * 1e-3, f)
        return {"fz_n": force[:, 2], "mx_nm": moment[:, 0], "my_nm": moment[:, 1]}


def load(path: str | PathLike[str]) -> ShoeSensors:
    """Load the shoe in file `path`; DocumentError lists all problems."""
    return read(path, ShoeSensors, FORMAT)
