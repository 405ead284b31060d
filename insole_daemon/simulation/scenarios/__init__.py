"""What is done to the insoles: chambers, and the tasks T1 to T6 of Sorrentino et al. 2020, section 4.

A scenario has a load that begins at rest and, but for `walk` and `stand`, ends: nothing is known beyond.
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
    """A load, and what an instrument without a flaw says of it."""

    def reference(self, foot: Foot, t_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Columns (n_times,) of a reference.csv at the times `t_s` (n_times,)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One that has a name.

    `load` is given the layouts, where the taxels really lie, the conditions and the seed.
    """

    about: str
    kind: Literal["chamber", "shoe"]
    uses: tuple[str, ...]  # of _PARTICULAR
    length_s: Callable[[Conditions], float | None]  # of its load; None: it goes on for ever
    load: Callable[[Sequence[Layout], Places | None, Conditions, int], ReferencedLoad]


_PARTICULAR = ("length_s", "mass_kg", "cadence_per_min", "chamber")  # conditions that not every scenario has a use for
_NOT_MEASURED = {  # of an Instrument, by kind of scenario
    "chamber": ("force_noise_n", "force_drift_n", "moment_noise_nm", "moment_drift_nm"),
    "shoe": ("pressure_noise_pa", "pressure_drift_pa"),
}


def _chamber(about: str, top_pa: float, highest_pa: float, speeds_pa_s: Sequence[float]) -> Scenario:
    """To `top_pa`, unless another pressure is chosen: up to `highest_pa`."""

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
    """The scenario `name`; SimulationError lists those there are."""
    if name not in SCENARIOS:
        raise SimulationError(f'unknown scenario "{name}": expected one of {", ".join(SCENARIOS)}')
    return SCENARIOS[name]


def check_used(name: str, conditions: Conditions) -> None:
    """Raise SimulationError where something is chosen that the scenario `name` has no use for."""
    uses, kind = scenario(name).uses, scenario(name).kind
    for key in _PARTICULAR:
        if getattr(conditions, key) is not None and key not in uses:
            raise SimulationError(
                f"the scenario {name}: {key}: it has no use for it, only for {', '.join(uses)}: leave it out"
            )
    for key in _NOT_MEASURED[kind]:
        if getattr(conditions.reference, key) is not None:
            raise SimulationError(f"the scenario {name}: reference.{key}: a {kind} does not measure that: leave it out")


def length_s(name: str, conditions: Conditions, seconds: float | None, endless_s: float | None) -> float | None:
    """How long to simulate `name` if `seconds` are asked for; of one without an end, `endless_s` if none are.

    SimulationError where that is longer than its load.
    """
    whole_s = scenario(name).length_s(conditions)
    if seconds is None:
        return endless_s if whole_s is None else whole_s
    if not seconds > 0 or (whole_s is not None and seconds > whole_s):
        most = f"at most {whole_s:g} s, which is how long its load lasts" if whole_s is not None else "more than 0 s"
        raise SimulationError(f"the scenario {name}: seconds: expected {most}, found {seconds:g} s")
    return seconds
