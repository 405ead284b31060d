"""Check and prepare the readings of a reference: its unit, whether it varies, its spikes.

References are the gauge of a vacuum bag (Pa) or a shoe on six-axis sensors (N, N·m).
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

_SAME_EPOCH_S = 3600.0  # two clocks that differ by less have the same epoch
_SPIKE = 0.2  # least deviation of a spike from its neighbours, as a fraction of the range
# A moment's range counts as at least the force's range on this lever, since standing still has hardly any moment.
ARM_M = 0.05
_USUAL_PA = 8000.0  # typical pressure per count
_PLAUSIBLE = 12.0  # largest plausible factor to the typical pressure
_UNITS = {
    "chamber": {"bar": 1e5, "kPa": 1e3, "mbar": 1e2, "psi": 6894.76, "MPa": 1e6},
    "shoe": {"kN": 1e3, "kgf": 9.80665, "mN": 1e-3},
}


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The k readings of one reference in c columns: pressure_pa, or fz_n, mx_nm, my_nm."""

    t_s: Array  # (k,) on its own clock, near 0 at the first cycle; without times, as if read with the cycles
    values: Array  # (k, c) NaN: no reading, or a spike


def check_readings(
    name: str, kind: Literal["chamber", "shoe"], foot: FootRecording, t_s: Array
) -> tuple[Readings, tuple[str, ...]]:
    """Return the reference of a foot with cycles at `t_s` (n,), and a sentence for each irregularity.

    Raises CalibrationError if it is constant or empty, or if its values cannot be in the unit of its column.
    """
    reference = foot.reference
    assert reference is not None
    names = REFERENCE_COLUMNS[kind]
    values = np.stack([reference[column] for column in names], axis=1)
    is_finite = np.isfinite(values).all(axis=1)
    if np.count_nonzero(is_finite) < 2 or not np.ptp(values[is_finite, 0]) > 0:
        what = f"the same in all of its {np.count_nonzero(is_finite)} readings" if is_finite.any() else "no readings"
        raise CalibrationError(
            f"{name}: expected a reference that moves with the load, found {names[0]} with {what}: "
            "was the instrument switched on, and is it the right column?"
        )
    values, spikes = _remove_spikes(values)
    _check_unit(name, kind, names[0], values[:, 0], foot)
    remarks: tuple[str, ...] = ()
    if spikes:
        remarks += (f"{name}: {spikes} readings of the reference deviate from their neighbours: ignored as spikes",)
    if reference.time_s is None:
        own_s = row_times_s(t_s, len(values))
        if len(values) != len(t_s):
            has = f"{name}: the reference has no times and {len(values)} rows, the foot {len(t_s)} cycles"
            remarks += (f"{has}: their rates are taken to differ by what fits best",)
        return Readings(own_s, values), remarks
    began_s = float(foot.t_ns[0]) * 1e-9
    origin_s = began_s if abs(reference.time_s[0] - began_s) < _SAME_EPOCH_S else float(reference.time_s[0])
    return Readings(reference.time_s - origin_s, values), remarks


def _remove_spikes(values: Array) -> tuple[Array, int]:
    """Return the values (k, c) with NaN for readings far from the median of five, and their number."""
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
    """Raise CalibrationError if the taxels' response would be implausible, which means that the unit is wrong."""
    counts = foot.counts[:, :, PRESSURE_TAXELS].reshape(len(foot), -1).astype(np.float64)
    spread = np.percentile(counts, 99, axis=0) - np.percentile(counts, 1, axis=0)
    if kind == "chamber":
        expected = _USUAL_PA * float(np.median(spread))
    else:
        level = counts.sum(axis=1)
        expected = _USUAL_PA * foot.layout.taxel_area_m2 * float(np.ptp(np.percentile(level, (1, 99))))
    change = float(np.nanmax(values) - np.nanmin(values))
    ratio = change / max(expected, 1e-9)
    if 1 / _PLAUSIBLE < ratio < _PLAUSIBLE:
        return
    likely = [unit for unit, factor in _UNITS[kind].items() if 0.25 < ratio * factor < 4.0]
    hint = f": is that {' or '.join(likely)}? Convert it" if likely else ": is it of this trial, and in that unit?"
    raise CalibrationError(
        f"{name}: expected {column} to change by about {expected:.3g} for what the taxels read, "
        f"found {change:.3g}{hint}"
    )
