"""Non-linear parameters of a selected set, refined one after the other on the same rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Generic

import numpy as np

from ...physics.law import Array
from .regression import D
from .solve import is_possible, solve_shares

FACTORS = (0.55, 0.7, 0.84, 1.19, 1.43, 1.8)  # of a parameter, in the first round; half as far in the next
SHIFTS_S = (-2.0, -1.0, -0.5, -0.2, 0.2, 0.5, 1.0, 2.0)  # of the time of an event
ROUNDS = 4
EDGE_S = 2.0  # from the ends of a recording, that an event is


@dataclass(frozen=True, eq=False)
class Refined(Generic[D]):
    """A set with columns of its own."""

    design: D  # of the set's columns and their companions alone
    shares: tuple[Array, ...]
    gain: float

    @cached_property
    def of_laws(self) -> Refined[D]:
        """The laws alone, as a model has them: shares without what they leave out beside them."""
        alone = self.design.of_laws()
        return Refined(alone, *solve_shares(alone, alone.candidates))

    @cached_property
    def of_families(self) -> Refined[D]:
        """The same set with its families' own columns, and nothing beside them that a family alone does not say."""
        alone = self.design.of_families()
        return Refined(alone, *solve_shares(alone, alone.candidates))

    def gain_without(self, i: int) -> float:
        """What the others take away without candidate `i`, their parameters kept."""
        return solve_shares(self.design, [c for j, c in enumerate(self.design.candidates) if j != i])[1]


def refine(design: D, chosen: tuple[int, ...]) -> Refined[D]:
    """The set `chosen` of `design` with its non-linear parameters where they explain most."""
    current = design.subset(chosen)
    shares, gain = solve_shares(current, current.candidates)
    width, t_s = 1.0, design.load.observation.t_s
    for _ in range(ROUNDS):
        for i, candidate in enumerate(current.candidates):
            if candidate.term.column is None:
                continue
            for name in candidate.term.refine:
                start = float(candidate.settings[0].get(name, 0.0))
                if not start or np.isnan(start):
                    continue
                for value in _values(name, start, width):
                    setting = {**current.candidates[i].settings[0], name: value}
                    if name == "t_s" and not t_s[0] + EDGE_S < value < t_s[-1] - EDGE_S:
                        continue
                    if setting.get("down_pa", 0.0) > 0.98 * setting.get("up_pa", np.inf):
                        continue
                    tried = current.exchanged(i, setting)
                    own_shares, own_gain = solve_shares(tried, tried.candidates)
                    if own_gain > gain + 0.5 and is_possible(tried.candidates, own_shares, design.load.is_known):
                        current, shares, gain = tried, own_shares, own_gain
        for i, candidate in enumerate(current.candidates):
            name, share = candidate.term.linear_at, float(shares[i][0])
            if name and abs(float(candidate.settings[0].get(name, 0.0)) - share) > 1e-3 * abs(share):
                tried = current.exchanged(i, {**candidate.settings[0], name: share})
                own_shares, own_gain = solve_shares(tried, tried.candidates)
                # Where nuisances hold nearly all of it, what is left of a curved column may have the other sign.
                if float(own_shares[i][0]) * share > 0:
                    current, shares, gain = tried, own_shares, own_gain
        width /= 2.2
    return Refined(current, shares, gain)


def _values(name: str, value: float, width: float) -> list[float]:
    if name == "t_s":
        return [value + width * shift for shift in SHIFTS_S]
    return [value * factor**width for factor in FACTORS]
