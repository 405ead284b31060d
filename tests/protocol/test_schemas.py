"""The JSON schemas against the dataclasses, and real messages against the schemas."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import replace
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, get_args, get_origin

import jsonschema
import msgpack
import numpy as np
import pytest
from oracle import PROTOCOL
from pipeline import NAMES, at_once, config_of, golden, live

from insole_daemon.bus.error_frames import KINDS, OTHER
from insole_daemon.bus.source import BusCounters, InterfaceState, State
from insole_daemon.config import Board
from insole_daemon.physics.effect import Where, effect
from insole_daemon.service.daemon import Daemon
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_setup import load_setups
from insole_daemon.skin.boards import BoardReport, BoardState
from insole_daemon.skin.faults import HEALED, Fault
from insole_daemon.skin.faults import KINDS as FAULT_KINDS
from insole_daemon.skin.layout import Triangle
from insole_daemon.skin.streams import Refused
from insole_daemon.wire.messages import BY_KEY, Array, Event, Health, Meta, Models, wire_fields

SCHEMAS = {path.name.partition(".")[0]: json.loads(path.read_text()) for path in PROTOCOL.glob("*.schema.json")}
JSON_TYPES = {
    int: "integer", float: "number", str: "string", bool: "boolean", NoneType: "null",
    dict: "object", list: "array",
}  # fmt: skip


def says(schema: dict[str, Any]) -> Any:
    """What a schema of one field says of its type, in one word, or as a set, or as an Array."""
    if "x-dtype" in schema:
        assert schema.keys() == {"x-dtype", "x-shape", "description"}
        return Array(schema["x-dtype"], tuple(schema["x-shape"]))
    if "enum" in schema:
        return tuple(schema["enum"])
    return set(schema["type"]) if isinstance(schema["type"], list) else {schema["type"]}


def wants(hint: Any) -> Any:
    """The same of an annotation."""
    if get_origin(hint) is Annotated:
        return next(extra for extra in get_args(hint) if isinstance(extra, Array))
    if get_origin(hint) is Literal:
        return get_args(hint)
    if get_origin(hint) is UnionType:
        return {JSON_TYPES[get_origin(option) or option] for option in get_args(hint)}
    return {JSON_TYPES[get_origin(hint) or hint]}


def objects(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """A schema and all that are nested in it."""
    nested = [*schema.get("properties", {}).values(), *([schema["items"]] if "items" in schema else [])]
    return [schema, *(inner for schemas in nested for inner in objects(schemas))]


def test_one_schema_a_message() -> None:
    assert SCHEMAS.keys() == BY_KEY.keys()


@pytest.mark.parametrize("kind", BY_KEY)
def test_schema_has_the_fields_of_the_dataclass(kind: str) -> None:
    schema, fields = SCHEMAS[kind], wire_fields(BY_KEY[kind])
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["title"] == BY_KEY[kind].SCHEMA
    assert schema["x-encoding"] == f"application/msgpack;{BY_KEY[kind].SCHEMA}"
    assert schema["x-key"] == f"insole/<rig>/<foot>/{kind}"
    assert list(schema["properties"]) == list(fields)
    for name, hint in fields.items():
        assert says(schema["properties"][name]) == wants(hint), name


@pytest.mark.parametrize("kind", BY_KEY)
def test_schema_is_strict_and_explained(kind: str) -> None:
    for schema in objects(SCHEMAS[kind]):
        assert schema["description"]
        if "properties" in schema:
            assert schema["required"] == list(schema["properties"])
            assert schema["additionalProperties"] is False


def names(schema: dict[str, Any], *path: str) -> list[str]:
    for key in path:
        schema = schema["properties"][key]
        schema = schema.get("items", schema)
    return list(schema["properties"])


def test_nested_maps_are_those_of_the_code() -> None:
    def fields(of: type) -> list[str]:
        return [field.name for field in dataclasses.fields(of) if field.name != "extensions"]

    health, meta = SCHEMAS["health"], SCHEMAS["meta"]
    assert names(health, "boards") == fields(BoardReport)
    assert names(health, "faults") == fields(Fault)
    assert tuple(health["properties"]["faults"]["items"]["properties"]["kind"]["enum"]) == FAULT_KINDS
    assert names(health, "bus") == fields(BusCounters)
    interface = health["properties"]["bus"]["properties"]["interfaces"]["additionalProperties"]["properties"]
    assert list(interface) == fields(InterfaceState)
    assert tuple(interface["state"]["enum"]) == get_args(State)
    assert names(health, "refused") == fields(Refused)
    assert names(meta, "triangles") == fields(Triangle)[:3]
    assert names(meta, "boards") == fields(Board)
    state = health["properties"]["boards"]["items"]["properties"]["state"]
    assert tuple(state["enum"]) == get_args(BoardState)
    kinds = health["properties"]["bus"]["properties"]["error_frames"]["propertyNames"]["enum"]
    assert kinds == [*KINDS.values(), OTHER]


def assert_valid(kind: str, payload: bytes) -> None:
    """The payload against its schema: jsonschema for what JSON knows, and the arrays by dtype and shape."""
    schema = SCHEMAS[kind]
    message = msgpack.unpackb(payload)
    jsonschema.validate(message, schema, cls=jsonschema.Draft202012Validator)
    for name, of in schema["properties"].items():
        assert isinstance(message[name], bytes) == ("x-dtype" in of), name
        if "x-dtype" in of:
            shape = [message[axis] if isinstance(axis, str) else axis for axis in of["x-shape"]]
            assert len(message[name]) == np.dtype(of["x-dtype"]).itemsize * np.prod(shape), name


@pytest.mark.parametrize("name", NAMES)
def test_published_messages_follow_their_schemas(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    published = live(name, monkeypatch)
    what_of = {cls: what for what, cls in BY_KEY.items()}
    cycles = [message for foot in published.cycles for cycle in foot for message in cycle]
    seen = set()
    for message in [*cycles, *published.others]:
        seen.add(type(message))
        if isinstance(message, Health) and (message.refused["unconfigured_board"] or message.refused["overflow"]):
            continue  # below
        assert_valid(what_of[type(message)], message.encode())
    assert seen == set(BY_KEY.values()) - {Models}, "its calibrations have no effects"


def test_messages_of_a_foot_with_effects_are_valid() -> None:
    swap = Where("triangle", ((5, 0), (5, 1)))
    effects = (
        effect("hysteresis", r_pa=[5e3], w=[0.1]),
        effect("delay", delay_s=0.02),
        effect("temperature", swap, count_per_k=0.1, gain_per_k=0.0, t0_c=25.0),
    )
    for foot, cycles in zip(("left", "right"), at_once("walk", effects).models, strict=True):
        assert len(cycles) > 10
        for models in cycles:
            assert models.foot == foot
            assert_valid("models", models.encode())
    (setup, _) = load_setups(config_of("walk"))
    meta = Foot(replace(setup, calibration=replace(setup.calibration, effects=effects))).meta()
    assert_valid("meta", meta.encode())
    assert [bool(entry["left_out"]) for entry in meta.effects] == [False, False, True]


def last_health(name: str, monkeypatch: pytest.MonkeyPatch) -> Health:
    return [message for message in live(name, monkeypatch).others if isinstance(message, Health)][-1]


@pytest.mark.parametrize("name", ["faults", "mtb3"])
def test_health_with_addresses_is_valid(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    health = last_health(name, monkeypatch)
    assert Health.decode(health.encode()).refused == golden(name)["refused"]
    assert_valid("health", health.encode())


def test_health_counts_what_the_golden_log_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    health, expected = last_health("slow", monkeypatch), golden("slow")["feet"][1]
    assert health.foot == "right"
    assert health.state == "ok"
    assert health.cycles["published"] <= len(expected["cycles"]) <= health.cycles["published"] + 6
    assert health.cycles["missed_halves"] == expected["missed_halves"]
    assert health.cycles["late"] == sum(cycle["late"] for cycle in expected["cycles"])
    assert health.cycles["skipped"] == 0
    assert health.cycles["extrapolated"] == 0, "its calibration does not say how far its curves were seen"
    rates = {board["address"]: board["rate_hz"] for board in health.boards}
    assert rates == {8: pytest.approx(20, abs=10), 9: pytest.approx(50, abs=10), 10: pytest.approx(50, abs=10)}


def test_events_tell_of_boards_that_come_and_go(monkeypatch: pytest.MonkeyPatch) -> None:
    published = live("faults", monkeypatch, health_every_ns=20_000_000)
    events = [message for message in published.others if isinstance(message, Event)]
    kinds = {
        address: [event.kind for event in events if address in event.boards and event.triangle is None]
        for address in (8, 9, 10)
    }
    came_back = ("board_streaming", "board_silent", "board_streaming", "board_reset")
    assert set(map(tuple, kinds.values())) == {came_back}


def test_events_come_soon_although_a_cycle_is_always_promised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Daemon, "_is_calm", lambda self: False)
    messages = live("faults", monkeypatch, health_every_ns=20_000_000).others
    of_foot = [message for message in messages if isinstance(message, Event | Health) and message.foot == "right"]
    first = next(at for at, message in enumerate(of_foot) if isinstance(message, Event))
    assert any(isinstance(message, Health) for message in of_foot[first:]), "not only at the end of the log"


def test_meta_has_the_settings_of_the_golden_log(monkeypatch: pytest.MonkeyPatch) -> None:
    (meta,) = [message for message in live("mtb3", monkeypatch).others if isinstance(message, Meta)]
    assert meta.rig == "golden"
    assert not meta.layout_builtin
    assert meta.calibration_builtin
    for key, value in golden("mtb3")["settings"].items():
        assert getattr(meta, key) == value


def test_every_message_is_in_keys_md() -> None:
    text = (PROTOCOL / "keys.md").read_text()
    for kind in BY_KEY:
        assert f"| `{kind}` |" in text
        assert f"({kind}.schema.json)" in text
    for name in [*SCHEMAS["health"]["properties"]["refused"]["properties"], *FAULT_KINDS, *HEALED.values()]:
        assert f"`{name}`" in text
