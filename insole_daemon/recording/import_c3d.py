"""Import force plates from a C3D file of motion capture as the reference of a recording.

Reads plates of type 2 (six channels): f_z and the moments of the ground's action on the foot about the centre of the
plate's surface, x as the plate's, z up. The file does not contain the insole's position and heading on the plate; they
are given by `origin_m` and `heading_deg`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError
from ..files import unreadable
from .lab import need
from .reference import TIME

LEAST_FORCE_N = 20.0  # least force of a contact on a plate
SWING_S = 0.3  # kept before and after each contact; the foot is in the air for longer
_SIX_CHANNELS = 2  # C3D's type of a plate with Fx Fy Fz Mx My Mz
_MM = 1e-3
_TO_NM = {"n*m": 1.0, "nm": 1.0, "n.m": 1.0, "nmm": _MM, "n*mm": _MM, "n.mm": _MM, "": _MM}

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ForcePlate:
    """The n readings of a plate: the ground's action on the foot, z up."""

    time_s: Array  # (n,) since the first frame
    f_z_n: Array  # (n,)
    m_x_nm: Array  # (n,) about the centre of the plate's surface
    m_y_nm: Array

    def columns(self, origin_m: tuple[float, float] = (0.0, 0.0), heading_deg: float = 0.0) -> dict[str, Array]:
        """Return the columns of a reference.csv, in the frame of an insole on the plate.

        `origin_m`: the insole's origin from the plate's centre, along the plate's x and to the left of it;
        `heading_deg`: the direction of the toes, counter-clockwise from the plate's x, seen from above.
        """
        x_m, y_m = origin_m
        along, across = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
        m_x, m_y = self.m_x_nm - y_m * self.f_z_n, self.m_y_nm + x_m * self.f_z_n
        return {
            TIME: self.time_s,
            "fz_n": self.f_z_n,
            "mx_nm": along * m_x + across * m_y,
            "my_nm": along * m_y - across * m_x,
        }

    def contact_columns(self, origin_m: tuple[float, float], heading_deg: float) -> dict[str, Array]:
        """Return `columns` for contacts and the swing around each; at other times the foot may be beside the plate."""
        contact_s = self.time_s[self.f_z_n >= LEAST_FORCE_N]
        after = np.searchsorted(contact_s, self.time_s)
        padded_s = np.concatenate([[-np.inf], contact_s, [np.inf]])
        near = np.minimum(self.time_s - padded_s[after], padded_s[after + 1] - self.time_s) <= SWING_S
        return {name: column[near] for name, column in self.columns(origin_m, heading_deg).items()}


def read_force_plates(source: Path) -> list[ForcePlate]:
    """Read the plates of `source`; FileError if it is no C3D file or has no plate of type 2."""
    c3d = need("c3d", "c3d", "importing C3D")
    try:
        with open(source, "rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # c3d warns about blocks that other writers append
            reader = c3d.Reader(file)
            analog = np.concatenate([values for _, _, values in reader.read_frames()], axis=1).astype(np.float64)
            rate_hz = float(reader.analog_rate)
            kinds = reader.get("FORCE_PLATFORM:TYPE")  # for one plate some writers store a scalar
            types = kinds.int16_array.ravel() if kinds.dimensions else np.array([kinds.int16_value])
            channels = reader.get("FORCE_PLATFORM:CHANNEL").int16_array.reshape(len(types), -1)
            origins = reader.get("FORCE_PLATFORM:ORIGIN").float_array.reshape(len(types), -1)
            analog_units = _lowercase_words(reader.get("ANALOG:UNITS"))
            to_m = 1.0 if _lowercase_words(reader.get("POINT:UNITS"))[:1] == ["m"] else _MM
    except OSError as error:
        raise FileError(f"{source}: {unreadable(error)}") from error
    except Exception as error:  # c3d raises exceptions of many types
        what = str(error) or type(error).__name__
        raise FileError(
            f"{source}: expected a C3D file with force plates, found one that cannot be read: {what}"
        ) from error
    plates = []
    for kind, plate_channels, origin in zip(types.tolist(), channels, origins, strict=True):
        if kind != _SIX_CHANNELS:
            continue
        rows = plate_channels[:6].astype(int) - 1
        unit = analog_units[rows[3]] if len(analog_units) > rows[3] else ""
        if unit not in _TO_NM:
            raise FileError(f"{source}: ANALOG:UNITS: expected moments in Nmm or Nm, found {unit!r}")
        # The file holds the foot's action on the plate, z down, so its surface has a negative z. A file whose origin
        # has a positive z gives the opposite vector.
        f_x, f_y, f_z = analog[rows[:3]]
        m_x, m_y = analog[rows[3:5]] * _TO_NM[unit]
        x_m, y_m, z_m = origin * to_m * (-1.0 if origin[2] > 0 else 1.0)
        to_centre_x, to_centre_y = y_m * f_z - z_m * f_y, z_m * f_x - x_m * f_z
        plates.append(ForcePlate(np.arange(analog.shape[1]) / rate_hz, f_z, -(m_x - to_centre_x), m_y - to_centre_y))
    if not plates:
        listed_types = ", ".join(map(str, types.tolist())) or "no plate"
        raise FileError(f"{source}: expected a force plate of type 2 (six channels), found types: {listed_types}")
    return plates


def _lowercase_words(parameter: Any) -> list[str]:
    return [str(word).strip().lower() for word in np.ravel(parameter.string_array)] if parameter is not None else []
