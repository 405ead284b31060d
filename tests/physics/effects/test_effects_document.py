"""Effects are read from and written to JSON, and all problems are reported together."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insole_daemon.documents import Reading
from insole_daemon.errors import DocumentError, EffectError
from insole_daemon.physics import effects_document
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
INSOLE = {"scope": "insole", "ids": []}

Load = Callable[..., tuple[Effect, ...]]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    def load(*entries: Any, indent: int | None = None) -> tuple[Effect, ...]:
        path = tmp_path / "effects.json"
        path.write_text(json.dumps({"format": effects_document.FORMAT, "effects": entries}, indent=indent))
        return effects_document.load(path, LAYOUT)

    return load


@pytest.fixture
def refused(load: Load) -> Callable[..., list[str]]:
    def refused(*entries: Any) -> list[str]:
        with pytest.raises(DocumentError) as caught:
            load(*entries)
        return [f"{problem.key}: {problem.message}" for problem in caught.value.problems]

    return refused


def quantity(value: Any, unit: str, **more: Any) -> dict[str, Any]:
    return {"value": value, "unit": unit, **more}


def lag(**more: Any) -> dict[str, Any]:
    return {"effect": "lag", "where": INSOLE, "parameters": {"tau_s": quantity(0.03, "s")}, **more}


FORMATS_EXAMPLE = {
    "effect": "hysteresis",
    "where": {"scope": "board", "ids": [[6]]},
    "parameters": {
        "r_pa": {"value": [2000, 8000], "std": [300, 900], "unit": "Pa"},
        "w": {"value": [0.05, 0.03], "std": [0.01, 0.01], "unit": "1"},
    },
    "valid_range": {"pressure_pa": [0, 340000]},
}


def test_the_example_of_the_format_is_read(load: Load) -> None:
    (parsed,) = load(FORMATS_EXAMPLE)
    assert parsed.law.word == "hysteresis"
    assert parsed.where == Where("board", ((6,),))
    assert parsed.values["r_pa"].tolist() == [2000, 8000]
    assert parsed.std["w"].tolist() == [0.01, 0.01]
    assert parsed.valid_range == {"pressure_pa": (0, 340000)}


def test_written_effects_equal_those_read(load: Load) -> None:
    swapped = {
        "effect": "swapped_triangles",
        "where": {"scope": "triangle", "ids": [[5, 0], [6, 4]]},
        "parameters": {"pair": quantity([[5, 0], [6, 4]], "1")},
    }
    shift = {"effect": "bit_shift", "where": INSOLE, "parameters": {"shift": quantity(4, "1")}}
    entries = [FORMATS_EXAMPLE, lag(), swapped, shift]
    assert effects_document.document(load(*entries), LAYOUT) == entries


def test_per_taxel_values_are_written_as_one_entry_per_taxel(load: Load) -> None:
    made = effect("hysteresis", Where("triangle", ((6, 4),)), r_pa=[1e3, 2e3], w=np.linspace(0, 0.2, 24).reshape(2, 12))
    entries = effects_document.document([made], LAYOUT)
    assert len(entries) == 12
    assert entries[3]["where"] == {"scope": "taxel", "ids": [[6, 4, 3]]}
    loaded = load(*entries)
    assert [e.values["w"].tolist() for e in loaded] == made.values["w"].T.tolist()


def test_yaml_and_json_read_the_same(tmp_path: Path) -> None:
    path = tmp_path / "effects.yaml"
    path.write_text(
        "format: insole-effects/1\neffects:\n"
        "  - {effect: lag, where: {scope: board, ids: [[6]]}, parameters: {tau_s: {value: 0.03, unit: s}}}\n"
    )
    (parsed,) = effects_document.load(path, LAYOUT)
    assert parsed.values["tau_s"] == 0.03


def test_all_problems_are_reported_with_key_and_range(refused: Callable[..., list[str]]) -> None:
    assert refused(
        {"effect": "viscoelastic", "where": INSOLE, "parameters": {}},
        {"effect": "lag", "where": INSOLE, "parameters": {"tau_s": quantity(0.0, "s")}},
        {"effect": "hysteresis", "where": INSOLE, "parameters": {
            "r_pa": quantity([2000, -1], "Pa"), "w": quantity([0.05, 2], "1")}},
        {"effect": "creep", "where": INSOLE, "parameters": {
            "a": quantity([0.5, 0.5], "1"), "tau_s": quantity([1, 10], "s")}},
        {"effect": "snap", "where": INSOLE, "parameters": {
            "up_pa": quantity(1e4, "Pa"), "down_pa": quantity(2e4, "Pa"), "step_pa": quantity(1e3, "Pa")}},
        lag(where={"scope": "board", "ids": [[9]]}),
    ) == [
        'effects[0].effect: unknown effect "viscoelastic": did you mean "viscoelasticity"?',
        "effects[1].parameters.tau_s.value: expected a number from 0.0001 to 10 s, found 0",
        "effects[2].parameters.r_pa.value[1]: expected a number from 0 to 1e+07 Pa, found -1",
        "effects[2].parameters.w.value[1]: expected a number from 0 to 0.95, found 2",
        "effects[3].parameters.a.value: expected numbers whose sum is at most 0.95, found the sum 1",
        "effects[4].parameters.down_pa.value: expected less than up_pa, which is 10000, found 20000",
        "effects[5].where.ids[0]: board 9 is not in the layout: are these effects of another insole?",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (lag(parameters={"tau_s": quantity(30, "ms")}), 'tau_s.unit: expected the unit "s", found "ms"'),
        (lag(parameters={"tau": quantity(0.03, "s")}), "parameters.tau: unknown parameter: lag has tau_s"),
        (lag(parameters={}), "parameters.tau_s: missing key: expected a number from 0.0001 to 10 s"),
        (lag(parameters={"tau_s": quantity("fast", "s")}), 'tau_s.value: expected a number .* the text "fast"'),
        (lag(parameters={"tau_s": quantity(None, "s")}), "tau_s.value: expected a number from .* found"),
        (lag(parameters={"tau_s": quantity([0.03, 0.04], "s")}), "tau_s.value: expected a number .* a list of 2"),
        (lag(parameters={"tau_s": quantity(["0.03"], "s")}), "tau_s.value: expected a number .* a list of 1"),
        (lag(parameters={"tau_s": quantity(True, "s")}), "tau_s.value: expected a number .* True"),
        (lag(parameters={"tau_s": 0.03}), "tau_s: expected a map of keys, found 0.03"),
        (lag(parameters={"tau_s": {"value": 0.03}}), "tau_s.unit: missing key"),
        (lag(parameters={"tau_s": quantity(0.03, "s", std=-1)}), "tau_s.std: expected a number of at least 0"),
        (lag(where={"scope": "foot", "ids": []}), "where.scope: expected one of insole, board, triangle, taxel"),
        (lag(where={"scope": "board", "ids": []}), r"where.ids: expected at least one \[board\]"),
        (lag(where={"scope": "insole", "ids": [[5]]}), "where.ids: expected no ids where the scope is the insole"),
        (lag(where={"scope": "triangle", "ids": [[5]]}), r"ids\[0\]: expected \[board, triangle\], found 1 numbers"),
        (lag(where={"scope": "taxel", "ids": [[5, 0, 12]]}), r"ids\[0\]: expected a taxel from 0 to 11, found 12"),
        (lag(where={"scope": "board", "ids": [[5], [5]]}), r"ids\[1\]: board 5 is listed twice"),
        (lag(where={"scope": "triangle", "ids": [[5, 15], [5, 2]]}), r"ids\[1\]: board 5, triangle 2 is not in the"),
        (lag(valid_range={"pressure_pa": [5, 1]}), "valid_range.pressure_pa: expected two numbers, the lower one"),
        (lag(wher=INSOLE), 'wher: unknown key: did you mean "where"?'),
        ({"effect": "lag", "where": INSOLE}, "parameters: missing key"),
        ("lag", r"effects\[0\]: expected a map of keys, found the text"),
        (
            {"effect": "drift", "where": INSOLE, "parameters": {
                "t_s": quantity([0, 1, 2], "s"), "shift_count": quantity([0, 1], "count")}},
            "shift_count.value: expected lists of the same length, found 3 of t_s, 2 of shift_count",
        ),
        (
            {"effect": "drift", "where": INSOLE, "parameters": {
                "t_s": quantity([0, 0], "s"), "shift_count": quantity([0, 1], "count")}},
            "t_s.value: expected times that grow",
        ),
        (
            {"effect": "bit_shift", "where": INSOLE, "parameters": {"shift": quantity(2.5, "1")}},
            "shift.value: expected a whole number from 0 to 7, found 2.5",
        ),
        (
            {"effect": "clock", "where": {"scope": "board", "ids": [[5]]}, "parameters": {
                "offset_s": quantity(0, "s"), "rate": quantity(0, "1")}},
            'where.scope: expected the scope "insole" of clock, found "board"',
        ),
        (
            {"effect": "swapped_triangles", "where": {"scope": "triangle", "ids": [[5, 0]]}, "parameters": {
                "pair": quantity([[5, 0], [5, 1]], "1")}},
            'where: expected the scope "triangle" and the ids of the pair',
        ),
        (
            {"effect": "swapped_triangles", "where": {"scope": "triangle", "ids": [[5, 0], [5, 2]]}, "parameters": {
                "pair": quantity([[5, 0], [5, 2]], "1")}},
            r"pair.value\[1\]: board 5, triangle 2 is not in the layout",
        ),
        (
            {"effect": "swapped_triangles", "where": {"scope": "triangle", "ids": [[5, 0], [5, 1]]}, "parameters": {
                "pair": quantity([5, 0], "1")}},
            "pair.value: expected two identities",
        ),
    ],
)  # fmt: skip
def test_invalid_effects_are_refused_with_a_reason(
    refused: Callable[..., list[str]], entry: Any, expected: str
) -> None:
    reasons = refused(entry)
    assert any(re.search(expected, problem) for problem in reasons), reasons


def test_problems_state_their_line(load: Load) -> None:
    with pytest.raises(DocumentError) as caught:
        load(lag(), lag(parameters={"tau_s": quantity(99, "s")}), indent=1)
    (problem,) = caught.value.problems
    assert problem.line is not None
    assert Path(caught.value.path).read_text().splitlines()[problem.line - 1].strip() == '"value": 99,'


def test_another_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps({"effects": [FORMATS_EXAMPLE, lag(effect="laag"), 7]}))
    reading = Reading(path)
    (parsed,) = effects_document.parse(reading, reading.document["effects"], LAYOUT)
    assert parsed.law.word == "hysteresis"
    with pytest.raises(DocumentError) as caught:
        reading.finish()
    assert {problem.key for problem in caught.value.problems} == {"effects[1].effect", "effects[2]"}


def test_effects_made_in_code_are_checked_like_files() -> None:
    with pytest.raises(EffectError, match=r"lag: parameters\.tau_s: expected a number from 0\.0001 to 10 s, found 20"):
        effect("lag", tau_s=20)
    with pytest.raises(EffectError, match='unknown effect "laag": known are'):
        effect("laag", tau_s=20)
    with pytest.raises(EffectError, match=r"expected as many values for taxels as elsewhere, found \[2, 3\]"):
        effect("snap", up_pa=[3e4, 4e4], down_pa=[1e4, 1e4, 1e4], step_pa=1e3)
    with pytest.raises(EffectError, match=r"where\.ids: expected at least one"):
        effect("lag", Where("board"), tau_s=0.1)
