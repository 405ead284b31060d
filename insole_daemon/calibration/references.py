"""What the reference instrument said, checked: its unit, whether it moves, its spikes.

The instruments of the issue's paper are a vacuum bag's gauge (Pa) and a shoe on six-axis sensors (N, N·m).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..recording.document import REFERENCE_COLUMNS
from ..recording.loading import FootRecording
from ..skin.geometry import PRESSURE_TAXELS
from .clock import row_times_s

Array = NDArray[np.float64]

_SAME_EPOCH_S = 3600.0  # nearer than that, two clocks count from the same moment
_SPIKE = 0.2  # of the range: what one or two readings stand out of their neighbours by
ARM_M = 0.05  # on which the range of the force is at least that of a moment: standing still has next to none
_USUAL_PA = 8000.0  # a count
_PLAUSIBLE = 12.0  # times more or less than usual
_UNITS = {
    "chamber": {"bar": 1e5, "kPa": 1e3, "mbar": 1e2, "psi": 6894.76, "MPa": 1e6},
    "shoe": {"kN": 1e3, "kgf": 9.80665, "mN": 1e-3},
}


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """k readings of one, c columns: pressure_pa, or fz_n, mx_nm, my_nm."""

    t_s: Array  # (k,) on its own clock, from near the first cycle on; as if read with the cycles where it has no times
    values: Array  # (k, c) NaN where nothing was said, or a spike


def checked_readings(
    name: str, kind: Literal["chamber", "shoe"], foot: FootRecording, t_s: Array
) -> tuple[Readings, tuple[str, ...]]:
    """The reference of a foot whose cycles are at t_s (n,), and a sentence for each oddity.

    CalibrationError where it says nothing, or what it says cannot be in the unit its column names.
    """
    reference = foot.reference
    assert reference is not None
    names = REFERENCE_COLUMNS[kind]
    values = np.stack([reference[column] for column in names], axis=1)
    there = np.isfinite(values).all(axis=1)
    if np.count_nonzero(there) < 2 or not np.ptp(values[there, 0]) > 0:
        what = f"the same in all of its {np.count_nonzero(there)} readings" if there.any() else "no reading"
        raise CalibrationError(
            f"{name}: expected a reference that moves with the load, found {names[0]} with {what}: "
            "was the instrument switched on, and is it the right column?"
        )
    values, spikes = _without_spikes(values)
    _check_unit(name, kind, names[0], values[:, 0], foot)
    remarks: tuple[str, ...] = ()
    if spikes:
        remarks += (f"{name}: {spikes} readings of the reference stand out of their neighbours: left out as spikes",)
    if reference.time_s is None:
        own_s = row_times_s(t_s, len(values))
        if len(values) != len(t_s):
            has = f"{name}: the reference has no times and {len(values)} rows, the foot {len(t_s)} cycles"
            remarks += (f"{has}: their rates are taken to differ by what fits best",)
        return Readings(own_s, values), remarks
    began_s = float(foot.t_ns[0]) * 1e-9
    origin_s = began_s if abs(reference.time_s[0] - began_s) < _SAME_EPOCH_S else float(reference.time_s[0])
    return Readings(reference.time_s - origin_s, values), remarks


def _without_spikes(values: Array) -> tuple[Array, int]:
    """The values (k, c) with NaN for what stands out of the median of five, and how many readings those are."""
    if len(values) < 5:
        return values, 0
    padded = np.pad(values, ((2, 2), (0, 0)), mode="edge")
    with np.errstate(invalid="ignore"):
        middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0), axis=-1)
        low, high = np.nanpercentile(values, (0.5, 99.5), axis=0)
        span = np.maximum(high - low, 1e-9)
        span[1:] = np.maximum(span[1:], ARM_M * span[0])
        spikes = (np.abs(values - middle) > _SPIKE * span).any(axis=1)
    return np.where(spikes[:, None], np.nan, values), int(np.count_nonzero(spikes))


def _check_unit(name: str, kind: Literal["chamber", "shoe"], column: str, values: Array, foot: FootRecording) -> None:
    """Raise where the taxels' answer would mean a sensor unlike any: the unit is another one then."""
    counts = foot.counts[:, :, PRESSURE_TAXELS].reshape(len(foot), -1).astype(np.float64)
    spread = np.percentile(counts, 99, axis=0) - np.percentile(counts, 1, axis=0)
    if kind == "chamber":
        usual = _USUAL_PA * float(np.median(spread))
    else:
        level = counts.sum(axis=1)
        usual = _USUAL_PA * foot.layout.taxel_area_m2 * float(np.ptp(np.percentile(level, (1, 99))))
    found = float(np.nanmax(values) - np.nanmin(values))
    ratio = found / max(usual, 1e-9)
    if 1 / _PLAUSIBLE < ratio < _PLAUSIBLE:
        return
    likely = [unit for unit, factor in _UNITS[kind].items() if 0.25 < ratio * factor < 4.0]
    hint = f": is that {' or '.join(likely)}? Convert it" if likely else ": is it of this trial, and in that unit?"
    raise CalibrationError(
        f"{name}: expected {column} to change by about {usual:.3g} for what the taxels read, found {found:.3g}{hint}"
    )
