"""Import force plates from a C3D file of motion capture as the reference of a recording.

Reads plates of types 1 to 4: f_z and the moments of the ground's action on the foot about the centre of the plate's
surface, x as the plate's, z up. The file does not contain the insole's position and heading on the plate; they are
given by `origin_m` and `heading_deg`.
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
from .plate_types import LOADS, N_CHANNELS, OF_CENTRE, OF_CORNERS, WITH_MATRIX
from .reference import TIME

LEAST_FORCE_N = 20.0  # least force of a contact on a plate
SWING_S = 0.3  # kept before and after each contact; the foot is in the air for longer
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


def read_force_plates(source: Path) -> dict[int, ForcePlate]:
    """Read the plates of types 1 to 4 in `source`, by their number in the file; FileError if there is none."""
    content = _read_content(source)
    plates = {
        number: _read_plate(source, content, number, kind)
        for number, kind in enumerate(content.types, 1)
        if kind in LOADS
    }
    if not plates:
        listed_types = ", ".join(map(str, content.types)) or "no plate"
        raise FileError(f"{source}: expected a force plate of types 1 to 4, found types: {listed_types}")
    return plates


@dataclass(frozen=True, slots=True, eq=False)
class _Content:
    """What a C3D file holds of its p plates."""

    analog: Array  # (channels, n), scaled
    rate_hz: float
    units: list[str]  # of the channels
    types: list[int]  # (p,)
    channels: NDArray[np.int16]  # (p, most channels of a plate), from 1
    origins: NDArray[np.float32]  # (p, 3)
    matrices: NDArray[np.float32]  # (p, columns, rows): the file stores columns
    to_m: float


def _read_content(source: Path) -> _Content:
    c3d = need("c3d", "c3d", "importing C3D")
    try:
        with open(source, "rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # c3d warns about blocks that other writers append
            reader = c3d.Reader(file)
            analog = np.concatenate([values for _, _, values in reader.read_frames()], axis=1).astype(np.float64)
            kinds = reader.get("FORCE_PLATFORM:TYPE")  # for one plate some writers store a scalar
            types = kinds.int16_array.ravel() if kinds.dimensions else np.array([kinds.int16_value])
            matrices = reader.get("FORCE_PLATFORM:CAL_MATRIX") if WITH_MATRIX in types else None
            stored = np.zeros((0, 0), np.float32) if matrices is None else matrices.float_array
            used = reader.get("FORCE_PLATFORM:USED")  # a file may describe more plates than it has signals of
            return _Content(
                analog,
                float(reader.analog_rate),
                _lowercase_words(reader.get("ANALOG:UNITS")),
                types.tolist()[: None if used is None else used.int16_value],
                reader.get("FORCE_PLATFORM:CHANNEL").int16_array.reshape(len(types), -1),
                reader.get("FORCE_PLATFORM:ORIGIN").float_array.reshape(len(types), -1),
                stored.reshape(-1, *stored.shape[-2:]) if stored.size else np.zeros((0, 0, 0), np.float32),
                1.0 if _lowercase_words(reader.get("POINT:UNITS"))[:1] == ["m"] else _MM,
            )
    except OSError as error:
        raise FileError(f"{source}: {unreadable(error)}") from error
    except Exception as error:  # c3d raises exceptions of many types
        what = str(error) or type(error).__name__
        raise FileError(
            f"{source}: expected a C3D file with force plates, found one that cannot be read: {what}"
        ) from error


def _read_plate(source: Path, content: _Content, number: int, kind: int) -> ForcePlate:
    """Return plate `number`; FileError if its parameters do not fit its type."""
    rows = content.channels[number - 1, : N_CHANNELS[kind]].astype(int) - 1
    if len(rows) < N_CHANNELS[kind] or rows.min() < 0 or rows.max() >= len(content.analog):
        raise FileError(
            f"{source}: FORCE_PLATFORM:CHANNEL: expected {N_CHANNELS[kind]} of {len(content.analog)} analog channels "
            f"for plate {number}, which is of type {kind}, found {(rows + 1).tolist()}"
        )
    signals = content.analog[rows]
    if kind == WITH_MATRIX:
        if len(content.matrices) < number or min(content.matrices.shape[1:]) < len(rows):
            raise FileError(f"{source}: FORCE_PLATFORM:CAL_MATRIX: plate {number} is of type 4, found no matrix for it")
        signals = content.matrices[number - 1, : len(rows), : len(rows)].T.astype(np.float64) @ signals
    if kind != OF_CORNERS:
        unit = content.units[rows[3]] if len(content.units) > rows[3] else ""
        signals[3:] *= _to_si(source, kind, unit, content.to_m)
    f_z, m_x, m_y = LOADS[kind](signals, content.origins[number - 1] * content.to_m)
    # With z up, the ground's action on the foot is f_z, −m_x and m_y of the foot's action on the plate with z down.
    return ForcePlate(np.arange(signals.shape[1]) / content.rate_hz, f_z, -m_x, m_y)


def _to_si(source: Path, kind: int, unit: str, to_m: float) -> float:
    """Return the factor from channels 4 to 6 to m or N m; a matrix makes moments in the unit of the points."""
    if kind == WITH_MATRIX:
        return to_m
    if kind == OF_CENTRE:
        return {"m": 1.0, "mm": _MM}.get(unit, to_m)
    if unit not in _TO_NM:
        raise FileError(f"{source}: ANALOG:UNITS: expected moments in Nmm or Nm, found {unit!r}")
    return _TO_NM[unit]


def _lowercase_words(parameter: Any) -> list[str]:
    return [str(word).strip().lower() for word in np.ravel(parameter.string_array)] if parameter is not None else []
