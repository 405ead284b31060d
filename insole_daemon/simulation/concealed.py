"""Simulate a trial of one foot with one concealed effect, strong enough to be seen, to test a diagnosis.

The kind of each effect is defined here; its place and strength are drawn from the seed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from ..config import Config
from ..errors import SimulationError
from ..files import write_text
from ..physics.draws import Drawn, Draws
from ..physics.effect import Effect, Where, effect
from ..recording import reference as references
from ..recording.document import Kind
from ..skin.layout import Layout
from .conditions import ChamberCycles, Conditions, TemperatureCourse
from .faults import InjectedFault
from .reference_insole import reference_insole
from .trial import Trial

TrialKind = Literal["chamber", "walk"]
TRIALS: tuple[TrialKind, ...] = get_args(TrialKind)

NOTHING = "nothing"  # a null: the diagnosis has to find nothing
BESIDE_A_SIMULATION = ("crosstalk",)  # words that a walk shows only beside a simulation of it
TOP_PA = 300e3
# Two speeds that differ by a factor of five, a hold, a recovery and minor loops separate the effects with memory.
CYCLES = ChamberCycles(max_pressure_pa=TOP_PA, speeds_pa_s=(30e3, 150e3), cycles=2, hold_s=20.0)
# A temperature that only rises could not be distinguished from a drift.
WARMTH = TemperatureCourse(t_s=(0.0, 45.0, 100.0), temperature_c=(24.0, 31.0, 25.0))
WARMTH_OF_A_WALK = TemperatureCourse(t_s=(0.0, 30.0, 60.0), temperature_c=(24.0, 31.0, 25.0))
# Of a walk in which it is not concealed: boards compensate warmth to a fraction of a count, which is a baseline.
AS_CALIBRATED = TemperatureCourse(t_s=(0.0,), temperature_c=(reference_insole().rest_c,))
_WEAKEST, _STRONGEST = 0.8, 1.25  # of what stands below

_Make = Callable[[float], dict[str, Any]]
_Scope = Literal["insole", "board"]

# By word: strength → parameters of the law, and what it befalls. A law of its own for each kind of trial where a walk,
# which is shorter and has steeper edges, needs other numbers.
_IN_BOTH: Mapping[str, tuple[_Make, _Scope]] = {
    "hysteresis": (lambda k: {"r_pa": [8e3, 20e3, 45e3], "w": [0.12 * k] * 3}, "board"),
    "snap": (lambda k: {"up_pa": 90e3, "down_pa": 40e3, "step_pa": 40e3 * k}, "board"),
    "viscoelasticity": (lambda k: {"a": 0.3 * k, "tau_s": 1.2}, "board"),
    "creep": (lambda k: {"a": [0.07 * k] * 4, "tau_s": [0.5, 4.0, 30.0, 200.0]}, "insole"),
    "lag": (lambda k: {"tau_s": 0.25 * k}, "insole"),
    "stiffening": (lambda k: {"knee_pa": 150e3, "span_pa": 250e3 / k}, "insole"),
    "gain": (lambda k: {"gain": 1.0 - 0.2 * k}, "board"),
    "baseline": (lambda k: {"shift_count": 4.0 * k}, "board"),
    "temperature": (lambda k: {"count_per_k": 0.5 * k, "gain_per_k": 0.005, "t0_c": 25.0}, "insole"),
    "drift": (lambda k: _drift(k, 120.0), "insole"),
    "rezero": (lambda k: {"t_s": 57.0, "shift_count": 4.0 * k}, "board"),
    "bit_shift": (lambda k: {"shift": 2}, "board"),
    "clock": (lambda k: {"offset_s": 0.4, "rate": 1.5e-3 * k}, "insole"),
    "delay": (lambda k: {"delay_s": 0.25 * k}, "board"),
    "frame_loss": (lambda k: {"share": 0.15 * k, "run": 4.0}, "board"),
}  # fmt: skip
_ON_A_WALK: Mapping[str, tuple[_Make, _Scope]] = {
    "viscoelasticity": (lambda k: {"a": 0.25 * k, "tau_s": 0.4}, "board"),
    "lag": (lambda k: {"tau_s": 0.04 * k}, "insole"),
    "drift": (lambda k: _drift(k, 60.0), "insole"),
    "rezero": (lambda k: {"t_s": 31.0, "shift_count": 4.0 * k}, "board"),
    "delay": (lambda k: {"delay_s": 0.06 * k}, "board"),
    "preload": (lambda k: {"p0_pa": 15e3 * k}, "insole"),
    "crosstalk": (lambda k: {"k": 0.35 * k}, "insole"),
    "map_transform": (
        lambda k: {"x_mm": 5.0 * k, "y_mm": -3.0 * k, "rotation_deg": 2.0 * k, "scale": 1.0},
        "insole",
    ),
}  # fmt: skip
_SWAPPED = "swapped_triangles"  # on a walk
_LAWS = {"frame_loss": "loss"}  # words whose law has another name

# By word: the fault of a triangle, from a third of the trial on, or for a tenth of it.
_FAULTS: Mapping[str, Callable[[int, int, float], InjectedFault]] = {
    "dead_taxels": lambda board, triangle, s: InjectedFault("dead", 0.0, None, board, triangle),
    "open_triangle": lambda board, triangle, s: InjectedFault("loose", s / 3, None, board, triangle),
    "noise_burst": lambda board, triangle, s: InjectedFault("noisy", s / 3, s / 3 + s / 10, board, factor=10.0),
}
_REFERENCE = "reference_fault"
_STEP = {"pressure_pa": 15e3, "fz_n": 60.0}  # of a reference, from the middle of the trial on
_SECONDS: Mapping[TrialKind, float] = {"chamber": 150.0, "walk": 60.0}  # about
_SCENARIOS: Mapping[TrialKind, str] = {"chamber": "plenum", "walk": "t5"}


def _drift(k: float, seconds: float) -> dict[str, Any]:
    shares = np.array([0.0, 0.25, 0.58, 1.0])
    return {"t_s": (seconds * shares).tolist(), "shift_count": [0.0, 3.0 * k, -2.0 * k, 4.0 * k]}


@dataclass(frozen=True, slots=True)
class Concealed:
    """What was concealed: an effect, a fault of the boards, or a step of the reference; none of them: nothing."""

    word: str
    effect: Effect | None = None
    fault: InjectedFault | None = None
    step: tuple[str, float] | None = None  # column of the reference, and by how much

    def __str__(self) -> str:
        if self.effect is not None:
            place = f"{self.word} on {_describe(self.effect.where)}"
            values = {name: x for name, x in self.effect.values.items() if name != "pair"}
            told = ", ".join(f"{name} {np.array2string(x, precision=4)}" for name, x in values.items())
            return f"{place}: {told}" if told else place
        if self.fault is not None:
            place = f"board {self.fault.board}"
            if self.fault.triangle is not None:
                place = f"triangle {self.fault.triangle} of {place}"
            until = "" if self.fault.until_s is None else f" to {self.fault.until_s:.0f} s"
            return f"{self.word} on {place}: from {self.fault.t_s:.0f} s{until}"
        if self.step is not None:
            return f"{self.word}: a step of {self.step[1]:.4g} in {self.step[0]}"
        return NOTHING


def _describe(where: Where) -> str:
    if where.scope == "insole":
        return "the whole insole"
    names = [".".join(map(str, identity)) for identity in where.ids]
    return f"{where.scope}{'s' if len(names) > 1 else ''} {' and '.join(names)}"


def list_words(trial: TrialKind) -> tuple[str, ...]:
    """Return the words that `conceal` knows for such a trial."""
    laws = (*_IN_BOTH, *_FAULTS, _REFERENCE)
    if trial == "walk":
        laws = (*laws, *(word for word in (*_ON_A_WALK, _SWAPPED) if word not in laws))
    return (*laws, NOTHING)


def trials_that_show(word: str) -> tuple[TrialKind, ...]:
    """Return the kinds of trial in which `word` can be concealed."""
    return tuple(trial for trial in TRIALS if word in list_words(trial))


def conceal(
    word: str,
    folder: str | PathLike[str],
    config: Config,
    layout: Layout,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
    *,
    trial: TrialKind = "chamber",
    take: int = 0,
) -> Concealed:
    """Write the recording `folder` of the insole with `layout`; the recording does not name the effect.

    `take`: the same trial of the same insole again, with other noise. `progress` is told the share that has been
    played. SimulationError where such a trial cannot show `word`.
    """
    check_word(word, trial)
    hidden = draw_effect(word, layout, Draws(seed, Drawn.CONCEALED), trial)
    effects = {layout.foot: () if hidden.effect is None else (hidden.effect,)}
    faults = () if hidden.fault is None else (hidden.fault,)
    if trial == "chamber":
        conditions = Conditions(chamber=CYCLES, temperature=WARMTH, take=take, faults=faults)
    else:
        warmth = WARMTH_OF_A_WALK if word == "temperature" else AS_CALIBRATED
        conditions = Conditions(temperature=warmth, take=take, faults=faults)
    written = Trial(
        _SCENARIOS[trial], config, [layout], effects=effects, conditions=conditions, seed=seed
    ).write(folder, progress=progress)  # fmt: skip
    if hidden.step is not None:
        _step(written, *hidden.step)
    return hidden


def check_word(word: str, trial: TrialKind) -> None:
    """Raise SimulationError where such a trial cannot show `word`."""
    if word not in list_words(trial):
        others = [other for other in trials_that_show(word) if other != trial]
        instead = f"; conceal it in a {others[0]}" if others else ""
        raise SimulationError(
            f"expected an effect that a {trial} can show ({', '.join(list_words(trial))}), found {word!r}{instead}"
        )


def draw_effect(word: str, layout: Layout, draws: Draws, trial: TrialKind = "chamber") -> Concealed:
    """Return the effect or fault `word` at a drawn place, with a drawn strength."""
    if word == NOTHING:
        return Concealed(word)
    share, which, other = draws.uniform(3).tolist()
    strength = _WEAKEST + share * (_STRONGEST - _WEAKEST)
    if word == _REFERENCE:
        column = "pressure_pa" if trial == "chamber" else "fz_n"
        return Concealed(word, step=(column, strength * _STEP[column]))
    identities = layout.identities
    row = int(which * len(identities))
    board, triangle = identities[row].tolist()
    if word in _FAULTS:
        return Concealed(word, fault=_FAULTS[word](board, triangle, _SECONDS[trial]))
    if word == _SWAPPED:
        far = np.flatnonzero(identities[:, 0] != board)
        pair = [identities[row].tolist(), identities[far[int(other * len(far))]].tolist()]
        where = Where("triangle", tuple((int(b), int(t)) for b, t in pair))
        return Concealed(word, effect(word, where, pair=pair))
    own = _ON_A_WALK if trial == "walk" and word in _ON_A_WALK else _IN_BOTH
    parameters, scope = own[word]
    boards = np.unique(identities[:, 0])
    address = int(boards[int(which * len(boards))])
    where = Where("board", ((address,),)) if scope == "board" else Where()
    return Concealed(word, effect(_LAWS.get(word, word), where, **parameters(strength)))


def _step(folder: Path, column: str, size: float) -> None:
    """Shift the reference of the recording in `folder` from the middle of the trial on."""
    path = folder / "reference.csv"
    kind: Kind = "chamber" if column == "pressure_pa" else "shoe"
    reference, _ = references.read(path, kind, "left", "own")
    values = reference[column].copy()
    values[len(values) // 2 :] += size
    assert reference.time_s is not None
    write_text(path, references.text({"time_s": reference.time_s, **reference.columns, column: values}))
