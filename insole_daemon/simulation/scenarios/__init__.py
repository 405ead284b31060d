"""The scenarios of simulated trials: chambers, and the tasks T1 to T6 of Sorrentino et al. 2020, section 4.

The load of a scenario begins unloaded and, except for `walk` and `stand`, ends; it is undefined beyond its end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import SimulationError
from ...skin.layout import Foot, Layout
from ..conditions import ChamberCycles, Conditions
from ..foot import Places, Stand, Walk
from ..load import Load
from .chamber import Chamber, programme
from .standing import Balance, Moves, Still
from .walking import WalkingTask

MASS_KG = 63.0  # of the person of Sorrentino et al. 2020 whose trials calibrated
CADENCE_PER_MIN = 110.0


class ReferencedLoad(Load, Protocol):
    """A load with the readings of a perfect instrument."""

    def reference(self, foot: Foot, t_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return columns (n_times,) of a reference.csv at the times `t_s` (n_times,)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One scenario; `load` takes the layouts, the taxels' true positions, the conditions and the seed."""

    about: str
    kind: Literal["chamber", "shoe"]
    uses: tuple[str, ...]  # the ones of _SPECIFIC_CONDITIONS that apply
    length_s: Callable[[Conditions], float | None]  # duration of its load; None: endless
    load: Callable[[Sequence[Layout], Places | None, Conditions, int], ReferencedLoad]


_SPECIFIC_CONDITIONS = ("length_s", "mass_kg", "cadence_per_min", "chamber")  # conditions that only some scenarios use
_NOT_MEASURED = {  # keys of InstrumentConditions, by kind of scenario
    "chamber": ("force_noise_n", "force_drift_n", "moment_noise_nm", "moment_drift_nm"),
    "shoe": ("pressure_noise_pa", "pressure_drift_pa"),
}


def _chamber(about: str, top_pa: float, highest_pa: float, speeds_pa_s: Sequence[float]) -> Scenario:
    """Return a chamber scenario up to `top_pa`, or up to another chosen pressure of at most `highest_pa`."""

    def turns(conditions: Conditions) -> NDArray[np.float64]:
        chosen = conditions.chamber or ChamberCycles()
        chosen_pa = chosen.max_pressure_pa or top_pa
        if chosen_pa > highest_pa:
            raise SimulationError(
                f"chamber.max_pressure_pa: expected a number from 1000 to {highest_pa:g} Pa in {about}, "
                f"found {chosen_pa:g}"
            )
        return programme(chosen_pa, chosen.speeds_pa_s or speeds_pa_s, chosen)

    return Scenario(
        about=f"{about}: cycles, a hold and minor loops",
        kind="chamber",
        uses=("chamber",),
        length_s=lambda conditions: float(turns(conditions)[-1, 0]),
        load=lambda layouts, places, conditions, seed: Chamber(layouts, turns(conditions)),
    )


def _standing(about: str, task: type[Still | Balance | Moves], seconds: float) -> Scenario:
    return Scenario(
        about=about,
        kind="shoe",
        uses=("length_s", "mass_kg"),
        length_s=lambda conditions: conditions.length_s or seconds,
        load=lambda layouts, places, conditions, seed: task(
            layouts, conditions.mass_kg or MASS_KG, places, conditions.length_s or seconds
        ),
    )


def _walking(about: str, cadence_per_min: float, seconds: float) -> Scenario:
    return Scenario(
        about=about,
        kind="shoe",
        uses=("length_s", "mass_kg", "cadence_per_min"),
        length_s=lambda conditions: conditions.length_s or seconds,
        load=lambda layouts, places, conditions, seed: WalkingTask(
            layouts,
            conditions.mass_kg or MASS_KG,
            conditions.cadence_per_min or cadence_per_min,
            seed,
            places,
            conditions.length_s or seconds,
        ),
    )


SCENARIOS: Mapping[str, Scenario] = {
    "vacuum": _chamber("a vacuum bag", 90e3, 100e3, (3e3, 12e3)),
    "plenum": _chamber("a pressure chamber", 350e3, 1e6, (10e3, 40e3)),
    "t1": _standing("standing still on both feet", Still, 60.0),
    "t2": _standing("standing still on the left foot", Balance, 40.0),
    "t3": _standing("slow movements on both feet", Moves, 90.0),
    "t4": _walking("walking", 100.0, 60.0),
    "t5": _walking("walking faster", 110.0, 60.0),
    "t6": _walking("walking slowly", 84.0, 60.0),
    "walk": Scenario(
        about="walking, without an end",
        kind="shoe",
        uses=("mass_kg", "cadence_per_min"),
        length_s=lambda conditions: None,
        load=lambda layouts, places, conditions, seed: Walk(
            layouts, conditions.mass_kg or MASS_KG, conditions.cadence_per_min or CADENCE_PER_MIN, seed, places
        ),
    ),
    "stand": Scenario(
        about="quiet standing, without an end",
        kind="shoe",
        uses=("mass_kg",),
        length_s=lambda conditions: None,
        load=lambda layouts, places, conditions, seed: Stand(layouts, conditions.mass_kg or MASS_KG, places),
    ),
}


def scenario(name: str) -> Scenario:
    """Return the scenario `name`; SimulationError lists the known ones."""
    if name not in SCENARIOS:
        raise SimulationError(f'unknown scenario "{name}": expected one of {", ".join(SCENARIOS)}')
    return SCENARIOS[name]


def check_used(name: str, conditions: Conditions) -> None:
    """Raise SimulationError if a condition is set that the scenario `name` does not use."""
    uses, kind = scenario(name).uses, scenario(name).kind
    for key in _SPECIFIC_CONDITIONS:
        if getattr(conditions, key) is not None and key not in uses:
            raise SimulationError(f"the scenario {name}: {key}: not used, only {', '.join(uses)}: leave it out")
    for key in _NOT_MEASURED[kind]:
        if getattr(conditions.reference, key) is not None:
            raise SimulationError(f"the scenario {name}: reference.{key}: a {kind} does not measure that: leave it out")


def length_s(name: str, conditions: Conditions, seconds: float | None, endless_s: float | None) -> float | None:
    """Return how long to simulate `name` if `seconds` are requested; `endless_s` if none are and its load is endless.

    Raises SimulationError if `seconds` is longer than its load.
    """
    load_s = scenario(name).length_s(conditions)
    if seconds is None:
        return endless_s if load_s is None else load_s
    if not seconds > 0 or (load_s is not None and seconds > load_s):
        expectation = (
            f"at most {load_s:g} s, which is how long its load lasts" if load_s is not None else "more than 0 s"
        )
        raise SimulationError(f"the scenario {name}: seconds: expected {expectation}, found {seconds:g} s")
    return seconds
