"""An effect: a law with values, at work somewhere on an insole."""

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

Wrong: TypeAlias = list[tuple[tuple[str | int, ...], str]]  # the key within a map, and what is wrong there


@dataclass(frozen=True, slots=True)
class Where:
    """A part of an insole: all of it, or what `ids` list as far as the scope needs: (board, triangle, taxel)."""

    scope: Scope = "insole"
    ids: tuple[tuple[int, ...], ...] = ()

    def wrong(self, layout: Layout | None = None) -> Wrong:
        """What is wrong with it, in itself or for `layout`."""
        depth = SCOPES.index(self.scope)
        if depth == 0:
            return [(("ids",), "expected no ids where the scope is the insole")] if self.ids else []
        names = _NAMES[:depth]
        if not self.ids:
            return [(("ids",), f"expected at least one [{', '.join(names)}]")]
        found: Wrong = []
        there = set(layout.rows) if layout is not None else set()
        for i, identity in enumerate(self.ids):
            said = ", ".join(f"{name} {n}" for name, n in zip(names, identity, strict=False))
            if len(identity) != depth:
                found.append((("ids", i), f"expected [{', '.join(names)}], found {len(identity)} numbers"))
            elif identity in self.ids[:i]:
                found.append((("ids", i), f"{said} stands twice"))
            elif depth == 3 and not 0 <= identity[2] < N_TAXELS:
                found.append((("ids", i), f"expected a taxel from 0 to {N_TAXELS - 1}, found {identity[2]}"))
            elif layout is not None and not any(known[: min(depth, 2)] == identity[:2] for known in there):
                found.append((("ids", i), f"{said} is not in the layout: are these effects of another insole?"))
        return found

    def slots(self, layout: Layout) -> NDArray[np.intp]:
        """(m,) slots, 12 · row + taxel, in the order of the ids, and of the layout within one."""
        rows = layout.rows
        if self.scope == "insole":
            return np.arange(len(layout) * N_TAXELS)
        if self.scope == "taxel":
            return np.array([rows[board, triangle] * N_TAXELS + taxel for board, triangle, taxel in self.ids], np.intp)
        found = [row for identity in self.ids for place, row in rows.items() if place[: len(identity)] == identity]
        slots: NDArray[np.intp] = (np.array(found, np.intp)[:, None] * N_TAXELS + np.arange(N_TAXELS)).ravel()
        return slots


def wrong_where(law: Law, where: Where, layout: Layout | None = None) -> Wrong:
    """What is wrong with `law` being at work there."""
    if where.scope not in law.scopes:
        allowed = " or ".join(f'"{scope}"' for scope in law.scopes)
        return [(("scope",), f'expected the scope {allowed} of {law.word}, found "{where.scope}"')]
    return where.wrong(layout)


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """One entry of `effects`; make it with `effect`, which checks it."""

    law: Law
    where: Where
    # By name: one number (), a list (k,), a pair (2, 2); or one for every slot of `where`: (m,), (k, m).
    values: Mapping[str, Array]
    std: Mapping[str, Array] = field(default_factory=dict)  # as `values`, of those that were estimated
    valid_range: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # it was identified in


def effect(word: str, where: Where | None = None, /, **values: ArrayLike) -> Effect:
    """The effect `word` with `values`, on the whole insole unless `where` says otherwise.

    EffectError lists all that is wrong with it.
    """
    known = laws()
    if word not in known:
        raise EffectError(f'unknown effect "{word}": known are {", ".join(known)}')
    where = where or Where()
    found = [(("where", *key), message) for key, message in wrong_where(known[word], where)]
    found += [(("parameters", *key), message) for key, message in wrong_values(known[word], values, each=True)]
    if found:
        raise EffectError("\n".join(f"{word}: {spell(key)}: {message}" for key, message in found))
    return Effect(known[word], where, {name: np.array(value, float) for name, value in values.items()})


def wrong_values(law: Law, values: Mapping[str, Any], each: bool = False) -> Wrong:
    """What is wrong with the values of a law's parameters; `each`: there may be one for every slot, if it has any."""
    each = each and "taxel" in law.scopes
    names = [parameter.name for parameter in law.parameters]
    found: Wrong = [
        ((name,), f"unknown parameter: {law.word} has {', '.join(names)}") for name in values if name not in names
    ]
    lengths: dict[str, int] = {}
    for parameter in law.parameters:
        if parameter.name not in values:
            found.append(((parameter.name,), f"missing key: expected {_words(parameter)}"))
            continue
        wrong = _wrong_value(parameter, values[parameter.name], each)
        found += wrong
        if parameter.size == "list" and not wrong:
            lengths[parameter.name] = len(np.array(values[parameter.name]))
    if len(set(lengths.values())) > 1:
        last = names[-1]
        said = ", ".join(f"{n} of {name}" for name, n in lengths.items())
        found.append(((last,), f"expected lists of the same length, found {said}"))
    columns = {} if found else {p.name: per_slot(p, np.array(values[p.name], float)) for p in law.parameters}
    numbers = {columns[p.name].shape[-1] for p in law.parameters if columns and p.size != "pair"} - {1}
    if len(numbers) > 1:
        found.append(((names[-1],), f"expected as many values for taxels as elsewhere, found {sorted(numbers)}"))
    if not found:
        across = law.wrong(columns)
        if across is not None:
            found.append(((across[0],), across[1]))
    return found


def per_slot(parameter: Parameter, value: Array) -> Array:
    """`value` with an axis for the slots, as operators want it (`law.Values`)."""
    if parameter.size == "pair":
        return value
    least = 1 if parameter.size == "one" else 2
    return value if value.ndim == least else value[..., None]


def _wrong_value(parameter: Parameter, value: Any, each: bool) -> Wrong:
    refused: Wrong = [((parameter.name,), f"expected {_words(parameter)}, found {_found(value)}")]
    try:
        numbers = np.array(value)
    except ValueError:  # lists of different lengths
        return refused
    dims = {"one": 0, "list": 1, "pair": 2}[parameter.size]
    if numbers.dtype.kind not in "iuf" or not numbers.size or numbers.ndim not in (dims, dims + each):
        return refused
    if parameter.size == "pair" and numbers.shape != (2, 2):
        return refused
    low, high = parameter.low, parameter.high
    right = (numbers >= low) & (numbers <= high)  # nan is neither
    if parameter.whole:
        right &= numbers == np.rint(numbers)
    return [
        ((parameter.name, *map(int, place)), f"expected {_range(parameter)}, found {numbers[tuple(place)]:g}")
        for place in np.argwhere(~right)
    ]


def _range(parameter: Parameter) -> str:
    kind = "a whole number" if parameter.whole else "a number"
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{kind} from {parameter.low:g} to {parameter.high:g}{unit}"


def _words(parameter: Parameter) -> str:
    if parameter.size == "pair":
        return "two identities [[board, triangle], [board, triangle]]"
    text = _range(parameter)
    return f"a list, each {text}" if parameter.size == "list" else text


def _found(value: Any) -> str:
    if isinstance(value, str):
        return f'the text "{value[:50]}"'
    if isinstance(value, Sequence):
        return f"a list of {len(value)}"
    return "nothing" if value is None else str(value)
