"""What a technician does with the chamber."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from .laws import STEP_S
from .ranges import draw
from .trial import Trial, wandering

PROTOCOLS = ("full", "sine", "ramps")  # the last two: one speed and one height, for ever
LEAD_S = 20.0
_SINGLE_SPEED_S = 120.0


def _ramp(start: float, end: float, seconds: float) -> np.ndarray:
    """A straight ramp with rounded corners: valves do not jump."""
    x = np.arange(round(seconds / STEP_S)) * STEP_S / seconds
    soft = 0.06
    velocity = np.clip(np.minimum(x, 1 - x) / soft, 0, 1)
    way = np.cumsum(velocity)
    return start + (end - start) * way / way[-1]


def _flat(level: float, seconds: float) -> np.ndarray:
    return np.full(round(seconds / STEP_S), level)


class _Technician:
    """Blocks of a protocol; each begins and ends at rest (0 Pa)."""

    def __init__(self, rng: np.random.Generator, top: float):
        self.rng, self.top = rng, top
        self.slow_s = draw(rng, "chamber", "slow_cycle_s")
        self.fast_s = draw(rng, "chamber", "fast_cycle_s")
        self.rise_s = draw(rng, "chamber", "pulse_rise_s")

    def level(self, low: float, high: float) -> float:
        return self.top * self.rng.uniform(low, high)

    def cycle(self, top: float, seconds: float) -> list[np.ndarray]:
        return [_ramp(0, top, seconds / 2), _flat(top, 0.2), _ramp(top, 0, seconds / 2), _flat(0, 0.3)]

    def slow(self) -> list[np.ndarray]:
        return self.cycle(self.top, self.slow_s) + self.cycle(self.level(0.65, 0.85), self.slow_s * 0.8)

    def fast(self, n: int = 5) -> list[np.ndarray]:
        return [piece for _ in range(n) for piece in self.cycle(self.level(0.6, 1.0), self.fast_s)]

    def hold(self) -> list[np.ndarray]:
        level = self.level(0.5, 0.95)
        length = draw(self.rng, "chamber", "hold_s")
        return [_ramp(0, level, 2.0), _flat(level, length), _ramp(level, 0, 2.0), _flat(0, 0.5 * length)]

    def minor(self) -> list[np.ndarray]:
        corners = [0, self.level(0.65, 0.8), self.level(0.25, 0.4), self.level(0.55, 0.7), self.level(0.15, 0.3)]
        corners += [self.level(0.85, 1.0), self.level(0.5, 0.6), self.level(0.8, 0.95), 0]
        rate = 2 * self.top / self.slow_s
        return [_ramp(a, b, abs(b - a) / rate) for a, b in pairwise(corners)] + [_flat(0, 1.0)]

    def random_holds(self) -> list[np.ndarray]:
        levels = [0, *(self.level(0.1, 1.0) for _ in range(7)), 0]
        pieces = []
        for a, b in pairwise(levels):
            pieces += [_ramp(a, b, max(0.4, abs(b - a) / self.top * 1.5)), _flat(b, self.rng.uniform(1.0, 3.0))]
        return pieces

    def pulses(self, n: int = 10) -> list[np.ndarray]:
        out = []
        for _ in range(n):
            level, wait = self.level(0.5, 1.0), self.rng.uniform(0.5, 1.0)
            out += [_ramp(0, level, self.rise_s), _flat(level, wait), _ramp(level, 0, self.rise_s), _flat(0, wait)]
        return out


def _full(rng: np.random.Generator, top: float, length_s: float) -> tuple[np.ndarray, float]:
    by = _Technician(rng, top)
    always: list[Callable[[], list[np.ndarray]]] = [by.slow, by.hold, by.minor, by.fast]
    more: list[Callable[[], list[np.ndarray]]] = [by.pulses, by.hold, by.random_holds, by.slow, by.fast]
    blocks = [always[k]() for k in rng.permutation(len(always))]
    while sum(len(piece) for block in blocks for piece in block) * STEP_S < length_s - 12:
        blocks.append(more[int(rng.integers(len(more)))]())
    pieces = [_flat(0, 4.0), *(piece for block in blocks for piece in block), _flat(0, 2.0)]
    main = sum(len(p) for p in pieces) * STEP_S
    pieces += by.cycle(by.top, by.slow_s) + by.fast(3) + by.hold() + [_flat(0, 1.0)]
    return np.concatenate(pieces), main


def chamber(rng: np.random.Generator, protocol: str, monotone_temperature: bool = False) -> Trial:
    """A trial in a vacuum bag or a pressure chamber after one of the `PROTOCOLS`."""
    top = 1e3 * draw(rng, "chamber", ("bag_kpa", "chamber_kpa")[int(rng.integers(2))])
    cycle, lead = None, LEAD_S
    if protocol == "full":
        pressure, main = _full(rng, top, draw(rng, "chamber", "length_s"))
    else:
        n = round(rng.uniform(6.0, 9.0) / STEP_S)
        phase = np.arange(n) / n
        wave = (1 - np.cos(2 * np.pi * phase)) / 2 if protocol == "sine" else 1 - np.abs(1 - 2 * phase)
        cycle = top * (0.04 + 0.96 * wave)
        lead = 3 * n * STEP_S
        main = n * STEP_S * round(_SINGLE_SPEED_S / (n * STEP_S))
        pressure = np.tile(cycle, round(main / (n * STEP_S)) + 3)
    before = np.tile(cycle, 3) if cycle is not None else _flat(0, lead)
    pressure = np.concatenate([before, pressure])
    seconds = np.arange(len(pressure)) * STEP_S - lead
    swing = draw(rng, "chamber", "temperature_swing_k")
    if monotone_temperature:
        temperature = rng.uniform(20, 28) + swing * (1 - np.exp(-np.maximum(seconds, 0) / (0.4 * main)))
    else:
        temperature = wandering(rng, seconds, main, swing)
    everywhere = np.array([[0.0, 0.0, np.inf]])
    return Trial("chamber", protocol, pressure[:, None], everywhere, temperature, lead, main, top, cycle)


def calibration_routine(rng: np.random.Generator, highest_pa: float) -> Trial:
    """A calibration in the chamber: rest, slow cycles to different heights, and levels held for some seconds."""
    by = _Technician(rng, highest_pa)
    pieces = [
        _flat(0, 6.0),
        *by.cycle(highest_pa, 1.3 * by.slow_s),
        *by.random_holds(),
        *by.cycle(by.level(0.5, 0.8), 8),
    ]
    pieces += [*by.random_holds(), *by.cycle(highest_pa, 2 * by.slow_s), _flat(0, 2.0)]
    pressure = np.concatenate([_flat(0, 4.0), *pieces])
    main = (len(pressure) - 1) * STEP_S - 4.0
    temperature = np.full(len(pressure), rng.uniform(21, 25))
    everywhere = np.array([[0.0, 0.0, np.inf]])
    return Trial("chamber", "calibration", pressure[:, None], everywhere, temperature, 4.0, main, highest_pa)
