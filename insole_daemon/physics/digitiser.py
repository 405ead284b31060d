"""What the firmware makes of a triangle's twelve 16-bit words: the 8-bit counts and their flags.

    value  = raw16 − baseline16 − drift
    count  = 255                     where value ≤ −((255 − no_load) << shift)
             0                       where value ≥ no_load << shift
             no_load − (value >> shift)   elsewhere; >> is arithmetic, a floor
    flag   = value ≤ −2·((255 − no_load) << shift)  or  value ≥ 2·(no_load << shift)

    dT      = raw16 − baseline16 of pad 6
    drift_k = ((|dT| >> 2) · gain_k) >> 5, with the sign of dT: about dT · gain_k / 128

Where dT < 0 an MTB4 shifts the negated product, which rounds down, an MTB3 negates the shifted one. On an MTB3
all of it is 16 bits wide and wraps; products and |dT| are unsigned there.

Source: robotology/icub-firmware, embot_app_application_theSkin.cpp 325–467 (MTB4, 32-bit arithmetic),
mtb3/main_V3.c 898–993.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import THERMAL_PADS
from ..skin.identifiers import ERROR_NO_ACK, ERROR_NOT_CONNECTED

OPEN_LINE = 0xFFFF  # every word of a triangle that is not there: a pulled-up data line

Gains = tuple[int, ...]  # 12, in 1/128
GAINS_TYPE_0: Gains = (70, 96, 83, 38, 38, 70, 0, 45, 77, 164, 0, 77)
GAINS_TYPE_8: Gains = (58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86)

_COMPENSATING_PAD = THERMAL_PADS[0]  # the other one is never used
_FLAG_BITS = (1 << np.arange(4, 16)).astype(np.int64)  # out-of-range flag of taxel k is bit 4 + k


def digitise(
    raw16: NDArray[np.int64],
    baseline16: NDArray[np.int64],
    no_load: int,
    shift: NDArray[np.int64],
    gains: Gains | None = None,
    narrow: bool = False,
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Counts (…, 12) and status words (…) of the words `raw16` (…, 12).

    `baseline16` and `shift` (broadcast against `raw16`; a shift is a triangle's, so (n_triangles, 1)).
    `gains` of the temperature compensation, None for none; `narrow`: the 16-bit arithmetic of an MTB3.
    """
    value = raw16 - baseline16
    if gains is not None:
        value -= drift(raw16, baseline16, gains, narrow)
    top = no_load << shift
    bottom = (no_load - 255) << shift
    top_flag, bottom_flag = 2 * top, 2 * bottom
    if narrow:
        value, top, bottom = _wrapped(value), _wrapped(top), _wrapped(bottom)
        top_flag, bottom_flag = _wrapped(top_flag), _wrapped(bottom_flag)
        # With limits that have wrapped both rules may hold: the later one in the firmware wins.
        inside = no_load - (value >> shift) & 0xFF
        counts = np.where(value >= top, 0, np.where(value <= bottom, 255, inside)).astype(np.uint8)
    else:
        counts = clamped(value, no_load, shift)
    flags = (value <= bottom_flag) | (value >= top_flag)
    unconnected = (raw16 == OPEN_LINE).all(axis=-1)
    status = np.where(unconnected, ERROR_NOT_CONNECTED, 0)
    status |= np.where(((raw16 == 0) & (baseline16 != 0)).any(axis=-1), ERROR_NO_ACK, 0)
    if flags.any():
        status |= flags @ _FLAG_BITS
    return counts, status.astype(np.uint16)


def clamped(value: NDArray[np.int64], no_load: int | NDArray[np.int64], shift: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Counts of `value` (…), the codes that are left of the baseline and of the temperature; no flags."""
    # Within the two pins the formula cannot leave 0..255, so clamping is the same as the firmware's rules.
    return np.minimum(np.maximum(no_load - (value >> shift), 0), 255).astype(np.uint8)


def codes_of(count: NDArray[np.float64], no_load: NDArray[np.int64], shift: NDArray[np.int64]) -> NDArray[np.float64]:
    """The `value` (…), with its fraction, that reads `count` (…) on average: a floor adds (1 − 2^−shift)/2."""
    step = np.ldexp(1.0, shift)
    codes: NDArray[np.float64] = (no_load - count) * step + (step - 1) / 2
    return codes


def count_of(codes: NDArray[np.float64], no_load: NDArray[np.int64], shift: NDArray[np.int64]) -> NDArray[np.float64]:
    """What `codes` (…) read on average: `codes_of` backwards."""
    step = np.ldexp(1.0, shift)
    count: NDArray[np.float64] = no_load - (codes - (step - 1) / 2) / step
    return count


def drift(
    raw16: NDArray[np.int64], baseline16: NDArray[np.int64], gains: Gains, narrow: bool = False
) -> NDArray[np.int64]:
    """(…, 12) codes of the temperature compensation; see the module for the arguments."""
    change = (raw16 - baseline16)[..., _COMPENSATING_PAD, None]
    product = (np.abs(change) >> 2) * np.array(gains, np.int64)
    if narrow:
        size = (product & 0xFFFF) >> 5
        compensation: NDArray[np.int64] = np.where(change > 0, size, -size)
    else:
        compensation = np.where(change > 0, product, -product) >> 5
    return compensation


def _wrapped(value: NDArray[np.int64]) -> NDArray[np.int64]:
    """As a signed number of 16 bits holds it."""
    wrapped: NDArray[np.int64] = (value + 0x8000 & 0xFFFF) - 0x8000
    return wrapped


def low_bytes(raw16: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """What stands for counts (…, 12) and status words (…) in the raw test mode, skin type 7."""
    return (raw16 & 0xFF).astype(np.uint8), np.zeros(raw16.shape[:-1], np.uint16)
