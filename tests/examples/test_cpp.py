"""The C++ subscriber: its decoder on payloads of a real daemon, and all of it behind a stand-in for zenoh-c."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import shutil
import struct
import subprocess

import msgpack
import numpy as np
import pytest
from processes import EXAMPLES, STAND_IN, lacking

from insole_daemon.wire.messages import Wrench, wire_fields
from insole_daemon.wire.session import open_session

if shutil.which("g++") is None:
    lacking("there is no g++")
if subprocess.run(["g++", "-E", "-x", "c++", "-"], input=b"#include <msgpack.hpp>", capture_output=True).returncode:
    lacking("there is no msgpack.hpp: libmsgpack-cxx-dev")

ENCODING = "application/msgpack;insole.wrench/2"


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cpp")

    def build(source):
        program = folder / source.stem
        includes = [f"-I{EXAMPLES}", f"-I{STAND_IN / 'zenoh_c'}"]
        subprocess.run(
            ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", *includes, source, "-o", program], check=True
        )
        return program

    return build


@pytest.fixture(scope="module")
def decode(build):
    """What the C++ decoder makes of samples, a dict each."""
    program = build(STAND_IN.parent / "decode.cpp")

    def decode(*samples):
        result = subprocess.run([program], input=stream(samples), capture_output=True, check=True)
        return [json.loads(line) for line in result.stdout.splitlines()]

    return decode


def stream(samples):
    """Encodings and payloads as both C++ programs read them."""
    parts = ((encoding.encode(), payload) for encoding, payload in samples)
    return b"".join(struct.pack("II", len(encoding), len(payload)) + encoding + payload for encoding, payload in parts)


@pytest.fixture
def samples(daemon):
    """(encoding, payload) of 200 cycles of a walk, as they come over Zenoh."""
    with daemon.boards(), open_session("client", connect=[daemon.endpoint]) as session:
        arriving = session.declare_subscriber("insole/*/*/wrench")
        return [(str(sample.encoding), sample.payload.to_bytes()) for sample in itertools.islice(arriving, 200)]


def assert_same(decoded, wrench):
    assert decoded.keys() == wire_fields(Wrench).keys()
    for name, value in decoded.items():
        expected = getattr(wrench, name)
        if isinstance(expected, np.ndarray):
            value = np.array(value, expected.dtype).reshape(expected.shape)
        np.testing.assert_array_equal(value, expected, err_msg=name)
        assert (value is None) == (expected is None)


def test_every_field_of_every_cycle_of_a_daemon(samples, decode):
    decoded = decode(*samples)
    assert len(decoded) == 200
    for (encoding, payload), fields in zip(samples, decoded, strict=True):
        assert_same(fields, Wrench.decode(payload, encoding))
    assert {fields["foot"] for fields in decoded} == {"left", "right"}
    assert max(fields["f_z_n"] for fields in decoded) > 300
    assert any(fields["cop_x_m"] is None for fields in decoded), "a foot in the air"


def test_unknown_values_are_not_0(decode):
    one = np.zeros(1, np.float32)
    unknown = Wrench(
        "right",
        7,
        2**63,
        2,
        3,
        1,
        *[None] * 8,
        0.0,
        0.0,
        np.zeros((1, 12), np.uint8),
        one * np.nan,
        one.astype("u1"),
        True,
        "static",
        0.0,
    )
    whole = dataclasses.replace(
        unknown, f_z_n=-12, m_x_nm=0, cop_x_m=0.25, f_z_std_n=1.5, age_ms=one + 3, repeated=False
    )
    for wrench, decoded in zip(
        (unknown, whole), decode((ENCODING, unknown.encode()), (ENCODING, whole.encode())), strict=True
    ):
        assert_same(decoded, wrench)


def test_payloads_that_are_no_message_are_refused(samples, decode):
    encoding, payload = samples[0]
    fields = msgpack.unpackb(payload)
    spoilt = [
        ("application/msgpack;insole.wrench/1", payload),
        ("application/msgpack;insole.raw/1", payload),
        (encoding, b""),
        (encoding, payload[:-1]),
        (encoding, payload[: len(payload) // 2]),
        (encoding, msgpack.packb([1, 2])),
        (encoding, b"\xdf\xff\xff\xff\xff" + payload[3:]),  # a map of four milliards
        (encoding, b"\x91" * 100_000 + payload),
        (encoding, msgpack.packb(fields | {"valid": fields["valid"][1:]})),
        (encoding, msgpack.packb(fields | {"age_ms": fields["age_ms"] + b"1"})),
        (encoding, msgpack.packb(fields | {"n_triangles": 2**62})),
        (encoding, msgpack.packb(fields | {"n_triangles": 0, "valid": b"", "age_ms": b"", "missing": b""})),
        (encoding, msgpack.packb(fields | {"f_z_n": "1"})),
        (encoding, msgpack.packb(fields | {"seq": -1})),
        (encoding, msgpack.packb({name: value for name, value in fields.items() if name != "valid"})),
    ]
    decoded = decode(*spoilt, samples[1])
    assert [set(one) for one in decoded[:-1]] == [{"error"}] * len(spoilt)
    assert decoded[-1]["seq"] == Wrench.decode(samples[1][1]).seq, "the next one is read again"


def test_the_whole_subscriber_behind_a_stand_in_for_zenoh(samples, build, tmp_path):
    """Compiled against declarations written after zenoh-c's headers; zenoh-c itself comes from no package index."""
    left = [sample for sample in samples if Wrench.decode(sample[1]).foot == "left"]
    unknown = dataclasses.replace(Wrench.decode(left[1][1]), f_z_n=None).encode()
    sent = [left[0], (ENCODING, unknown), left[4], ("application/msgpack;insole.wrench/1", b""), left[5]]
    file = tmp_path / "samples"
    file.write_bytes(stream(sent))
    result = subprocess.run(
        [build(EXAMPLES / "subscriber.cpp"), "tcp/127.0.0.1:1"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "STAND_IN_SAMPLES": str(file)},
    )
    first, second, gap, third, fourth = result.stdout.splitlines()
    seq = Wrench.decode(left[0][1]).seq
    assert first.startswith(f"left {seq} ")
    assert second == f"left {seq + 1} no valid taxel"
    assert gap == "2 cycles did not reach me"
    assert third.startswith(f"left {seq + 4} ")
    assert fourth.startswith(f"left {seq + 5} ")
    assert result.stderr.splitlines() == [
        'a stand-in for Zenoh: mode = "client"',
        'a stand-in for Zenoh: connect/endpoints = ["tcp/127.0.0.1:1"]',
        "a stand-in for Zenoh: subscribed to insole/*/*/wrench",
        "another message: application/msgpack;insole.wrench/1",
    ]


def test_the_decoder_knows_every_field_of_the_schema():
    schema = json.loads((EXAMPLES.parents[1] / "protocol" / "wrench.schema.json").read_text())
    (listed,) = (EXAMPLES / "wrench.hpp").read_text().split("MSGPACK_DEFINE_MAP(")[1:]
    assert {name.strip() for name in listed.split(")")[0].split(",")} == set(schema["required"])
