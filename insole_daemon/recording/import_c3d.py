"""Force plates of a C3D file of motion capture, as the reference of a recording.

Plates of type 2 (six channels) are read: f_z and the moments that the ground exerts on the foot, about the plate's
origin, x as the plate's, z up. Where the insole lies on the plate is not in the file: moments are about the insole's
origin only once `origin_m` says where that is, and the axes only if the insole points along the plate's x.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError
from ..files import unreadable, write_text
from . import reference as references
from .lab import need
from .reference import TIME

_SIX_CHANNELS = 2  # C3D's type of a plate with Fx Fy Fz Mx My Mz
_MM = 1e-3
_TO_NM = {"n*m": 1.0, "nm": 1.0, "n.m": 1.0, "nmm": _MM, "n*mm": _MM, "n.mm": _MM, "": _MM}

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ForcePlate:
    """What a plate measured, n readings: the ground's action on the foot, z up."""

    time_s: Array  # (n,) since the first frame
    f_z_n: Array  # (n,)
    m_x_nm: Array  # (n,) about the plate's origin
    m_y_nm: Array
    frame_of_moments: str  # in words

    def columns(self, origin_m: tuple[float, float] = (0.0, 0.0)) -> dict[str, Array]:
        """Columns of a reference.csv; `origin_m`: the insole's origin, x and y from the plate's."""
        x_m, y_m = origin_m
        return {
            TIME: self.time_s,
            "fz_n": self.f_z_n,
            "mx_nm": self.m_x_nm - y_m * self.f_z_n,
            "my_nm": self.m_y_nm + x_m * self.f_z_n,
        }


def read_force_plates(source: Path) -> list[ForcePlate]:
    """The plates of the file `source`; FileError where it is no C3D file or has none of type 2."""
    c3d = need("c3d", "c3d", "importing C3D")
    try:
        with open(source, "rb") as file:
            reader = c3d.Reader(file)
            analog = np.concatenate([values for _, _, values in reader.read_frames()], axis=1)
            rate_hz = float(reader.analog_rate)
            types = np.atleast_1d(reader.get("FORCE_PLATFORM:TYPE").int16_array).ravel()
            channels = np.atleast_2d(reader.get("FORCE_PLATFORM:CHANNEL").int16_array).reshape(len(types), -1)
            units = reader.get("ANALOG:UNITS")
            words = [str(word).strip().lower() for word in np.ravel(units.string_array)] if units is not None else []
    except OSError as error:
        raise FileError(f"{source}: {unreadable(error)}") from error
    except Exception as error:  # it raises what its parser stumbles over
        what = f"{type(error).__name__}: {error}"
        raise FileError(
            f"{source}: expected a C3D file with force plates, found one that cannot be read: {what}"
        ) from error
    plates = []
    for kind, own in zip(types.tolist(), channels, strict=True):
        if kind != _SIX_CHANNELS:
            continue
        rows = own[:6].astype(int) - 1
        unit = words[rows[3]] if len(words) > rows[3] else ""
        if unit not in _TO_NM:
            raise FileError(f"{source}: ANALOG:UNITS: expected moments in Nmm or Nm, found {unit!r}")
        # Channels are what the foot does to the plate, whose z points down.
        plates.append(ForcePlate(
            np.arange(analog.shape[1]) / rate_hz, analog[rows[2]].astype(np.float64),
            -analog[rows[3]] * _TO_NM[unit], analog[rows[4]] * _TO_NM[unit], "x as the plate's, y against it, z up",
        ))  # fmt: skip
    if not plates:
        found = ", ".join(map(str, types.tolist())) or "no plate"
        raise FileError(f"{source}: expected a force plate of type 2 (six channels), found types: {found}")
    return plates


def write_reference(plate: ForcePlate, out: Path, origin_m: tuple[float, float] = (0.0, 0.0)) -> None:
    """Write `out`, a reference.csv of kind shoe on a clock of its own: name it in recording.yaml."""
    write_text(out, references.text(plate.columns(origin_m)))
