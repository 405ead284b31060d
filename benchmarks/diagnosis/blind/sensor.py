"""The sensors of one insole: their static curves, their noise, and how they are digitised."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .ranges import draw

_KNOTS = np.linspace(-0.6, 2.2, 8192)


@dataclass(frozen=True)
class Sensors:
    """Arrays over (28 triangles, 12 slots); thermal pads have a row like the others and no use for it."""

    scale_pa: np.ndarray  # pressure = scale_pa h(activation / scale_count)
    scale_count: np.ndarray
    bends: tuple[float, float, float]  # h(u) = u + bends[0] u^2 + bends[1] u^3 + bends[2] u^4
    offset: np.ndarray  # count, of the rest value from no-load
    noise: np.ndarray  # count, standard deviation before rounding
    spread: np.ndarray  # of material effects about 1
    pad_count_per_k: float
    shift: int
    no_load: int

    def _curve(self, u: np.ndarray) -> np.ndarray:
        b, c, d = self.bends
        return np.where(u > 0, u * (1 + u * (b + u * (c + u * d))), u)

    @cached_property
    def _table(self) -> np.ndarray:
        return self._curve(_KNOTS)

    def activation(self, pressure: np.ndarray, columns: np.ndarray | None = None) -> np.ndarray:
        """Counts under the effective load (n, 28, 12), or (n, n_columns) of the flat `columns`; Pa."""
        pa, count = self.scale_pa, self.scale_count
        if columns is not None:
            pa, count = pa.ravel()[columns], count.ravel()[columns]
        u = np.interp(pressure / pa, self._table, _KNOTS)
        return (u * count).astype(np.float32)

    def pressure(self, activation: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Static curve turned round: Pa of (n, n_columns) counts."""
        return self.scale_pa.ravel()[columns] * self._curve(activation / self.scale_count.ravel()[columns])

    def pa_per_count(self, activation: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Slope of the static curve at (n, n_columns) counts."""
        count = self.scale_count.ravel()[columns]
        u = np.maximum(activation / count, 0)
        b, c, d = self.bends
        return self.scale_pa.ravel()[columns] / count * (1 + u * (2 * b + u * (3 * c + u * 4 * d)))

    @property
    def rest(self) -> np.ndarray:
        """Mean of the byte at rest: the floor of the shift rounds the activation down by (1 - 2^-shift)/2."""
        return self.no_load + self.offset + (1 - 2.0**-self.shift) / 2

    @property
    def noise_of_byte(self) -> np.ndarray:
        """Standard deviation of the byte, rounding included."""
        return np.sqrt(self.noise**2 + 1 / 12)


def sensors(rng: np.random.Generator) -> Sensors:
    """Draw the sensors of one insole."""
    shape = (28, 12)
    count = 1e3 * draw(rng, "insole", "scale_kpa")
    scatter = np.clip(np.exp(draw(rng, "insole", "taxel_spread") * rng.standard_normal(shape)), 0.6, 1.5)
    scale_pa = count * np.exp(0.08 * rng.standard_normal(shape))
    middle = draw(rng, "insole", "noise_count")
    bends = tuple(draw(rng, "insole", f"bend_{k}") for k in (2, 3, 4))
    return Sensors(
        scale_pa=scale_pa,
        scale_count=1e-3 * scale_pa * draw(rng, "insole", "sensitivity_count_per_kpa") * scatter,
        bends=bends,  # type: ignore[arg-type]
        offset=draw(rng, "insole", "offset_count") * rng.uniform(-1, 1, shape),
        noise=middle * rng.uniform(0.85, 1.2, shape),
        spread=np.clip(1 + draw(rng, "insole", "effect_spread") * rng.standard_normal(shape), 0.6, 1.4),
        pad_count_per_k=draw(rng, "insole", "pad_count_per_k"),
        shift=draw(rng, "insole", "shift"),
        no_load=draw(rng, "insole", "no_load"),
    )


def digitise(mean: np.ndarray, noise: np.ndarray, these: Sensors, step: np.ndarray) -> np.ndarray:
    """The byte of (n, m, 12): no_load - floor(value >> shift), clamped.

    mean: mean byte after the real shift; noise: count of the declared shift, before rounding; step: (m,) how much the
    real shift is more than the declared one.
    """
    real = these.shift + step[:, None]
    value = (these.no_load + (1 - 2.0**-real) / 2 - mean) * 2.0**real + noise * 2.0**these.shift
    return np.clip(these.no_load - (np.rint(value).astype(np.int32) >> real), 0, 255).astype(np.uint8)
