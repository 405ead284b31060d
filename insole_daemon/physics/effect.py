"""An effect: a law with values, applied to a part of an insole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..documents import spell
from ..errors import EffectError
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout
from .effects import laws
from .law import SCOPES, Array, Law, Parameter, Scope

_NAMES = ("board", "triangle", "taxel")

Problems: TypeAlias = list[tuple[tuple[str | int, ...], str]]  # the key within a map, and the problem with its value


@dataclass(frozen=True, slots=True)
class Where:
    """A part of an insole: all of it, or `ids` of as many numbers (board, triangle, taxel) as the scope needs."""

    scope: Scope = "insole"
    ids: tuple[tuple[int, ...], ...] = ()

    def problems(self, layout: Layout | None = None) -> Problems:
        """Return the problems of the ids, in themselves and for `layout`."""
        depth = SCOPES.index(self.scope)
        if depth == 0:
            return [(("ids",), "expected no ids where the scope is the insole")] if self.ids else []
        names = _NAMES[:depth]
        if not self.ids:
            return [(("ids",), f"expected at least one [{', '.join(names)}]")]
        problems: Problems = []
        layout_triangles = set(layout.rows) if layout is not None else set()
        for i, identity in enumerate(self.ids):
            identity_text = ", ".join(f"{name} {n}" for name, n in zip(names, identity, strict=False))
            if len(identity) != depth:
                problems.append((("ids", i), f"expected [{', '.join(names)}], found {len(identity)} numbers"))
            elif identity in self.ids[:i]:
                problems.append((("ids", i), f"{identity_text} is listed twice"))
            elif depth == 3 and not 0 <= identity[2] < N_TAXELS:
                problems.append((("ids", i), f"expected a taxel from 0 to {N_TAXELS - 1}, found {identity[2]}"))
            elif layout is not None and not any(
                triangle[: min(depth, 2)] == identity[:2] for triangle in layout_triangles
            ):
                problems.append(
                    (("ids", i), f"{identity_text} is not in the layout: are these effects of another insole?")
                )
        return problems

    def slots(self, layout: Layout) -> NDArray[np.intp]:
        """Return (m,) slots, 12 · row + taxel, in the order of the ids and, within an id, of the layout."""
        rows = layout.rows
        if self.scope == "insole":
            return np.arange(len(layout) * N_TAXELS)
        if self.scope == "taxel":
            return np.array([rows[board, triangle] * N_TAXELS + taxel for board, triangle, taxel in self.ids], np.intp)
        matching = [
            row for identity in self.ids for triangle, row in rows.items() if triangle[: len(identity)] == identity
        ]
        slots: NDArray[np.intp] = (np.array(matching, np.intp)[:, None] * N_TAXELS + np.arange(N_TAXELS)).ravel()
        return slots


def where_problems(law: Law, where: Where, layout: Layout | None = None) -> Problems:
    """Return the problems of applying `law` there."""
    if where.scope not in law.scopes:
        allowed = " or ".join(f'"{scope}"' for scope in law.scopes)
        return [(("scope",), f'expected the scope {allowed} of {law.word}, found "{where.scope}"')]
    return where.problems(layout)


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """One entry of `effects`; create it with `effect`, which checks it."""

    law: Law
    where: Where
    # By name: a number (), a list (k,), a pair (2, 2); or with one for every slot of `where`: (m,), (k, m).
    values: Mapping[str, Array]
    std: Mapping[str, Array] = field(default_factory=dict)  # as `values`, for estimated values
    valid_range: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # ranges in which it was identified


def effect(word: str, where: Where | None = None, /, **values: ArrayLike) -> Effect:
    """Create the effect `word` with `values`, on the whole insole unless `where` is given.

    EffectError lists all problems.
    """
    laws_by_word = laws()
    if word not in laws_by_word:
        raise EffectError(f'unknown effect "{word}": known are {", ".join(laws_by_word)}')
    where = where or Where()
    problems = [(("where", *key), message) for key, message in where_problems(laws_by_word[word], where)]
    problems += [
        (("parameters", *key), message) for key, message in value_problems(laws_by_word[word], values, has_slots=True)
    ]
    if problems:
        raise EffectError("\n".join(f"{word}: {spell(key)}: {message}" for key, message in problems))
    return Effect(laws_by_word[word], where, {name: np.array(value, float) for name, value in values.items()})


def value_problems(law: Law, values: Mapping[str, Any], has_slots: bool = False) -> Problems:
    """Return the problems of the values of a law's parameters.

    `has_slots` allows one value for every slot, if the law's scopes do.
    """
    has_slots = has_slots and "taxel" in law.scopes
    names = [parameter.name for parameter in law.parameters]
    problems: Problems = [
        ((name,), f"unknown parameter: {law.word} has {', '.join(names)}") for name in values if name not in names
    ]
    lengths: dict[str, int] = {}
    for parameter in law.parameters:
        if parameter.name not in values:
            if parameter.is_optional:
                continue
            problems.append(((parameter.name,), f"missing key: expected {_expectation(parameter)}"))
            continue
        parameter_problems = _single_value_problems(parameter, values[parameter.name], has_slots)
        problems += parameter_problems
        if parameter.size == "list" and not parameter_problems:
            lengths[parameter.name] = len(np.array(values[parameter.name]))
    if len(set(lengths.values())) > 1:
        last = names[-1]
        lengths_text = ", ".join(f"{n} of {name}" for name, n in lengths.items())
        problems.append(((last,), f"expected lists of the same length, found {lengths_text}"))
    given = law.given(values)
    columns = {} if problems else {p.name: per_slot(p, np.array(values[p.name], float)) for p in given}
    numbers = {columns[p.name].shape[-1] for p in given if columns and p.size != "pair"} - {1}
    if len(numbers) > 1:
        problems.append(((names[-1],), f"expected as many values for taxels as elsewhere, found {sorted(numbers)}"))
    if not problems:
        joint_problem = law.find_problem(columns)
        if joint_problem is not None:
            problems.append(((joint_problem[0],), joint_problem[1]))
    return problems


def per_slot(parameter: Parameter, value: Array) -> Array:
    """Return `value` with an axis for the slots, as operators need it (`law.Values`)."""
    if parameter.size == "pair":
        return value
    n_axes = 1 if parameter.size == "one" else 2
    return value if value.ndim == n_axes else value[..., None]


def _single_value_problems(parameter: Parameter, value: Any, has_slots: bool) -> Problems:
    """Return the problems of one parameter's value: its type, shape or range."""
    refused: Problems = [((parameter.name,), f"expected {_expectation(parameter)}, found {_describe(value)}")]
    try:
        numbers = np.array(value)
    except ValueError:  # lists of different lengths
        return refused
    dims = {"one": 0, "list": 1, "pair": 2}[parameter.size]
    if numbers.dtype.kind not in "iuf" or not numbers.size or numbers.ndim not in (dims, dims + has_slots):
        return refused
    if parameter.size == "pair" and numbers.shape != (2, 2):
        return refused
    low, high = parameter.low, parameter.high
    is_valid = (numbers >= low) & (numbers <= high)  # False for nan
    if parameter.whole:
        is_valid &= numbers == np.rint(numbers)
    return [
        ((parameter.name, *map(int, index)), f"expected {_format_range(parameter)}, found {numbers[tuple(index)]:g}")
        for index in np.argwhere(~is_valid)
    ]


def _format_range(parameter: Parameter) -> str:
    kind = "a whole number" if parameter.whole else "a number"
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{kind} from {parameter.low:g} to {parameter.high:g}{unit}"


def _expectation(parameter: Parameter) -> str:
    if parameter.size == "pair":
        return "two identities [[board, triangle], [board, triangle]]"
    text = _format_range(parameter)
    return f"a list, each {text}" if parameter.size == "list" else text


def _describe(value: Any) -> str:
    if isinstance(value, str):
        return f'the text "{value[:50]}"'
    if isinstance(value, Sequence):
        return f"a list of {len(value)}"
    return "nothing" if value is None else str(value)
