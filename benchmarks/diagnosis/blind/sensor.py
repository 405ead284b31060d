"""The sensors of one insole: static curves, noise and digitiser."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .ranges import draw

_CURVE_KNOTS = np.linspace(-0.6, 2.2, 8192)


@dataclass(frozen=True)
class Sensors:
    """Properties of the sensors, as arrays (28 triangles, 12 taxels); the values of thermal pads are not used."""

    scale_pa: np.ndarray  # pressure = scale_pa h(activation / scale_count)
    scale_count: np.ndarray
    bends: tuple[float, float, float]  # h(u) = u + bends[0] u^2 + bends[1] u^3 + bends[2] u^4
    offset: np.ndarray  # count, baseline minus no-load
    noise: np.ndarray  # count, standard deviation before rounding
    spread: np.ndarray  # strength of material effects on a taxel, about 1
    pad_count_per_k: float
    shift: int
    no_load: int

    def _curve(self, relative_activation: np.ndarray) -> np.ndarray:
        """h(u) of the static curve; linear below 0."""
        b, c, d = self.bends
        return np.where(
            relative_activation > 0,
            relative_activation * (1 + relative_activation * (b + relative_activation * (c + relative_activation * d))),
            relative_activation,
        )

    @cached_property
    def _table(self) -> np.ndarray:
        """h(u) at the knots, for the inverse of the static curve."""
        return self._curve(_CURVE_KNOTS)

    def activation(self, pressure: np.ndarray, columns: np.ndarray | None = None) -> np.ndarray:
        """Activation in counts under an effective load (n, 28, 12), or (n, n_columns) of the flat `columns`, in Pa."""
        scale_pa, scale_count = self.scale_pa, self.scale_count
        if columns is not None:
            scale_pa, scale_count = scale_pa.ravel()[columns], scale_count.ravel()[columns]
        relative_activation = np.interp(pressure / scale_pa, self._table, _CURVE_KNOTS)
        return (relative_activation * scale_count).astype(np.float32)

    def pressure(self, activation: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Static curve: pressure in Pa of activations (n, n_columns) in counts."""
        return self.scale_pa.ravel()[columns] * self._curve(activation / self.scale_count.ravel()[columns])

    def pa_per_count(self, activation: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Slope of the static curve at activations (n, n_columns) in counts."""
        scale_count = self.scale_count.ravel()[columns]
        relative_activation = np.maximum(activation / scale_count, 0)
        b, c, d = self.bends
        return (
            self.scale_pa.ravel()[columns]
            / scale_count
            * (1 + relative_activation * (2 * b + relative_activation * (3 * c + relative_activation * 4 * d)))
        )

    @property
    def rest(self) -> np.ndarray:
        """Mean of the byte without load. The shift rounds the activation down, on average by (1 - 2^-shift)/2."""
        return self.no_load + self.offset + (1 - 2.0**-self.shift) / 2

    @property
    def noise_of_byte(self) -> np.ndarray:
        """Standard deviation of the byte, rounding included."""
        return np.sqrt(self.noise**2 + 1 / 12)


def draw_sensors(rng: np.random.Generator) -> Sensors:
    """Draw the sensors of one insole."""
    shape = (28, 12)
    scale_pa_mean = 1e3 * draw(rng, "insole", "scale_kpa")
    scatter = np.clip(np.exp(draw(rng, "insole", "taxel_spread") * rng.standard_normal(shape)), 0.6, 1.5)
    scale_pa = scale_pa_mean * np.exp(0.08 * rng.standard_normal(shape))
    noise_level = draw(rng, "insole", "noise_count")
    bends = tuple(draw(rng, "insole", f"bend_{k}") for k in (2, 3, 4))
    return Sensors(
        scale_pa=scale_pa,
        scale_count=1e-3 * scale_pa * draw(rng, "insole", "sensitivity_count_per_kpa") * scatter,
        bends=bends,  # type: ignore[arg-type]
        offset=draw(rng, "insole", "offset_count") * rng.uniform(-1, 1, shape),
        noise=noise_level * rng.uniform(0.85, 1.2, shape),
        spread=np.clip(1 + draw(rng, "insole", "effect_spread") * rng.standard_normal(shape), 0.6, 1.4),
        pad_count_per_k=draw(rng, "insole", "pad_count_per_k"),
        shift=draw(rng, "insole", "shift"),
        no_load=draw(rng, "insole", "no_load"),
    )


def digitise(mean: np.ndarray, noise: np.ndarray, sensors: Sensors, extra_shift: np.ndarray) -> np.ndarray:
    """Bytes (n, m, 12) uint8: no_load - (value >> shift), clamped to 0 to 255.

    mean: (n, m, 12) mean byte after the real shift; noise: (n, m, 12) in counts of the declared shift, before rounding;
    extra_shift: (m,) real shift minus declared shift.
    """
    real_shift = sensors.shift + extra_shift[:, None]
    value = (sensors.no_load + (1 - 2.0**-real_shift) / 2 - mean) * 2.0**real_shift + noise * 2.0**sensors.shift
    return np.clip(sensors.no_load - (np.rint(value).astype(np.int32) >> real_shift), 0, 255).astype(np.uint8)
