"""Trials in a vacuum bag or a pressure chamber: protocols of ramps, holds, minor loops and pulses."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from .laws import STEP_S
from .ranges import draw
from .trial import Trial, wandering

PROTOCOLS = ("full", "sine", "ramps")  # the last two repeat one cycle of one speed and one height
LEAD_S = 20.0
_SINGLE_SPEED_S = 120.0


def _ramp(start: float, end: float, seconds: float) -> np.ndarray:
    """(n,) Pa: a straight ramp with rounded corners, because a valve does not jump."""
    share_of_time = np.arange(round(seconds / STEP_S)) * STEP_S / seconds
    corner = 0.06
    velocity = np.clip(np.minimum(share_of_time, 1 - share_of_time) / corner, 0, 1)
    distance = np.cumsum(velocity)
    return start + (end - start) * distance / distance[-1]


def _flat(level: float, seconds: float) -> np.ndarray:
    """(n,) Pa: a constant pressure."""
    return np.full(round(seconds / STEP_S), level)


class _ProtocolBlocks:
    """Draws blocks of a protocol, each a list of pressures in Pa that begins and ends at rest (0 Pa)."""

    def __init__(self, rng: np.random.Generator, top: float):
        self.rng, self.top = rng, top
        self.slow_s = draw(rng, "chamber", "slow_cycle_s")
        self.fast_s = draw(rng, "chamber", "fast_cycle_s")
        self.rise_s = draw(rng, "chamber", "pulse_rise_s")

    def level(self, low: float, high: float) -> float:
        return self.top * self.rng.uniform(low, high)

    def cycle(self, top: float, seconds: float) -> list[np.ndarray]:
        return [_ramp(0, top, seconds / 2), _flat(top, 0.2), _ramp(top, 0, seconds / 2), _flat(0, 0.3)]

    def slow_cycles(self) -> list[np.ndarray]:
        return self.cycle(self.top, self.slow_s) + self.cycle(self.level(0.65, 0.85), self.slow_s * 0.8)

    def fast_cycles(self, n: int = 5) -> list[np.ndarray]:
        return [piece for _ in range(n) for piece in self.cycle(self.level(0.6, 1.0), self.fast_s)]

    def hold(self) -> list[np.ndarray]:
        level = self.level(0.5, 0.95)
        length = draw(self.rng, "chamber", "hold_s")
        return [_ramp(0, level, 2.0), _flat(level, length), _ramp(level, 0, 2.0), _flat(0, 0.5 * length)]

    def minor_loops(self) -> list[np.ndarray]:
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
        pieces = []
        for _ in range(n):
            level, wait = self.level(0.5, 1.0), self.rng.uniform(0.5, 1.0)
            pieces += [_ramp(0, level, self.rise_s), _flat(level, wait), _ramp(level, 0, self.rise_s), _flat(0, wait)]
        return pieces


def _full_protocol(rng: np.random.Generator, top: float, length_s: float) -> tuple[np.ndarray, float]:
    """Pressure (n,) in Pa of blocks and their continuation, and the time at which the continuation begins."""
    protocol = _ProtocolBlocks(rng, top)
    required: list[Callable[[], list[np.ndarray]]] = [
        protocol.slow_cycles,
        protocol.hold,
        protocol.minor_loops,
        protocol.fast_cycles,
    ]
    optional: list[Callable[[], list[np.ndarray]]] = [
        protocol.pulses,
        protocol.hold,
        protocol.random_holds,
        protocol.slow_cycles,
        protocol.fast_cycles,
    ]
    blocks = [required[k]() for k in rng.permutation(len(required))]
    while sum(len(piece) for block in blocks for piece in block) * STEP_S < length_s - 12:
        blocks.append(optional[int(rng.integers(len(optional)))]())
    pieces = [_flat(0, 4.0), *(piece for block in blocks for piece in block), _flat(0, 2.0)]
    main_s = sum(len(p) for p in pieces) * STEP_S
    pieces += (
        protocol.cycle(protocol.top, protocol.slow_s) + protocol.fast_cycles(3) + protocol.hold() + [_flat(0, 1.0)]
    )
    return np.concatenate(pieces), main_s


def chamber(rng: np.random.Generator, protocol: str, monotone_temperature: bool = False) -> Trial:
    """Draw a trial after one of the `PROTOCOLS`.

    monotone_temperature: the temperature only rises; without it, it goes up and down.
    """
    top_pa = 1e3 * draw(rng, "chamber", ("bag_kpa", "chamber_kpa")[int(rng.integers(2))])
    cycle, lead_s = None, LEAD_S
    if protocol == "full":
        pressure, main_s = _full_protocol(rng, top_pa, draw(rng, "chamber", "length_s"))
    else:
        n_cycle = round(rng.uniform(6.0, 9.0) / STEP_S)
        phase = np.arange(n_cycle) / n_cycle
        wave = (1 - np.cos(2 * np.pi * phase)) / 2 if protocol == "sine" else 1 - np.abs(1 - 2 * phase)
        cycle = top_pa * (0.04 + 0.96 * wave)
        lead_s = 3 * n_cycle * STEP_S
        main_s = n_cycle * STEP_S * round(_SINGLE_SPEED_S / (n_cycle * STEP_S))
        pressure = np.tile(cycle, round(main_s / (n_cycle * STEP_S)) + 3)
    lead_in = np.tile(cycle, 3) if cycle is not None else _flat(0, lead_s)
    pressure = np.concatenate([lead_in, pressure])
    seconds = np.arange(len(pressure)) * STEP_S - lead_s
    swing_k = draw(rng, "chamber", "temperature_swing_k")
    if monotone_temperature:
        temperature_c = rng.uniform(20, 28) + swing_k * (1 - np.exp(-np.maximum(seconds, 0) / (0.4 * main_s)))
    else:
        temperature_c = wandering(rng, seconds, main_s, swing_k)
    uniform_region = np.array([[0.0, 0.0, np.inf]])
    return Trial("chamber", protocol, pressure[:, None], uniform_region, temperature_c, lead_s, main_s, top_pa, cycle)


def calibration_routine(rng: np.random.Generator, highest_pa: float) -> Trial:
    """Draw the trial of a calibration: rest, slow cycles of several heights, and levels held for some seconds."""
    protocol = _ProtocolBlocks(rng, highest_pa)
    pieces = [
        _flat(0, 6.0),
        *protocol.cycle(highest_pa, 1.3 * protocol.slow_s),
        *protocol.random_holds(),
        *protocol.cycle(protocol.level(0.5, 0.8), 8),
    ]
    pieces += [*protocol.random_holds(), *protocol.cycle(highest_pa, 2 * protocol.slow_s), _flat(0, 2.0)]
    pressure = np.concatenate([_flat(0, 4.0), *pieces])
    main_s = (len(pressure) - 1) * STEP_S - 4.0
    temperature_c = np.full(len(pressure), rng.uniform(21, 25))
    uniform_region = np.array([[0.0, 0.0, np.inf]])
    return Trial("chamber", "calibration", pressure[:, None], uniform_region, temperature_c, 4.0, main_s, highest_pa)
