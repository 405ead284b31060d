"""The simulated insole: its constants, all in insole-reference.yaml, and a true static curve per taxel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from ..documents import Reading, Section, read
from ..physics import portable
from ..physics.calibration import Calibration
from ..physics.draws import Drawn, Draws
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..skin.layout import Layout

FORMAT = "insole-reference/1"
FILE = Path(__file__).with_name("insole-reference.yaml")

# Unit, lowest and highest allowed value; a file must have all of them.
_CONSTANTS: Mapping[str, tuple[str, float, float]] = {
    "pa_per_count": ("Pa", 100.0, 1e6),
    "curve_square": ("1/count", 0.0, 0.01),  # with the bound of curve_cube, a curve that always increases
    "curve_cube": ("1/count2", 0.0, 0.001),
    "sensitivity_spread": ("1", 0.0, 0.3),
    "count_bits": ("1", 8, 8),
    "noise_count": ("count", 0.0, 20.0),
    "pad_noise_count": ("count", 0.0, 20.0),
    "rest_code": ("code", 5_000, 60_000),
    "rest_code_spread": ("code", 0, 5_000),
    "rest_c": ("°C", -20.0, 60.0),
    "pad_count_per_k": ("count/K", 0.0, 50.0),
    "clock_ppm": ("ppm", 0.0, 1_000.0),
    "boot_s": ("s", 0.01, 60.0),
    "mtb4_queue_frames": ("frame", 1, 1_000),
    "mtb3_half_us": ("µs", 1.0, 1_000.0),
    "mtb3_busy_ms": ("ms", 0.1, 50.0),
    "shoe_warms_k": ("K", -20.0, 30.0),
    "shoe_warms_in_s": ("s", 1.0, 1e5),
    "shoe_rate_hz": ("Hz", 1.0, 10_000.0),
    "shoe_force_noise_n": ("N", 0.0, 100.0),
    "shoe_moment_noise_nm": ("Nm", 0.0, 20.0),
    "shoe_drift_n": ("N", 0.0, 500.0),
    "shoe_drift_nm": ("Nm", 0.0, 50.0),
    "gauge_rate_hz": ("Hz", 1.0, 10_000.0),
    "gauge_noise_pa": ("Pa", 0.0, 20_000.0),
    "gauge_drift_pa": ("Pa", 0.0, 50_000.0),
    "reference_offset_s": ("s", 0.0, 60.0),
    "reference_ppm": ("ppm", 0.0, 1_000.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Constant(Section):
    value: float
    unit: str
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _File(Section):
    constants: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ReferenceInsole:
    """The constants by name; insole-reference.yaml states meaning, unit and source of each."""

    pa_per_count: float
    curve_square: float
    curve_cube: float
    sensitivity_spread: float
    count_bits: float
    noise_count: float
    pad_noise_count: float
    rest_code: float
    rest_code_spread: float
    rest_c: float
    pad_count_per_k: float
    clock_ppm: float
    boot_s: float
    mtb4_queue_frames: float
    mtb3_half_us: float
    mtb3_busy_ms: float
    shoe_warms_k: float
    shoe_warms_in_s: float
    shoe_rate_hz: float
    shoe_force_noise_n: float
    shoe_moment_noise_nm: float
    shoe_drift_n: float
    shoe_drift_nm: float
    gauge_rate_hz: float
    gauge_noise_pa: float
    gauge_drift_pa: float
    reference_offset_s: float
    reference_ppm: float

    def sensitivities(self, draws: Draws, *shape: int) -> NDArray[np.float64]:
        """Draw the taxels' activations relative to the nominal one, in the given shape."""
        return portable.exp(self.sensitivity_spread * draws.normal(*shape))

    def calibration(self, layout: Layout, boards: Sequence[Board], seed: int) -> Calibration:
        """Draw the true static curves of an insole from `seed`, board by board.

        `boards` must be all those of the layout; their no-load and shift give the unloaded counts. Coefficients have
        ten digits, so that a file contains them exactly.
        """
        settings = {board.address: board for board in boards}
        usable = np.tile(PRESSURE_TAXELS, (len(layout), 1))
        drawn = {address: self.sensitivities(Draws(seed, Drawn.CURVES, address), 16, N_TAXELS) for address in settings}
        sensitivity = np.array([drawn[t.board][t.triangle] for t in layout.triangles])
        powers = (np.ones_like(sensitivity), self.curve_square / sensitivity, self.curve_cube / sensitivity**2)
        slopes = [self.pa_per_count / sensitivity * power for power in powers]
        coefficients = _round_to_ten_digits(np.stack([np.zeros_like(sensitivity), *slopes], axis=-1))
        unloaded_count = [
            settings[t.board].no_load + (1 - 2.0 ** -settings[t.board].shift) / 2  # mean effect of the floor
            for t in layout.triangles
        ]
        return Calibration(
            foot=layout.foot,
            baseline_count=np.where(usable, np.array(unloaded_count)[:, None], np.nan),
            coefficients_pa=np.where(usable[..., None], coefficients, np.nan),
            covariance_pa2=None,
            usable=usable,
            provenance={"by": "the simulator: the true static curves of this insole", "seed": seed},
        )


@cache
def reference_insole() -> ReferenceInsole:
    """Return the constants that come with the package."""
    return load(FILE)


def load(path: str | PathLike[str]) -> ReferenceInsole:
    """Load the constants in file `path`; DocumentError lists all problems with the allowed values."""
    values: dict[str, float] = {}

    def check(reading: Reading) -> None:
        raw = reading.document.get("constants")
        if not isinstance(raw, dict):
            return
        for name in raw.keys() - _CONSTANTS.keys():
            reading.problem(("constants", name), f"unknown constant: known are {', '.join(_CONSTANTS)}")
        for name, (unit, low, high) in _CONSTANTS.items():
            key = ("constants", name)
            if name not in raw:
                reading.problem(key, f"missing key: expected a number from {low:g} to {high:g} {unit}, and its source")
                continue
            constant = reading.section(_Constant, raw[name], key)
            if not isinstance(constant, _Constant):
                continue
            if constant.unit != unit:
                reading.problem((*key, "unit"), f'expected the unit "{unit}", found "{constant.unit}"')
            if not low <= constant.value <= high:
                what = f"expected a number from {low:g} to {high:g} {unit}, found {constant.value:g}"
                reading.problem((*key, "value"), what)
            if not constant.source.strip():
                reading.problem((*key, "source"), "expected where the number is from, or that it is an assumption")
            values[name] = constant.value

    read(path, _File, FORMAT, check)
    return ReferenceInsole(**values)


def _round_to_ten_digits(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([float(f"{value:.10g}") for value in values.ravel()]).reshape(values.shape)
