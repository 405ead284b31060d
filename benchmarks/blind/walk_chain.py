"""The chain of a walk, where every taxel has a load of its own; and its strength, for a wrench."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.blind import laws
from benchmarks.blind.effect import Effect
from benchmarks.blind.geometry import AREA_MM2, PADS, PRESSURE_TAXELS, Geometry
from benchmarks.blind.sensor import Sensors
from benchmarks.blind.walking import Walk, Wrench

FULL_PA = 3e5  # what fractions of hysteresis refer to


@dataclass(frozen=True)
class WalkChain:
    """`at_mm` (28, 12, 2): where the taxels of the frames' triangles truly lie."""

    walk: Walk
    sensors: Sensors
    effects: tuple[Effect, ...]
    at_mm: np.ndarray

    @cached_property
    def effective(self) -> np.ndarray:
        """(n, 28, 12) Pa at 1 kHz, float32."""
        q = self.walk.pressure(self.at_mm)
        spread = self.sensors.spread
        for e in self.effects:
            if e.law == "hysteresis":
                state = laws.bouc_wen_of_many(q.reshape(len(q), -1), e.shape["yield_pa"]).reshape(q.shape)
                q = q + (e.amplitude * FULL_PA * spread * e.place).astype(np.float32) * state
        for e in self.effects:
            for t in range(28):
                if not e.place[t].any():
                    continue
                now = q[:, t].astype(float)
                if e.law == "viscoelasticity":
                    slow = laws.relaxation(now, e.shape["tau_s"], e.shape["width"])
                    q[:, t] = now + e.amplitude * spread[t] * e.place[t] * slow
                elif e.law == "lag":
                    q[:, t] = np.where(e.place[t], laws.low_pass(now, e.amplitude), now)
        return q

    def mean_byte(self, seconds: np.ndarray) -> np.ndarray:
        """As of a chamber's chain."""
        grid = self.walk.seconds
        warmth = self.walk.temperature_c - self.walk.temperature_c[0]
        out = np.empty((*seconds.shape, 12))
        for t in range(28):
            when = seconds[:, t]
            for e in self.effects:
                if e.law == "delay" and e.place[t].any():
                    when = when - e.amplitude
            q = np.stack([np.interp(when, grid, self.effective[:, t, k]) for k in range(12)], 1)
            out[:, t] = self.sensors.rest[t] - self.sensors.activation(q, t)
            for e in self.effects:
                if e.law == "drift":
                    late = np.maximum(when - e.shape["start_s"], 0) / e.shape["settle_s"]
                    out[:, t] += np.outer(e.amplitude * e.shape["sign"] * (1 - np.exp(-late)), e.place[t])
            warm = np.interp(when, grid, warmth)[:, None]
            out[:, t, list(PADS)] = self.sensors.no_load - self.sensors.pad_count_per_k * warm
        return out

    def noise_factor(self, seconds: np.ndarray) -> np.ndarray:
        return np.ones((*seconds.shape, 12))


def force_strength(chain: WalkChain, geometry: Geometry, own_clock: bool, shoe_noise_n: float) -> float:
    """k x the floor of f_z.

    What is left of the noise-free mismatch after the best static recalibration and clock, over the noise of insole and
    shoe together.
    """
    seconds = np.arange(0, chain.walk.main_s, 0.02)
    force = np.interp(seconds, chain.walk.seconds, Wrench(chain.walk, geometry.taxel_mm).courses[:, 0])
    columns = force_features(chain.sensors, chain.mean_byte(np.repeat(seconds[:, None], 28, 1)))
    if own_clock:
        slope = np.gradient(force, 0.02)
        columns = np.column_stack([columns, slope, seconds * slope])
    basis = np.linalg.qr(columns)[0]
    left = force - basis @ (basis.T @ force)
    return float(np.sqrt(np.mean(left**2)) / np.hypot(insole_noise_n(chain.sensors), shoe_noise_n))


def force_features(sensors: Sensors, bytes_: np.ndarray) -> np.ndarray:
    """(n, 4): 1, and the sums over taxels of the static pressure's first three powers: what a static model of a force
    can be made of."""
    activation = (sensors.rest - bytes_)[:, :, list(PRESSURE_TAXELS)]
    slope, half = sensors.sensitivity[:, list(PRESSURE_TAXELS)], sensors.half_pa[:, list(PRESSURE_TAXELS)]
    pressure = activation / np.maximum(slope - activation / half, 0.05 * slope)  # the static curve turned round
    v = (pressure / FULL_PA).reshape(len(bytes_), -1)
    return np.column_stack([np.ones(len(v)), *((v**k).sum(1) for k in (1, 2, 3))])


def insole_noise_n(sensors: Sensors) -> float:
    """What the noise of the taxels makes of f_z."""
    used = list(PRESSURE_TAXELS)
    per_count = AREA_MM2 * 1e-6 / sensors.sensitivity[:, used]
    return float(np.sqrt(np.sum((per_count * sensors.noise_of_byte[:, used]) ** 2)))
