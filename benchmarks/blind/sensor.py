"""The sensors of one insole: their curves, their noise, and what their calibration file believes of them."""

import json
from dataclasses import dataclass

import numpy as np

from benchmarks.blind.geometry import PRESSURE_TAXELS, Geometry
from benchmarks.blind.ranges import draw


@dataclass(frozen=True)
class Sensors:
    """Arrays over (28 triangles, 12 slots); pads have a row like the others and no use for it."""

    sensitivity: np.ndarray  # count/Pa at rest
    half_pa: np.ndarray  # activation = sensitivity P / (1 + P / half)
    offset: np.ndarray  # count, of the rest value from no-load
    noise: np.ndarray  # count, standard deviation before rounding
    spread: np.ndarray  # of material effects about 1
    pad_count_per_k: float
    shift: int
    no_load: int
    believed_gain: np.ndarray  # of the calibration's activation over the true one
    believed_offset: np.ndarray  # count, error of the calibration's baseline

    def activation(self, pressure: np.ndarray, triangle: int) -> np.ndarray:
        """Counts of the twelve taxels of `triangle` under the effective load (n, 12), Pa."""
        half = self.half_pa[triangle]
        return self.sensitivity[triangle] * pressure / (1 + np.maximum(pressure, -0.2 * half) / half)

    @property
    def rest(self) -> np.ndarray:
        """Mean of the byte at rest: the floor of the shift rounds the activation down by (1 - 2^-shift)/2."""
        return self.no_load + self.offset + (1 - 2.0**-self.shift) / 2

    @property
    def noise_of_byte(self) -> np.ndarray:
        """Standard deviation of the byte, rounding included."""
        return np.sqrt(self.noise**2 + 1 / 12)


def sensors(rng: np.random.Generator) -> Sensors:
    shape = (28, 12)
    spread = draw(rng, "insole", "taxel_spread")
    effect_spread = draw(rng, "insole", "effect_spread")
    gain_error = draw(rng, "insole", "believed_gain_error")
    offset_error = draw(rng, "insole", "believed_offset_error_count")
    half = 1e3 * draw(rng, "insole", "half_activation_kpa")
    low, high = 1.0, draw(rng, "insole", "noise_count")
    return Sensors(
        sensitivity=1e-3
        * draw(rng, "insole", "sensitivity_count_per_kpa")
        * np.clip(np.exp(spread * rng.standard_normal(shape)), 0.6, 1.4),
        half_pa=half * np.exp(0.1 * rng.standard_normal(shape)),
        offset=rng.uniform(-4, 4, shape) * 0.6,
        noise=rng.uniform(low, max(high, low + 0.02), shape),
        spread=np.clip(1 + effect_spread * rng.standard_normal(shape), 0.6, 1.4),
        pad_count_per_k=draw(rng, "insole", "pad_count_per_k"),
        shift=draw(rng, "insole", "shift"),
        no_load=draw(rng, "insole", "no_load"),
        believed_gain=1 + gain_error * rng.standard_normal(shape),
        believed_offset=offset_error * rng.standard_normal(shape),
    )


def calibration_document(geometry: Geometry, these: Sensors, highest_pa: float) -> str:
    """`insole-calibration/1`: the cubic somebody fitted up to `highest_pa`, a few per cent wrong."""
    pressure = np.linspace(0, highest_pa, 120)
    taxels = []
    for t in range(28):
        activation = these.activation(pressure[:, None], t) * these.believed_gain[t]
        for k in PRESSURE_TAXELS:
            a = activation[:, k]
            cubic = np.linalg.lstsq(np.stack([a, a**2, a**3], 1), pressure, rcond=None)[0]
            taxels.append(
                {
                    "board": int(geometry.address[t]),
                    "triangle": int(geometry.slot[t]),
                    "taxel": k,
                    "baseline_count": round(float(these.rest[t, k] + these.believed_offset[t, k]), 3),
                    "coefficients_pa": [0.0, *(float(f"{c:.6g}") for c in cubic)],
                }
            )
    document = {"format": "insole-calibration/1", "foot": geometry.foot, "taxels": taxels}
    return json.dumps({**document, "effects": [], "provenance": {}}) + "\n"
