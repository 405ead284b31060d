"""Conditions that a person chooses for a trial: an `insole-trial/1` file, or the same structure in Python.

None stands for the value of the scenario, or of insole-reference.yaml. Each scenario lists the keys that it uses
(`scenarios.Scenario.uses`); other keys are refused rather than ignored.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from os import PathLike
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..documents import Section, at_least, read, spell, within, wrong
from ..errors import SimulationError
from ..physics.portable import interpolate
from .faults import InjectedFault
from .generation import GenerationName

FORMAT = "insole-trial/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberCycles(Section):
    """Programme of a chamber: `cycles` at each speed, a hold at the top and one unloaded, then the minor loops."""

    max_pressure_pa: Annotated[float, within(1e3, 1e6)] | None = None
    speeds_pa_s: Annotated[tuple[Annotated[float, within(100.0, 1e6)], ...], at_least(1)] | None = None
    cycles: Annotated[int, within(0, 1000)] = 3
    hold_s: Annotated[float, within(0.0, 36_000.0)] = 60.0
    # Turning points as fractions of the highest pressure; the same one twice is held for hold_s.
    minor: tuple[Annotated[float, within(0.0, 1.0)], ...] = (0.6, 0.3, 0.6, 0.3, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureCourse(Section):
    """Temperature over time: linear between its points, constant before and after."""

    t_s: Annotated[tuple[float, ...], at_least(1)]
    temperature_c: Annotated[tuple[Annotated[float, within(-20.0, 60.0)], ...], at_least(1)]

    def __call__(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n,) °C at the times `t_s` (n,)."""
        return interpolate(t_s, np.array(self.t_s), np.array(self.temperature_c))

    def __post_init__(self) -> None:
        if len(self.t_s) != len(self.temperature_c):
            found = f"{len(self.t_s)} and {len(self.temperature_c)}"
            raise SimulationError(f"expected as many t_s as temperature_c, found {found}")
        if any(after <= before for before, after in pairwise(self.t_s)):
            raise SimulationError(f"expected t_s in rising order, found {', '.join(f'{t:g}' for t in self.t_s)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class InstrumentConditions(Section):
    """The force shoe or the gauge of a chamber. Noise is a σ, drift the σ after ten minutes."""

    rate_hz: Annotated[float, within(1.0, 10_000.0)] | None = None
    offset_s: Annotated[float, within(-60.0, 60.0)] | None = None
    rate_ppm: Annotated[float, within(-10_000.0, 10_000.0)] | None = None
    force_noise_n: Annotated[float, within(0.0, 100.0)] | None = None
    force_drift_n: Annotated[float, within(0.0, 500.0)] | None = None
    moment_noise_nm: Annotated[float, within(0.0, 20.0)] | None = None
    moment_drift_nm: Annotated[float, within(0.0, 50.0)] | None = None
    pressure_noise_pa: Annotated[float, within(0.0, 20_000.0)] | None = None
    pressure_drift_pa: Annotated[float, within(0.0, 50_000.0)] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions(Section):
    """Conditions of a trial; another `take` repeats it with other noise."""

    take: Annotated[int, within(0, 1_000_000)] = 0
    length_s: Annotated[float, within(10.0, 36_000.0)] | None = None
    mass_kg: Annotated[float, within(20.0, 200.0)] | None = None
    cadence_per_min: Annotated[float, within(40.0, 160.0)] | None = None
    chamber: ChamberCycles | None = None
    temperature: TemperatureCourse | None = None
    reference: InstrumentConditions = field(default_factory=InstrumentConditions)
    generation: GenerationName | None = None
    faults: tuple[InjectedFault, ...] = ()


def load(path: str | PathLike[str]) -> Conditions:
    """Load the conditions in file `path`; DocumentError lists all problems."""
    return read(path, Conditions, FORMAT)


def check_conditions(conditions: Conditions) -> None:
    """Raise SimulationError, with key and range, if a structure made in Python has values that a file may not have."""
    for key, message in wrong(conditions):
        raise SimulationError(f"conditions: {spell(key)}: {message}")
