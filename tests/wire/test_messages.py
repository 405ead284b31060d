"""Messages there and back, and every way in which a payload is none."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.config import Config
from insole_daemon.errors import WireError
from insole_daemon.physics.effect import effect
from insole_daemon.service.foot import CycleMessages, Foot, load_feet
from insole_daemon.service.foot_setup import load_setups
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.messages import (
    BY_KEY,
    CalibrationInUse,
    Event,
    Health,
    Message,
    Meta,
    Models,
    Raw,
    Wrench,
    wire_fields,
)

NAN = float("nan")
FOOT = load_feet(Config())[0]
N = FOOT.n_triangles


def with_effects() -> Foot:
    setup = load_setups(Config())[0]
    effects = (effect("viscoelasticity", a=0.1, tau_s=0.3), effect("delay", delay_s=0.02))
    return Foot(replace(setup, calibration=replace(setup.calibration, effects=effects)))


def cycle(counts: int = 200, foot: Foot = FOOT) -> CycleMessages:
    """The messages of a cycle that one half of all triangles but the last has closed late."""
    reader = SkinReader([FOOT.layout], period_ns=20_000_000, slack_ns=5_000_000)
    (assembler,) = reader.assemblers
    slots = np.arange(2 * N - 1, dtype=np.int16)
    data = np.full((len(slots), 8), counts, np.uint8)
    data[1::2, 6:] = 0
    t_ns = 1_000_000_000 + 100_000 * slots.astype(np.int64)
    assembler.feed(slots, data, t_ns + 7, t_ns)
    (closed,) = assembler.advance(2_000_000_000)[:1]
    return foot.messages(closed, 0)


def both_models() -> Models:
    models = cycle(foot=with_effects()).models
    assert models is not None
    return models


HEALTH = Health(
    foot="left", t_ns=1, uptime_s=2.5, state="degraded", cycles={"published": 3}, publish_rate_hz=50.0,
    quality={"share": 1.0}, latency_ms={"p50": None}, boards=[{"address": 5}], faults=[], bus={"frames": 1},
    refused={"other": 0},
    asked={"requests_done": 0},
)  # fmt: skip
EVENT = Event("right", 1, "board_silent", "board 8: streaming → silent", [8])
MESSAGES: list[Message] = [*cycle().published(), both_models(), HEALTH, EVENT, FOOT.meta(), FOOT.calibration_in_use()]
every_message = pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)


def encoding(message: Message | type[Message]) -> str:
    return f"application/msgpack;{message.SCHEMA}"


def test_every_kind_is_here() -> None:
    assert {type(message) for message in MESSAGES} == set(BY_KEY.values())
    versions = dict.fromkeys(BY_KEY, 1) | {"event": 2, "health": 4, "pressure": 2, "wrench": 2, "meta": 2}
    assert {cls.SCHEMA for cls in BY_KEY.values()} == {f"insole.{what}/{number}" for what, number in versions.items()}


@every_message
def test_round_trip(message: Message) -> None:
    payload = message.encode()
    decoded = type(message).decode(payload, encoding(message))
    assert decoded.encode() == payload
    for name in wire_fields(type(message)):
        before, after = getattr(message, name), getattr(decoded, name)
        if isinstance(before, np.ndarray):
            assert (after.dtype, after.shape) == (before.dtype, before.shape), name
            np.testing.assert_array_equal(after, before, err_msg=name)
        elif before != before:
            assert after is None, name
        else:
            assert after == before, name


def test_unknown_values_are_nil_on_the_wire_and_none_in_python() -> None:
    _, _, wrench, _ = cycle(0)
    assert np.isnan(wrench.f_z_std_n)
    assert msgpack.unpackb(wrench.encode())["f_z_std_n"] is None
    assert Wrench.decode(wrench.encode()).f_z_std_n is None


def test_arrays_travel_as_little_endian_bytes() -> None:
    raw, *_ = cycle()
    fields = msgpack.unpackb(raw.encode())
    assert fields["counts"] == bytes(raw.counts.ravel().tolist())
    assert fields["triangle_t_ns"][:8] == int(raw.triangle_t_ns[0]).to_bytes(8, "little")
    assert np.frombuffer(fields["age_ms"], "<f4")[0] == pytest.approx(25.0)
    assert np.isnan(np.frombuffer(fields["age_ms"], "<f4")[-1])


def test_lost_stays_at_home() -> None:
    raw, *_ = cycle()
    assert "lost" not in msgpack.unpackb(replace(raw, lost=3).encode())
    assert Raw.decode(replace(raw, lost=3).encode()).lost == 0


def refusal(payload: bytes, cls: type[Message] = Wrench, encoding_of: str | None = None) -> str:
    with pytest.raises(WireError) as caught:
        cls.decode(payload, encoding_of)
    return str(caught.value)


def wrench_with(**changes: Any) -> bytes:
    fields = msgpack.unpackb(cycle()[2].encode()) | changes
    return msgpack.packb({key: value for key, value in fields.items() if value is not ...})


@pytest.mark.parametrize(
    "payload",
    [b"", b"\xc1", b"not msgpack", b"\x81", cycle()[2].encode()[:-1], cycle()[2].encode() + b"\0"],
    ids=["empty", "no such byte", "text", "cut", "cut at the end", "something behind it"],
)
def test_not_msgpack(payload: bytes) -> None:
    assert refusal(payload).startswith("insole.wrench/2: expected a msgpack map, found ")


@pytest.mark.parametrize(("value", "kind"), [([1], "list"), (3, "int"), (None, "NoneType"), (b"x", "bytes")])
def test_not_a_map(value: Any, kind: str) -> None:
    assert refusal(msgpack.packb(value)) == f"insole.wrench/2: expected a msgpack map, found {kind}"


def test_a_missing_key() -> None:
    message = refusal(wrench_with(cop_x_m=...))
    assert "expected the keys ['age_ms', 'beyond_fraction', 'contact_area_m2'," in message
    assert "missing ['cop_x_m'], unknown []" in message


def test_an_unknown_key() -> None:
    assert "missing [], unknown ['cop_z_m']" in refusal(wrench_with(cop_z_m=0.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"valid": bytes(12 * N - 1)}, f"valid: expected {12 * N} bytes for |u1 [{N}, 12], found {12 * N - 1}"),
        ({"age_ms": b""}, f"age_ms: expected {4 * N} bytes for <f4 [{N}], found 0"),
        ({"n_triangles": N + 1}, f"valid: expected {12 * N + 12} bytes"),
        ({"valid": [1] * 12 * N}, "valid: expected bytes of |u1 ('n_triangles', 12), found [1, 1"),
        ({"age_ms": "x" * 4 * N}, "age_ms: expected bytes of <f4 ('n_triangles',), found 'xxx"),
        ({"age_ms": None}, "age_ms: expected bytes of <f4 ('n_triangles',), found None"),
        ({"foot": "middle"}, "foot: expected typing.Literal['left', 'right'], found 'middle'"),
        ({"seq": 1.5}, "seq: expected <class 'int'>, found 1.5"),
        ({"seq": True}, "seq: expected <class 'int'>, found True"),
        ({"n_triangles": None}, "n_triangles: expected <class 'int'>, found None"),
        ({"f_z_n": "12"}, "f_z_n: expected float | None, found '12'"),
        ({"f_z_n": False}, "f_z_n: expected float | None, found False"),
        ({"valid_fraction": None}, "valid_fraction: expected <class 'float'>, found None"),
        ({"repeated": 1}, "repeated: expected <class 'bool'>, found 1"),
    ],
)
def test_wrong_values(changes: dict[str, Any], message: str) -> None:
    text = refusal(wrench_with(**changes))
    assert text.startswith(f"insole.wrench/2: {message}")
    assert len(text) < 200


def test_a_whole_number_is_a_number() -> None:
    assert Wrench.decode(wrench_with(f_z_n=700)).f_z_n == 700


@pytest.mark.parametrize("received", ["application/msgpack;insole.wrench/1", "application/msgpack", "zenoh/bytes", ""])
def test_another_version_is_recognised_by_its_encoding(received: str) -> None:
    message = refusal(cycle()[2].encode(), Wrench, received)
    assert message.startswith(f"expected a message 'application/msgpack;insole.wrench/2', found '{received}'")
    assert "install the same insole-daemon on both sides" in message


def test_a_message_class_refuses_the_other_kinds() -> None:
    for message in MESSAGES:
        for cls in BY_KEY.values():
            if cls is not type(message):
                refusal(message.encode(), cls)
                refusal(message.encode(), cls, encoding(message))


def test_arrays_of_no_length_along_an_axis_of_any() -> None:
    """No bytes are right for 0 triangles, but numpy has no array of such a shape."""
    fields = msgpack.unpackb(FOOT.calibration_in_use().encode()) | {
        "n_triangles": 0, "n_coefficients": 2**62, "baseline_count": b"", "coefficients_pa": b"", "usable": b"",
    }  # fmt: skip
    refusal(msgpack.packb(fields), CalibrationInUse)


# ---- fuzz: only WireError, whatever comes

scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary()
values = st.recursive(
    scalars, lambda inner: st.lists(inner) | st.dictionaries(st.text() | st.binary(), inner), max_leaves=8
)
classes = st.sampled_from(sorted(BY_KEY.values(), key=lambda cls: cls.SCHEMA))


def try_to_decode(cls: type[Message], payload: bytes) -> None:
    with contextlib.suppress(WireError):
        assert isinstance(cls.decode(payload, encoding(cls)), cls)


@settings(max_examples=300, deadline=None)
@given(classes, st.binary(max_size=200))
def test_random_bytes(cls: type[Message], payload: bytes) -> None:
    try_to_decode(cls, payload)


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(MESSAGES), st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=5))
def test_spoilt_payloads(message: Message, changes: list[tuple[int, int]]) -> None:
    payload = bytearray(message.encode())
    for at, byte in changes:
        payload[at % min(len(payload), 400)] = byte
    try_to_decode(type(message), bytes(payload))


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(MESSAGES), st.data())
def test_wrong_values_under_the_right_keys(message: Message, data: st.DataObject) -> None:
    fields = msgpack.unpackb(message.encode())
    for name in data.draw(st.lists(st.sampled_from(sorted(fields)), min_size=1, max_size=3)):
        fields[name] = data.draw(values | st.sampled_from([0, 1, 2**62, b""]))
    try_to_decode(type(message), msgpack.packb(fields))


@settings(max_examples=100, deadline=None)
@given(classes, values)
def test_any_msgpack(cls: type[Message], value: Any) -> None:
    try_to_decode(cls, msgpack.packb(value))


def test_meta_and_calibration_are_of_the_same_triangles() -> None:
    meta, calibration = FOOT.meta(), FOOT.calibration_in_use()
    assert isinstance(meta, Meta)
    assert meta.n_triangles == calibration.n_triangles == len(meta.triangles) == N
    assert meta.xy_m.dtype == np.float32
    assert meta.layout_builtin
    assert meta.calibration_builtin
    assert np.isnan(calibration.baseline_count[:, [6, 10]]).all()
