"""What a technician does with the chamber: pressure and temperature at 1 kHz."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.blind.laws import STEP_S
from benchmarks.blind.ranges import draw

PROTOCOLS = ("full", "sine", "ramps")  # the last two: one speed and one height, for ever
MAIN_S = 150.0  # of the single-speed protocols


@dataclass(frozen=True)
class Load:
    """A trial from the first frame to the end of what is kept back."""

    protocol: str
    pressure_pa: np.ndarray  # (n,) at 1 kHz
    temperature_c: np.ndarray  # (n,)
    main_s: float  # what the tool sees ends here
    span_pa: float  # the highest pressure
    cycle: np.ndarray | None  # of the single-speed protocols: one cycle, repeated for ever

    @property
    def lead(self) -> int:
        """Samples of the past that a load repeated for ever needs to be in its steady state."""
        return 0 if self.cycle is None else 3 * len(self.cycle)

    @property
    def seconds(self) -> np.ndarray:
        return np.arange(len(self.pressure_pa)) * STEP_S


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
    """Puts pieces together, each beginning and ending at rest (0 Pa)."""

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

    def pulses(self, n: int = 10) -> list[np.ndarray]:
        out = []
        for _ in range(n):
            level, wait = self.level(0.5, 1.0), self.rng.uniform(0.5, 1.0)
            out += [_ramp(0, level, self.rise_s), _flat(level, wait), _ramp(level, 0, self.rise_s), _flat(0, wait)]
        return out


def _full(rng: np.random.Generator, top: float) -> tuple[np.ndarray, float]:
    by = _Technician(rng, top)
    blocks: list[Callable[[], list[np.ndarray]]] = [by.slow, by.hold, by.minor, by.fast, by.pulses, by.hold]
    pieces = [_flat(0, 4.0)]
    for k in rng.permutation(len(blocks)):
        pieces += blocks[k]()
    pieces += [_flat(0, 2.0)]
    main = sum(len(p) for p in pieces) * STEP_S
    pieces += by.cycle(by.top, by.slow_s) + by.fast(3) + by.hold() + by.pulses(5) + [_flat(0, 1.0)]
    return np.concatenate(pieces), main


def _temperature(rng: np.random.Generator, seconds: float, main_s: float, monotone: bool) -> np.ndarray:
    """Up and down again more than once; or a warm-up that is still going on at the end."""
    t = np.arange(round(seconds / STEP_S)) * STEP_S
    swing, start = draw(rng, "chamber", "temperature_swing_k"), rng.uniform(20, 26)
    if monotone:
        return start + swing * (1 - np.exp(-t / (0.4 * main_s)))
    period = main_s / rng.uniform(1.3, 1.8)
    shape = (1 - np.cos(2 * np.pi * t / period)) / 2 + 0.2 * np.sin(2 * np.pi * t / (0.37 * main_s) + rng.uniform(0, 6))
    return start + swing * (shape - shape[0])


def chamber(rng: np.random.Generator, protocol: str, vessel: str, monotone_temperature: bool = False) -> Load:
    """A trial in the `vessel` (bag or plenum) after one of the `PROTOCOLS`."""
    top = 1e3 * draw(rng, "chamber", f"{vessel}_kpa")
    cycle = None
    if protocol == "full":
        pressure, main = _full(rng, top)
    else:
        n = round(rng.uniform(7.0, 10.0) / STEP_S)
        phase = np.arange(n) / n
        wave = (1 - np.cos(2 * np.pi * phase)) / 2 if protocol == "sine" else 1 - np.abs(1 - 2 * phase)
        cycle = top * (0.04 + 0.96 * wave)
        main = n * STEP_S * round(MAIN_S / (n * STEP_S))
        pressure = np.tile(cycle, round(main / (n * STEP_S)) + 5)
    temperature = _temperature(rng, len(pressure) * STEP_S, main, monotone_temperature)[: len(pressure)]
    return Load(protocol, pressure, temperature, main, top, cycle)
