"""Read and write effects as JSON: the `effects` of insole-calibration/1, or a file of effects alone.

    {"effect": "lag", "where": {"scope": "board", "ids": [[6]]},
     "parameters": {"tau_s": {"value": 0.03, "std": 0.002, "unit": "s"}}, "valid_range": {"pressure_pa": [0, 340000]}}

If a parameter differs between taxels, the file has one entry per taxel; a chain runs them as one.
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
from .effect import Effect, Where, value_problems, where_problems
from .effects import laws
from .law import Array, Law, Scope

FORMAT = "insole-effects/1"
_LARGEST = 2**1023  # larger integers do not fit into a float


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
    """Load the effects in file `path` (YAML or JSON) for `layout`; DocumentError lists all problems."""
    effects: list[Effect] = []
    read(path, _File, FORMAT, lambda reading: effects.extend(_build_effects(reading, layout)))
    return tuple(effects)


def parse(reading: Reading, raw: Sequence[Any], layout: Layout, key: Key = ("effects",)) -> tuple[Effect, ...]:
    """Return the effects of the list `raw` at `key` of a file; report problems to `reading`."""
    for i, entry in enumerate(raw):
        reading.section(_Entry, entry, (*key, i))
    return tuple(_build_effects(reading, layout))


def document(effects: Iterable[Effect], layout: Layout) -> list[dict[str, Any]]:
    """Return the entries as plain maps, lists and numbers."""
    return [entry for effect in effects for entry in _entries(effect, layout)]


def _build_effects(reading: Reading, layout: Layout) -> list[Effect]:
    """Return the effects of all entries without a problem, and report the others to `reading`."""
    effects = []
    for key, entry in reading.of(_Entry):
        law = laws().get(entry.effect)
        if law is None:
            similar = get_close_matches(entry.effect, list(laws()), n=1)
            hint = f': did you mean "{similar[0]}"?' if similar else f": known are {', '.join(laws())}"
            reading.problem((*key, "effect"), f'unknown effect "{entry.effect}"{hint}')
            continue
        where = Where(entry.where.scope, entry.where.ids)
        problems = [(("where", *key_within), message) for key_within, message in where_problems(law, where, layout)]
        values, std, wrong_parameters = _read_quantities(reading, law, entry.parameters, (*key, "parameters"))
        problems += [(("parameters", *key_within), message) for key_within, message in wrong_parameters]
        problems += _pair_problems(values.get("pair"), where, layout)
        problems += [
            (("valid_range", name), "expected two numbers, the lower one first")
            for name, limits in entry.valid_range.items()
            if not _is_range(limits)
        ]
        for key_within, message in problems:
            reading.problem((*key, *key_within), message)
        if not problems and all(p.is_optional or p.name in values for p in law.parameters):
            valid = {name: (float(low), float(high)) for name, (low, high) in entry.valid_range.items()}
            arrays = {name: np.array(value, float) for name, value in values.items()}
            effects.append(Effect(law, where, arrays, std, valid))
    return effects


def _read_quantities(
    reading: Reading, law: Law, raw: Mapping[str, Any], key: Key
) -> tuple[dict[str, Any], dict[str, Array], list[tuple[Key, str]]]:
    """Return values and standard deviations by name, and the problems within `parameters`."""
    units = {parameter.name: parameter.unit for parameter in law.parameters}
    problems: list[tuple[Key, str]] = []
    values: dict[str, Any] = {}
    unreadable = set()
    std: dict[str, Array] = {}
    for name, quantity in raw.items():
        if name not in units:
            values[name] = None
            continue
        section = reading.section(_Quantity, quantity, (*key, name))
        if not isinstance(section, _Quantity):
            unreadable.add(name)
            continue
        values[name] = section.value
        if section.unit != units[name]:
            problems.append(((name, "unit"), f'expected the unit "{units[name]}", found "{section.unit}"'))
        value = _to_array(section.value)
        if section.std is not None and value is not None:  # value_problems() reports a bad value
            deviations = _to_array(section.std)
            if deviations is None or deviations.shape != value.shape or not (deviations >= 0).all():
                problems.append(((name, "std"), "expected a number of at least 0 for each of the value"))
            else:
                std[name] = deviations
    for key_within, message in value_problems(law, values):
        if key_within[0] not in unreadable:
            problems.append(
                (
                    (key_within[0], "value", *key_within[1:])
                    if key_within[0] in values and key_within[0] in units
                    else key_within,
                    message,
                )
            )
    return values, std, problems


def _to_array(raw: Any) -> Array | None:
    """Return the numbers of a file as an array, or None if they are not numbers, too large, or ragged lists."""
    try:
        return np.array(raw, float)
    except (TypeError, ValueError, OverflowError):
        return None


def _pair_problems(pair: Any, where: Where, layout: Layout) -> list[tuple[Key, str]]:
    """Return the problems of the pair of `swapped_triangles`, whose ids are in a parameter as well as in `where`."""
    if np.shape(pair) != (2, 2):
        return []
    ids = tuple(tuple(identity) for identity in pair)
    key = ("parameters", "pair", "value")
    problems: list[tuple[Key, str]] = [
        ((*key, *key_within[1:]), message) for key_within, message in Where("triangle", ids).problems(layout)
    ]
    if where.scope != "triangle" or set(where.ids) != set(ids):
        problems.append(
            (("where",), f'expected the scope "triangle" and the ids of the pair, {[list(i) for i in ids]}')
        )
    return problems


def _is_range(limits: Any) -> bool:
    return (
        isinstance(limits, list)
        and len(limits) == 2
        and all(type(limit) in (int, float) and abs(limit) < _LARGEST for limit in limits)
        and limits[0] <= limits[1]
    )


def _entries(effect: Effect, layout: Layout) -> list[dict[str, Any]]:
    """Return one entry for the effect, or one per taxel if a parameter differs between taxels."""
    dims = {"one": 0, "list": 1, "pair": 2}
    per_taxel = [p.name for p in effect.law.given(effect.values) if effect.values[p.name].ndim > dims[p.size]]
    if not per_taxel:
        return [_entry(effect, effect.where, {}, slice(None))]
    identities = layout.identities.tolist()
    return [
        _entry(effect, Where("taxel", ((*identities[slot // 12], slot % 12),)), dict.fromkeys(per_taxel, True), column)
        for column, slot in enumerate(effect.where.slots(layout).tolist())
    ]


def _entry(effect: Effect, where: Where, per_taxel: Mapping[str, bool], column: Any) -> dict[str, Any]:
    """Return one entry; `per_taxel` names the parameters of which `column` selects the taxel's value."""
    parameters: dict[str, Any] = {}
    for parameter in effect.law.given(effect.values):
        name = parameter.name
        quantity: dict[str, Any] = {}
        for word, numbers in (("value", effect.values), ("std", effect.std)):
            if name in numbers:
                array = numbers[name][..., column] if name in per_taxel else numbers[name]
                quantity[word] = (np.rint(array).astype(int) if parameter.whole and word == "value" else array).tolist()
        parameters[name] = {**quantity, "unit": parameter.unit}
    entry: dict[str, Any] = {
        "effect": effect.law.word,
        "where": {"scope": where.scope, "ids": [list(identity) for identity in where.ids]},
        "parameters": parameters,
    }
    if effect.valid_range:
        entry["valid_range"] = {name: list(limits) for name, limits in effect.valid_range.items()}
    return entry
