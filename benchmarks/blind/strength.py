"""k x the floor, as the contract defines it.

What is left of the noise-free mismatch, over the affected taxels, after the best static recalibration and clock,
divided by the standard deviation of the noise.
"""

import numpy as np
from scipy.optimize import brentq

from benchmarks.blind.chain import chain
from benchmarks.blind.effect import Effect
from benchmarks.blind.geometry import PRESSURE_TAXELS
from benchmarks.blind.loads import Load
from benchmarks.blind.sensor import Sensors

GRID_S = 0.02
# What a recalibration takes away is measured before it: else its strength would be nought.
RECALIBRATION = ("gain", "baseline", "stiffening", "bit_shift")
SAMPLE = 10  # affected taxels that stand for all of them while an amplitude is sought


def static(load_pa: np.ndarray) -> np.ndarray:
    """An orthonormal basis (n, 4) of the cubics in the load: whatever a static recalibration can do."""
    return np.linalg.qr(np.vander(load_pa / np.max(load_pa), 4))[0]


def without_static(values: np.ndarray, basis: np.ndarray) -> np.ndarray:
    return values - basis @ (basis.T @ values)


class Measure:
    """The strength of one effect alone, under this load and on these sensors."""

    def __init__(self, load: Load, sensors: Sensors, effect: Effect, own_clock: bool, sample: int = 280):
        self.load, self.sensors, self.effect = load, sensors, effect
        self.own_clock = own_clock and effect.word not in RECALIBRATION
        self.seconds = np.arange(0, load.main_s, GRID_S)
        self.pressure = np.interp(self.seconds, load.seconds, load.pressure_pa)
        self.basis = static(self.pressure)
        all_affected = np.argwhere(effect.place)
        self.n_all = len(all_affected)
        step = max(1, len(all_affected) // sample)
        self.affected = all_affected[::step]
        self.triangles = sorted({int(t) for t, _ in self.affected})
        self.clean = self._bytes(())
        self.noise = sensors.noise_of_byte[tuple(self.affected.T)]

    def _bytes(self, effects: tuple[Effect, ...], seconds: np.ndarray | None = None) -> np.ndarray:
        """(n, n_affected)"""
        made = chain(self.load, self.sensors, effects)
        by = {t: made.triangle(t, self.seconds if seconds is None else seconds) for t in self.triangles}
        return np.stack([by[int(t)][:, k] for t, k in self.affected], 1)

    def mismatch(self, amplitude: float) -> np.ndarray:
        """(n, n_affected) count, before anything is taken off."""
        if self.effect.word == "clock":
            return self._bytes((), self.seconds * (1 - 1e-6 * amplitude * self.effect.shape["sign"])) - self.clean
        return self._bytes((self.effect.with_amplitude(amplitude),)) - self.clean

    def left(self, amplitude: float) -> np.ndarray:
        """What recalibration and clock leave of it."""
        found = self.mismatch(amplitude)
        if self.effect.word in RECALIBRATION:
            return found
        found = without_static(found, self.basis)
        if not self.own_clock:
            return found
        slope = np.gradient(self.clean, GRID_S, axis=0)
        directions = [slope] if self.effect.word == "clock" else [slope, slope * self.seconds[:, None]]
        directions = [without_static(d, self.basis) for d in directions]
        # The clock is one for all taxels: those without the effect hold it where it is.
        everywhere = (28 * len(PRESSURE_TAXELS)) / self.n_all
        gram = np.array([[np.vdot(a, b) for b in directions] for a in directions]) * everywhere
        shifts = np.linalg.solve(gram, [np.vdot(d, found) for d in directions])
        return found - sum(s * d for s, d in zip(shifts, directions, strict=True))

    def k(self, amplitude: float) -> float:
        if self.effect.law == "load_noise":
            grown = amplitude * self.pressure[:, None] / self.load.span_pa * self.sensors.noise[tuple(self.affected.T)]
            return float(np.sqrt(np.mean(grown**2) / np.mean(self.noise**2)))
        return float(np.sqrt(np.mean(self.left(amplitude) ** 2) / np.mean(self.noise**2)))

    def amplitude_fraction(self, amplitude: float) -> float:
        """Half the peak-to-peak of what static recalibration leaves, over the span of the reading."""
        left = without_static(self.mismatch(amplitude), self.basis)
        return float(np.mean(np.ptp(left, axis=0) / 2 / np.ptp(self.clean, axis=0)))


def solve(full: Measure, wanted: float) -> Effect:
    """The effect with the amplitude that makes it `wanted` x the floor, or the nearest its range allows."""
    effect = full.effect
    low, high = effect.limits
    few = Measure(full.load, full.sensors, effect, full.own_clock, SAMPLE)
    if few.k(high) <= wanted:
        return effect.with_amplitude(high)
    if few.k(low) >= wanted:
        return effect.with_amplitude(low)
    found = np.exp(brentq(lambda x: np.log(few.k(np.exp(x)) / wanted), np.log(low), np.log(high), rtol=1e-3))
    # A few taxels brought it near; all of them say how far off it still is.
    return effect.with_amplitude(float(np.clip(found * wanted / full.k(found), low, high)))
