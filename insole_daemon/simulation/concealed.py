"""Simulate a chamber trial of one foot with one concealed effect, strong enough to be seen, to test a diagnosis.

The kind of each effect is defined here; its place and strength are drawn from the seed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from ..config import Config
from ..errors import SimulationError
from ..physics.draws import Drawn, Draws
from ..physics.effect import Effect, Where, effect
from ..skin.layout import Layout
from .conditions import ChamberCycles, Conditions, TemperatureCourse
from .trial import Trial

NOTHING = "nothing"  # a control: the diagnosis must find no effect
TOP_PA = 300e3
# Two speeds that differ by a factor of five, a hold, a recovery and minor loops separate the effects with memory.
CYCLES = ChamberCycles(max_pressure_pa=TOP_PA, speeds_pa_s=(30e3, 150e3), cycles=2, hold_s=20.0)
# A temperature that only rises could not be distinguished from a drift.
WARMTH = TemperatureCourse(t_s=(0.0, 45.0, 100.0), temperature_c=(24.0, 31.0, 25.0))
_WEAKEST, _STRONGEST = 0.8, 1.25  # factors of the strengths below

# By word: parameters for a strength, and whether it affects one board (else the whole insole).
_CONCEALED: Mapping[str, tuple[Callable[[float], dict[str, Any]], bool]] = {
    "hysteresis": (lambda k: {"r_pa": [8e3, 20e3, 45e3], "w": [0.12 * k] * 3}, True),
    "snap": (lambda k: {"up_pa": 90e3, "down_pa": 40e3, "step_pa": 40e3 * k}, True),
    "viscoelasticity": (lambda k: {"a": 0.3 * k, "tau_s": 1.2}, True),
    "creep": (lambda k: {"a": [0.07 * k] * 4, "tau_s": [0.5, 4.0, 30.0, 200.0]}, False),
    "lag": (lambda k: {"tau_s": 0.25 * k}, False),
    "stiffening": (lambda k: {"knee_pa": 150e3, "span_pa": 250e3 / k}, False),
    "gain": (lambda k: {"gain": 1.0 - 0.2 * k}, True),
    "baseline": (lambda k: {"shift_count": 4.0 * k}, True),
    "temperature": (lambda k: {"count_per_k": 0.5 * k, "gain_per_k": 0.005, "t0_c": 25.0}, False),
    "drift": (lambda k: {"t_s": [0.0, 30.0, 70.0, 120.0], "shift_count": [0.0, 3.0 * k, -2.0 * k, 4.0 * k]}, False),
    "rezero": (lambda k: {"t_s": 57.0, "shift_count": 4.0 * k}, True),
    "bit_shift": (lambda k: {"shift": 2}, True),
    "clock": (lambda k: {"offset_s": 0.4, "rate": 1.5e-3 * k}, False),
    "delay": (lambda k: {"delay_s": 0.25 * k}, True),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Concealed:
    """The concealed effect; None: nothing."""

    word: str
    effect: Effect | None

    def __str__(self) -> str:
        if self.effect is None:
            return NOTHING
        where = self.effect.where
        place = "the whole insole" if where.scope == "insole" else f"board {where.ids[0][0]}"
        values = ", ".join(f"{name} {np.array2string(x, precision=4)}" for name, x in self.effect.values.items())
        return f"{self.word} on {place}: {values}"


def list_words() -> tuple[str, ...]:
    """Return the words that `conceal` accepts."""
    return (*_CONCEALED, NOTHING)


def conceal(
    word: str,
    folder: str | PathLike[str],
    config: Config,
    layout: Layout,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Concealed:
    """Write the recording `folder` of the insole with `layout`; the recording does not name the effect.

    `progress` is called with the fraction simulated. Raises SimulationError if a chamber cannot show `word`.
    """
    check_word(word)
    hidden = Concealed(word, None if word == NOTHING else draw_effect(word, layout, Draws(seed, Drawn.CONCEALED)))
    effects = {layout.foot: () if hidden.effect is None else (hidden.effect,)}
    conditions = Conditions(chamber=CYCLES, temperature=WARMTH)
    Trial("plenum", config, [layout], effects=effects, conditions=conditions, seed=seed).write(
        folder, progress=progress
    )
    return hidden


def check_word(word: str) -> None:
    """Raise SimulationError if a chamber cannot show `word`."""
    if word not in list_words():
        raise SimulationError(f"expected an effect that a chamber can show ({', '.join(list_words())}), found {word!r}")


def draw_effect(word: str, layout: Layout, draws: Draws) -> Effect:
    """Return the effect `word` with a random place and strength."""
    parameters, one_board = _CONCEALED[word]
    share, board_fraction = draws.uniform(2).tolist()
    strength = _WEAKEST + share * (_STRONGEST - _WEAKEST)
    boards = np.unique(layout.identities[:, 0])
    board = int(boards[int(board_fraction * len(boards))])
    return effect(word, Where("board", ((board,),)) if one_board else Where(), **parameters(strength))
