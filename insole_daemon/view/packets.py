"""The packet of one cycle of one foot for the page: a fixed little-endian head, then arrays by taxel.

page/packets.js is the other half of this file.
"""

from __future__ import annotations

import math
import struct

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import PRESSURE_TAXELS
from ..wire.messages import Meta, Pressure, Raw, Wrench
from .other_sources import OtherValues

HEAD = struct.Struct("<BBHI dd 13f 4x")  # 1: a cycle; foot; n_triangles; seq; two times in ms; what is not of one taxel
UNIT_PA = 20.0  # of a pressure in the packet
UNKNOWN = 0xFFFF  # an unknown pressure
_MOST = UNKNOWN - 1
_LARGEST = float(np.finfo(np.float32).max)
_SEQ_BITS = 0xFFFF_FFFF

# Flags of a taxel; 0 may be read as pressure.
INVALID, STALE, SATURATED = 1, 2, 4


def cycle_packet(meta: Meta, raw: Raw, pressure: Pressure, wrench: Wrench, other_values: OtherValues) -> bytes:
    """Return the packet of one cycle; all three messages must be of the same cycle."""
    ages = raw.age_ms
    floats = (
        *map(_float, (wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm, wrench.cop_x_m, wrench.cop_y_m)),
        _float(wrench.valid_fraction),
        math.nan if np.isnan(ages).all() else float(np.nanmax(ages)),
        *map(_float, (*other_values.reference, *other_values.model)),
    )
    head = HEAD.pack(
        1, ("left", "right").index(raw.foot), raw.n_triangles, raw.seq & _SEQ_BITS,
        raw.t_ns * 1e-6, raw.t_published_ns * 1e-6, *floats,
    )  # fmt: skip
    units = _units(pressure.pressure_pa)
    predicted = np.full_like(units, UNKNOWN) if other_values.pressure_pa is None else _units(other_values.pressure_pa)
    return b"".join((head, units.tobytes(), predicted.tobytes(), raw.counts.tobytes(), _flags(meta, raw).tobytes()))


def _float(value: float | None) -> float:
    return math.nan if value is None or abs(value) > _LARGEST else value


def _units(pressure_pa: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Return pressures in UNIT_PA, (n_triangles, 12), clipped at 0."""
    with np.errstate(invalid="ignore"):
        units = np.clip(np.rint(pressure_pa / UNIT_PA), 0, _MOST)
    return np.where(np.isnan(pressure_pa), UNKNOWN, units).astype("<u2")


def _flags(meta: Meta, raw: Raw) -> NDArray[np.uint8]:
    """Return the flags of each pressure taxel, (n_triangles, 12)."""
    flags = np.where(raw.valid, 0, INVALID).astype(np.uint8)
    # A comparison with NaN is False, so a taxel that was never received is stale.
    flags[~(raw.age_ms <= meta.stale_after_ms)] |= STALE
    answers = ~np.isnan(raw.age_ms) & (raw.status & 0xF == 0)
    flags[(raw.counts == 0) & (raw.valid == 0) & answers[:, None]] |= SATURATED
    flags[:, ~PRESSURE_TAXELS] = 0
    return flags
