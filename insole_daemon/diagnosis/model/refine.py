"""Refine the non-linear parameters of a selected set of terms, one after the other, on the same rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Generic

import numpy as np

from ...physics.law import Array
from ..terms.term import Setting
from .regression import D
from .solve import is_possible, solve_companions, solve_shares

FACTORS = (0.55, 0.7, 0.84, 1.19, 1.43, 1.8)  # on a parameter in the first round
SHIFTS_S = (-2.0, -1.0, -0.5, -0.2, 0.2, 0.5, 1.0, 2.0)  # of the time of an event
ROUNDS = 4
NARROWER = 2.2  # factor by which each round searches a smaller range
LINEARISATIONS = 2  # in a round: where a regressor depends much on its coefficient, by the secant method
LEAST_IMPROVEMENT = 0.5  # of the gain, in variances of the noise
MUCH_MORE = 0.05  # of the gain of a set, by wider laws
EDGE_S = 2.0  # distance of an event from the ends of a recording


@dataclass(frozen=True, eq=False)
class Refined(Generic[D]):
    """A set of terms with refined parameters, and a design of its columns."""

    design: D  # of the set's columns and their companions alone
    shares: tuple[Array, ...]
    gain: float

    @cached_property
    def of_laws(self) -> Refined[D]:
        """Return the laws alone, as the exported model has them: without companions for the misfit of laws.

        Wider laws (Term.also_in_law) only if they explain much more: they would fit recalibrations, too.
        """
        alone = _solved(self.design.of_laws())
        wider_design = alone.design.with_wider_laws()
        if wider_design is None:
            return alone
        wider = _solved(wider_design)
        return wider if wider.gain - alone.gain > MUCH_MORE * self.gain else alone

    @cached_property
    def companion_shares(self) -> dict[int, float]:
        """Return the coefficients of the companions beside the fitted shares, by column of the design."""
        if not self.shares:
            return {}
        columns, coefficients = solve_companions(self.design, self.design.candidates, self.shares)
        return dict(zip(columns.tolist(), coefficients.tolist(), strict=True))

    @cached_property
    def without_internal_companions(self) -> Refined[D]:
        """Return the set with all columns of its terms, without companions that are in no model."""
        alone = self.design.without_internal_companions()
        return _solved(alone)

    def gain_without(self, i: int) -> float:
        """Return the gain of the others without candidate `i`, with their parameters kept."""
        return solve_shares(self.design, [c for j, c in enumerate(self.design.candidates) if j != i])[1]


def refine(design: D, chosen: tuple[int, ...], first: int = 0) -> Refined[D]:
    """Return the set `chosen` of `design` with the non-linear parameters that maximise its gain.

    The candidates before number `first` of the set keep their parameters.

    In each round every parameter of Term.refine is tried at other values and kept if the gain rises; then parameters at
    which a regressor was linearised (Term.linear_at) are set to the fitted coefficient.
    """
    small = design.subset(chosen)
    current = _solved(small)
    width = 1.0
    for _ in range(ROUNDS):
        for i in range(first, len(chosen)):
            candidate = current.design.candidates[i]
            if candidate.term.column is None:
                continue
            for name in candidate.term.refine:
                current = _with_best_value(current, i, name, float(candidate.settings[0].get(name, 0.0)), width)
        for i in range(first, len(chosen)):
            current = _relinearised(current, i)
        width /= NARROWER
    return current


def _with_best_value(current: Refined[D], i: int, name: str, start: float, width: float) -> Refined[D]:
    """Return the set with the value of one parameter near `start` that has the largest gain, if it is possible."""
    if not start or np.isnan(start):
        return current
    load = current.design.load
    for value in _values_to_try(name, start, width):
        setting = {**current.design.candidates[i].settings[0], name: value}
        if not _is_valid(setting, name, load.observation.t_s):
            continue
        tried = _solved(current.design.exchanged(i, setting))
        if tried.gain > current.gain + LEAST_IMPROVEMENT and is_possible(
            tried.design.candidates, tried.shares, load.is_known
        ):
            current = tried
    return current


def _is_valid(setting: Setting, name: str, t_s: Array) -> bool:
    """Return whether an event is within the recording, and a snap switches off below the load that switches it on."""
    if name == "t_s" and not t_s[0] + EDGE_S < setting[name] < t_s[-1] - EDGE_S:
        return False
    return not setting.get("down_pa", 0.0) > 0.98 * setting.get("up_pa", np.inf)


def _relinearised(current: Refined[D], i: int) -> Refined[D]:
    """Return the set with the regressor of candidate `i` linearised at its coefficient, as far as the law is valid."""
    name = current.design.candidates[i].term.linear_at
    if not name:
        return current
    off = []  # settings at which the regressor was linearised, with the differences of the coefficients from them
    for _ in range(LINEARISATIONS):
        setting, share = float(current.design.candidates[i].settings[0].get(name, 0.0)), float(current.shares[i][0])
        if abs(share - setting) <= 1e-3 * abs(share):
            break
        off.append((setting, share - setting))
        value = share if len(off) < 2 else _zero_of_line(*off[-2:])
        linearised = _linearised_at(current, i, name, value)
        if linearised is None:
            break
        current = linearised
    return current


def _zero_of_line(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return where the line through two points (x, y) is 0; with slope −1 through the latter if they are equal in y."""
    (x_1, y_1), (x_2, y_2) = one, other
    return x_2 + y_2 if y_1 == y_2 else x_2 - y_2 * (x_2 - x_1) / (y_2 - y_1)


def _linearised_at(current: Refined[D], i: int, name: str, value: float) -> Refined[D] | None:
    """Return the set with the regressor of candidate `i` linearised at `value`.

    None if the coefficient would then have another sign than `value`, or the law would not be valid.
    """
    setting = {**current.design.candidates[i].settings[0], name: value}
    tried = _solved(current.design.relinearised(i, setting, current.shares))
    # If nuisance columns explain nearly all of a regressor, the coefficient of the rest may have the other sign.
    has_same_sign = float(tried.shares[i][0]) * value > 0
    is_valid = is_possible(tried.design.candidates, tried.shares, tried.design.load.is_known)
    return tried if has_same_sign and is_valid else None


def _solved(design: D) -> Refined[D]:
    """Return all candidates of `design` with their fitted shares."""
    return Refined(design, *solve_shares(design, design.candidates))


def _values_to_try(name: str, value: float, width: float) -> list[float]:
    if name == "t_s":
        return [value + width * shift for shift in SHIFTS_S]
    return [value * factor**width for factor in FACTORS]
