"""One case, nothing written yet: its sensors, its load, what is concealed and how it is known."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.blind.chain import Chain, chain
from benchmarks.blind.effect import Effect
from benchmarks.blind.faults import Fault
from benchmarks.blind.geometry import Geometry
from benchmarks.blind.loads import Load
from benchmarks.blind.plan import Spec
from benchmarks.blind.sensor import Sensors
from benchmarks.blind.walk_chain import WalkChain
from benchmarks.blind.walking import Walk

# Five times the most that is asked for: nothing was solved beyond it, a law has broken.
MOST_K = 50.0


class UnsolvedError(Exception):
    """The strength of an effect is none that was asked for."""


@dataclass(frozen=True)
class Case:
    """Raises UnsolvedError where an effect is not finite, or solved and beyond `MOST_K` x the floor."""

    spec: Spec
    geometry: Geometry
    sensors: Sensors
    load: Load | Walk
    effects: tuple[Effect, ...]
    k: dict[str, float]  # of each effect, alone
    amplitude_fraction: dict[str, float]
    own_clock: bool
    offset_s: float  # own clock: reading = offset + (1 + rate) (seconds since the first tick)
    rate: float
    simulated: bool  # the load is known from a simulated recording instead of an instrument
    epoch_s: int
    rng: np.random.Generator  # for what is drawn when it is written
    faults: tuple[Fault, ...] = ()
    at_mm: np.ndarray | None = None  # (28, 12, 2) where the taxels of a walk truly lie

    def __post_init__(self) -> None:
        for word, k in self.k.items():
            # Walks are as strong as they are drawn, and a bit is a whole bit.
            solved = word != "bit_shift" and self.spec.suite != "walking"
            if not np.isfinite(k) or (solved and k > MOST_K):
                raise UnsolvedError(
                    f"{self.spec}: expected a {word} of {self.spec.k:g} x the floor, at most {MOST_K:g} x, "
                    f"found {k:g} x; its law in laws.py has broken under this load"
                )

    @cached_property
    def chain(self) -> Chain | WalkChain:
        if isinstance(self.load, Walk):
            assert self.at_mm is not None
            return WalkChain(self.load, self.sensors, self.effects, self.at_mm)
        return chain(self.load, self.sensors, self.effects)

    @cached_property
    def believed_chain(self) -> Chain | WalkChain:
        """With nothing concealed, and every taxel where the layout says."""
        if isinstance(self.load, Walk):
            return WalkChain(self.load, self.sensors, (), self.geometry.taxel_mm)
        return chain(self.load, self.sensors, ())

    def believed_pressure(self, seconds: np.ndarray) -> np.ndarray:
        """(n, 28, 12) Pa on every taxel where the layout says it is, as far as whoever looks for no effect can know.

        Where the clock's rate is what is concealed, that is with the best constant offset only.
        """
        if isinstance(self.load, Walk):
            courses = np.stack([np.interp(seconds, self.load.seconds, c) for c in self.load.courses.T], 1)
            return np.einsum("nr,tkr->ntk", courses, self.load.field(self.geometry.taxel_mm))
        if any(e.word == "clock" for e in self.effects):
            seconds = (seconds + self.rate * self.load.main_s / 2) / (1 + self.rate)
        pressure = np.interp(seconds, self.load.seconds, self.load.pressure_pa)
        return np.broadcast_to(pressure[:, None, None], (len(seconds), 28, 12))


def parameters(effect: Effect) -> dict[str, list[float]]:
    """What is scored, under the contract's names; only where this generator's law has the same parameter."""
    sign = effect.shape.get("sign", 1.0)
    amplitude = effect.amplitude
    by_word: dict[str, dict[str, Any]] = {
        "snap": {k: effect.shape.get(k) for k in ("up_pa", "down_pa")},
        "viscoelasticity": {"a": amplitude, "tau_s": effect.shape.get("tau_s")},
        "lag": {"tau_s": amplitude},
        "delay": {"delay_s": amplitude},
        "temperature": {"count_per_k": sign * amplitude},
        "drift": {"shift_count": sign * amplitude},
        "rezero": {"shift_count": sign * amplitude, "t_s": effect.shape.get("t_s")},
        "stiffening": {"knee_pa": effect.shape.get("knee_pa")},
        "gain": {"gain": 1 + sign * amplitude},
        "baseline": {"shift_count": sign * amplitude},
        "clock": {"rate": 1e-6 * sign * amplitude},
        "map_transform": {k: effect.shape.get(k) for k in ("x_mm", "y_mm", "rotation_deg")},
    }
    return {name: [float(value)] for name, value in by_word.get(effect.word, {}).items() if value is not None}
