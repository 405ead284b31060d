"""Convert a triangle's twelve 16-bit words to 8-bit counts and flags, as the firmware does.

    value  = raw16 − baseline16 − drift
    count  = 255                     where value ≤ −((255 − no_load) << shift)
             0                       where value ≥ no_load << shift
             no_load − (value >> shift)   elsewhere; >> is arithmetic, a floor
    flag   = value ≤ −2·((255 − no_load) << shift)  or  value ≥ 2·(no_load << shift)

    dT      = raw16 − baseline16 of pad 6
    drift_k = ((|dT| >> 2) · gain_k) >> 5, with the sign of dT: about dT · gain_k / 128

For dT < 0 an MTB4 shifts the negated product, which rounds down; an MTB3 negates the shifted product. On an MTB3 all
arithmetic is 16 bits wide and wraps; products and |dT| are unsigned there.

Source: robotology/icub-firmware, embot_app_application_theSkin.cpp 325–467 (MTB4, 32-bit arithmetic), mtb3/main_V3.c
898–993.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import THERMAL_PADS
from ..skin.identifiers import ERROR_NO_ACK, ERROR_NOT_CONNECTED

OPEN_LINE = 0xFFFF  # every word of a missing triangle: its data line is pulled up

Gains = tuple[int, ...]  # 12, in 1/128
GAINS_TYPE_0: Gains = (70, 96, 83, 38, 38, 70, 0, 45, 77, 164, 0, 77)
GAINS_TYPE_8: Gains = (58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86)

_COMPENSATING_PAD = THERMAL_PADS[0]  # the firmware does not use the other pad
_FLAG_BITS = (1 << np.arange(4, 16)).astype(np.int64)  # out-of-range flag of taxel k is bit 4 + k


def digitise(
    raw16: NDArray[np.int64],
    baseline16: NDArray[np.int64],
    no_load: int,
    shift: NDArray[np.int64],
    gains: Gains | None = None,
    is_16_bit: bool = False,
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Return counts (…, 12) and status words (…) for the words `raw16` (…, 12).

    `baseline16` and `shift` are broadcast against `raw16`; a shift per triangle has the shape (n_triangles, 1). `gains`
    are those of the temperature compensation, None for none. `is_16_bit` selects the arithmetic of an MTB3.
    """
    value = raw16 - baseline16
    if gains is not None:
        value -= compensation_codes(raw16, baseline16, gains, is_16_bit)
    top = no_load << shift
    bottom = (no_load - 255) << shift
    top_flag, bottom_flag = 2 * top, 2 * bottom
    if is_16_bit:
        value, top, bottom = _wrap_16_bit(value), _wrap_16_bit(top), _wrap_16_bit(bottom)
        top_flag, bottom_flag = _wrap_16_bit(top_flag), _wrap_16_bit(bottom_flag)
        # If the limits have wrapped, both conditions may hold; the firmware's later one takes precedence.
        inside = no_load - (value >> shift) & 0xFF
        counts = np.where(value >= top, 0, np.where(value <= bottom, 255, inside)).astype(np.uint8)
    else:
        counts = clamp_counts(value, no_load, shift)
    flags = (value <= bottom_flag) | (value >= top_flag)
    unconnected = (raw16 == OPEN_LINE).all(axis=-1)
    status = np.where(unconnected, ERROR_NOT_CONNECTED, 0)
    status |= np.where(((raw16 == 0) & (baseline16 != 0)).any(axis=-1), ERROR_NO_ACK, 0)
    if flags.any():
        status |= flags @ _FLAG_BITS
    return counts, status.astype(np.uint16)


def clamp_counts(
    value: NDArray[np.int64], no_load: int | NDArray[np.int64], shift: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """Return the counts of `value` (…), in codes relative to baseline and drift, without flags."""
    # Between the firmware's two limits the formula stays within 0..255, so clamping gives the same result.
    return np.minimum(np.maximum(no_load - (value >> shift), 0), 255).astype(np.uint8)


def codes_of(count: NDArray[np.float64], no_load: NDArray[np.int64], shift: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the `value` (…), with its fraction, whose mean count is `count` (…); the floor adds (1 − 2^−shift)/2."""
    step = np.ldexp(1.0, shift)
    codes: NDArray[np.float64] = (no_load - count) * step + (step - 1) / 2
    return codes


def count_of(codes: NDArray[np.float64], no_load: NDArray[np.int64], shift: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean count of `codes` (…), the inverse of `codes_of`."""
    step = np.ldexp(1.0, shift)
    count: NDArray[np.float64] = no_load - (codes - (step - 1) / 2) / step
    return count


def compensation_codes(
    raw16: NDArray[np.int64], baseline16: NDArray[np.int64], gains: Gains, is_16_bit: bool = False
) -> NDArray[np.int64]:
    """Return (…, 12) the codes that the temperature compensation subtracts; arguments as in `digitise`."""
    change = (raw16 - baseline16)[..., _COMPENSATING_PAD, None]
    product = (np.abs(change) >> 2) * np.array(gains, np.int64)
    if is_16_bit:
        magnitude = (product & 0xFFFF) >> 5
        codes: NDArray[np.int64] = np.where(change > 0, magnitude, -magnitude)
    else:
        codes = np.where(change > 0, product, -product) >> 5
    return codes


def _wrap_16_bit(value: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the values wrapped to signed 16-bit numbers."""
    wrapped: NDArray[np.int64] = (value + 0x8000 & 0xFFFF) - 0x8000
    return wrapped


def low_bytes(raw16: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Return counts (…, 12) and status words (…) of the raw test mode, skin type 7."""
    return (raw16 & 0xFF).astype(np.uint8), np.zeros(raw16.shape[:-1], np.uint16)
