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
from ..foot import Places, Stand, Walk
from ..load import Load
from .chamber import Chamber, programme
from .standing import Balance, Moves, Still
from .walking import Steps


class ReferencedLoad(Load, Protocol):
    """A load, and what an instrument without a flaw says of it."""

    def reference(self, foot: Foot, t_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Columns (n_times,) of a reference.csv at the times `t_s` (n_times,)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One that has a name; `make` is given the layouts, where the taxels really lie, the body mass and the seed."""

    about: str
    kind: Literal["chamber", "shoe"]
    seconds: float | None  # of its load; None: it goes on for ever
    make: Callable[[Sequence[Layout], Places | None, float, int], ReferencedLoad]


def _chamber(about: str, top_pa: float, speeds_pa_s: Sequence[float]) -> Scenario:
    turns = programme(top_pa, speeds_pa_s)
    return Scenario(
        about=about,
        kind="chamber",
        seconds=float(turns[-1, 0]),
        make=lambda layouts, places, mass_kg, seed: Chamber(layouts, turns),
    )


def _walk(about: str, cadence_per_min: float, seconds: float) -> Scenario:
    return Scenario(
        about=about,
        kind="shoe",
        seconds=seconds,
        make=lambda layouts, places, mass_kg, seed: Steps(layouts, mass_kg, cadence_per_min, seed, places, seconds),
    )


SCENARIOS: Mapping[str, Scenario] = {
    "vacuum": _chamber("a vacuum bag: cycles, a hold and minor loops, to 90 kPa", 90e3, (3e3, 12e3)),
    "plenum": _chamber("a pressure chamber: the same to 350 kPa", 350e3, (10e3, 40e3)),
    "t1": Scenario(
        about="standing still on both feet",
        kind="shoe",
        seconds=60.0,
        make=lambda layouts, places, mass_kg, seed: Still(layouts, mass_kg, places, 60.0),
    ),
    "t2": Scenario(
        about="standing still on the left foot",
        kind="shoe",
        seconds=40.0,
        make=lambda layouts, places, mass_kg, seed: Balance(layouts, mass_kg, places, 40.0),
    ),
    "t3": Scenario(
        about="slow movements on both feet",
        kind="shoe",
        seconds=90.0,
        make=lambda layouts, places, mass_kg, seed: Moves(layouts, mass_kg, places, 90.0),
    ),
    "t4": _walk("walking, 100 steps a minute", 100.0, 60.0),
    "t5": _walk("walking, 110 steps a minute", 110.0, 60.0),
    "t6": _walk("walking slowly, 84 steps a minute", 84.0, 60.0),
    "walk": Scenario(
        about="walking, without an end",
        kind="shoe",
        seconds=None,
        make=lambda layouts, places, mass_kg, seed: Walk(layouts, mass_kg, seed=seed, places=places),
    ),
    "stand": Scenario(
        about="quiet standing, without an end",
        kind="shoe",
        seconds=None,
        make=lambda layouts, places, mass_kg, seed: Stand(layouts, mass_kg, places),
    ),
}


def scenario(name: str) -> Scenario:
    """The scenario `name`; SimulationError lists those there are."""
    if name not in SCENARIOS:
        raise SimulationError(f'unknown scenario "{name}": expected one of {", ".join(SCENARIOS)}')
    return SCENARIOS[name]


def length_s(name: str, seconds: float | None, endless_s: float | None) -> float | None:
    """How long to simulate `name` if `seconds` are asked for; of one without an end, `endless_s` if none are.

    SimulationError where that is longer than its load.
    """
    whole_s = scenario(name).seconds
    if seconds is None:
        return endless_s if whole_s is None else whole_s
    if not seconds > 0 or (whole_s is not None and seconds > whole_s):
        most = f"at most {whole_s:g} s, which is how long its load lasts" if whole_s is not None else "more than 0 s"
        raise SimulationError(f"the scenario {name}: seconds: expected {most}, found {seconds:g} s")
    return seconds
