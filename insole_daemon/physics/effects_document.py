"""Effects out of and into JSON: the `effects` of insole-calibration/1, or a file of nothing else.

    {"effect": "lag", "where": {"scope": "board", "ids": [[6]]},
     "parameters": {"tau_s": {"value": 0.03, "std": 0.002, "unit": "s"}}, "valid_range": {"pressure_pa": [0, 340000]}}

Where the value of a parameter differs from taxel to taxel there is an entry for each; a chain runs them as one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from os import PathLike
from typing import Any

import numpy as np

from ..documents import Key, Reading, Section, read
from ..skin.layout import Layout
from .effect import Effect, Where, wrong_values, wrong_where
from .effects import laws
from .law import Array, Law, Scope

FORMAT = "insole-effects/1"
_LARGEST = 2**1023  # of numbers that a float can be


@dataclass(frozen=True, slots=True, kw_only=True)
class _Where(Section):
    scope: Scope
    ids: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Quantity(Section):
    value: Any
    std: Any = None
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry(Section):
    effect: str
    where: _Where
    parameters: Mapping[str, Any]
    valid_range: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class _File(Section):
    effects: tuple[_Entry, ...]


def load(path: str | PathLike[str], layout: Layout) -> tuple[Effect, ...]:
    """The effects in file `path`, YAML or JSON of the format above, for `layout`; DocumentError lists what is wrong."""
    found: list[Effect] = []
    read(path, _File, FORMAT, lambda reading: found.extend(_effects(reading, layout)))
    return tuple(found)


def parse(reading: Reading, raw: Sequence[Any], layout: Layout, key: Key = ("effects",)) -> tuple[Effect, ...]:
    """The effects of the list `raw` that stands at `key` of a file; those that are wrong are reported to `reading`."""
    for i, entry in enumerate(raw):
        reading.section(_Entry, entry, (*key, i))
    return tuple(_effects(reading, layout))


def document(effects: Iterable[Effect], layout: Layout) -> list[dict[str, Any]]:
    """The entries, as plain maps, lists and numbers."""
    return [entry for effect in effects for entry in _entries(effect, layout)]


def _effects(reading: Reading, layout: Layout) -> list[Effect]:
    effects = []
    for key, entry in reading.of(_Entry):
        law = laws().get(entry.effect)
        if law is None:
            near = get_close_matches(entry.effect, list(laws()), n=1)
            hint = f': did you mean "{near[0]}"?' if near else f": known are {', '.join(laws())}"
            reading.problem((*key, "effect"), f'unknown effect "{entry.effect}"{hint}')
            continue
        where = Where(entry.where.scope, entry.where.ids)
        wrong = [(("where", *at), message) for at, message in wrong_where(law, where, layout)]
        values, std, wrong_parameters = _quantities(reading, law, entry.parameters, (*key, "parameters"))
        wrong += [(("parameters", *at), message) for at, message in wrong_parameters]
        wrong += _wrong_pair(values.get("pair"), where, layout)
        wrong += [
            (("valid_range", name), "expected two numbers, the lower one first")
            for name, limits in entry.valid_range.items()
            if not _is_range(limits)
        ]
        for at, message in wrong:
            reading.problem((*key, *at), message)
        if not wrong and len(values) == len(law.parameters):
            valid = {name: (float(low), float(high)) for name, (low, high) in entry.valid_range.items()}
            arrays = {name: np.array(value, float) for name, value in values.items()}
            effects.append(Effect(law, where, arrays, std, valid))
    return effects


def _quantities(
    reading: Reading, law: Law, raw: Mapping[str, Any], key: Key
) -> tuple[dict[str, Any], dict[str, Array], list[tuple[Key, str]]]:
    """Values and standard deviations by name, and what is wrong within `parameters`."""
    units = {parameter.name: parameter.unit for parameter in law.parameters}
    wrong: list[tuple[Key, str]] = []
    given: dict[str, Any] = {}
    unread = set()
    std: dict[str, Array] = {}
    for name, quantity in raw.items():
        if name not in units:
            given[name] = None
            continue
        found = reading.section(_Quantity, quantity, (*key, name))
        if not isinstance(found, _Quantity):
            unread.add(name)
            continue
        given[name] = found.value
        if found.unit != units[name]:
            wrong.append(((name, "unit"), f'expected the unit "{units[name]}", found "{found.unit}"'))
        value = _array(found.value)
        if found.std is not None and value is not None:  # what is no value is told below
            of_value = _array(found.std)
            if of_value is None or of_value.shape != value.shape or not (of_value >= 0).all():
                wrong.append(((name, "std"), "expected a number of at least 0 for each of the value"))
            else:
                std[name] = of_value
    for at, message in wrong_values(law, given):
        if at[0] not in unread:
            wrong.append(((at[0], "value", *at[1:]) if at[0] in given and at[0] in units else at, message))
    return given, std, wrong


def _array(raw: Any) -> Array | None:
    """Numbers as a file has them, None where they are none, or too large, or lists of different lengths."""
    try:
        return np.array(raw, float)
    except (TypeError, ValueError, OverflowError):
        return None


def _wrong_pair(pair: Any, where: Where, layout: Layout) -> list[tuple[Key, str]]:
    """What is wrong with the pair of `swapped_triangles`, the one effect whose ids stand in a parameter too."""
    if np.shape(pair) != (2, 2):
        return []
    ids = tuple(tuple(identity) for identity in pair)
    at = ("parameters", "pair", "value")
    wrong: list[tuple[Key, str]] = [
        ((*at, *where_in[1:]), message) for where_in, message in Where("triangle", ids).wrong(layout)
    ]
    if where.scope != "triangle" or set(where.ids) != set(ids):
        wrong.append((("where",), f'expected the scope "triangle" and the ids of the pair, {[list(i) for i in ids]}'))
    return wrong


def _is_range(limits: Any) -> bool:
    return (
        isinstance(limits, list)
        and len(limits) == 2
        and all(type(limit) in (int, float) and abs(limit) < _LARGEST for limit in limits)
        and limits[0] <= limits[1]
    )


def _entries(effect: Effect, layout: Layout) -> list[dict[str, Any]]:
    dims = {"one": 0, "list": 1, "pair": 2}
    wide = [p.name for p in effect.law.parameters if effect.values[p.name].ndim > dims[p.size]]
    if not wide:
        return [_entry(effect, effect.where, {}, slice(None))]
    identities = layout.identities.tolist()
    return [
        _entry(effect, Where("taxel", ((*identities[slot // 12], slot % 12),)), dict.fromkeys(wide, True), column)
        for column, slot in enumerate(effect.where.slots(layout).tolist())
    ]


def _entry(effect: Effect, where: Where, wide: Mapping[str, bool], column: Any) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    for parameter in effect.law.parameters:
        name = parameter.name
        quantity: dict[str, Any] = {}
        for word, numbers in (("value", effect.values), ("std", effect.std)):
            if name in numbers:
                own = numbers[name][..., column] if name in wide else numbers[name]
                quantity[word] = (np.rint(own).astype(int) if parameter.whole and word == "value" else own).tolist()
        parameters[name] = {**quantity, "unit": parameter.unit}
    entry: dict[str, Any] = {
        "effect": effect.law.word,
        "where": {"scope": where.scope, "ids": [list(identity) for identity in where.ids]},
        "parameters": parameters,
    }
    if effect.valid_range:
        entry["valid_range"] = {name: list(limits) for name, limits in effect.valid_range.items()}
    return entry
