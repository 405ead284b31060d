"""Inputs found by fuzzing that once ended a process, or raised an error without a message, are refused or ignored."""

from __future__ import annotations

import asyncio
import base64
import io
import itertools
import json
import struct
import warnings

import msgpack
import numpy as np
import pytest
import scipy.io
import zstandard

from benchmarks.decode.fuzz import seeds
from benchmarks.decode.fuzz.targets import TARGETS
from insole_daemon.bus.candump_file import LogFile
from insole_daemon.errors import InsoleError, WireError
from insole_daemon.recording.import_mcap import import_mcap
from insole_daemon.recording.mat5 import read_struct
from insole_daemon.service.boards import BoardOperations
from insole_daemon.service.zeroing import zero_handler
from insole_daemon.untrusted import MAX_DEPTH, is_plain
from insole_daemon.view.hub import Hub
from insole_daemon.view.other_sources import OtherSources
from insole_daemon.wire.client import Client
from insole_daemon.wire.messages import Health, Meta, Raw, Wrench
from insole_daemon.wire.requests import REQUEST_SCHEMA, unpack

# A compressed variable with one byte changed: scipy 1.17 reads it into a segmentation fault.
ENDED_SCIPY = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + base64.b64decode(
    "DwAAAKkAAAB4nO3ZPQ6CQBCG4Vl/CFoQ6zWx9gh0kHgB7W23sJAQY+EFrLmCx7D2OjY09s6ybFQSb/BO8vHsBpgLfJmI5EuRRE01"
    "Iwkz7e/mK3ONu9TudDi66hy/m3T/GHUjW8n0fLOffclg31hjTdjnZ/////+mqa0Mpi36QxmeTblvHq+1el9dnzs1vK4QERERERER"
    "ERERERERO31P5S//eqrQaf32VAuJE/uptngDlFFPAA=="
)  # fmt: skip
DEEP = b"\x91" * 1000 + b"\x01"  # lists within lists: msgpack reads them, repr() does not


def field(kind, name, value):
    """A good message of a kind, with one field replaced."""
    fields = msgpack.unpackb(seeds.messages()[list(seeds.BY_KEY).index(kind)][1:])
    assert name in fields
    return msgpack.packb(fields | {name: value})


@pytest.mark.parametrize(
    ("target", "data", "words"),
    [
        ("matlab", ENDED_SCIPY, "expected a MATLAB file of version 5 to 7, found another"),
        ("request", b"\x81\xa2do" + DEEP, "expected a msgpack map of plain values"),
        ("request", msgpack.packb({"do": b"list"}), "expected a msgpack map of plain values"),
        ("bench-csv", b"time_s,reference,count_5_3_0\n", "and rows of them, found .* 0 rows"),
        ("bench-csv", b"time_s,count_5_" + b"9" * 5000 + b"_0\n0,1\n", "expected the columns"),
        ("bench-csv", b"time_s,count_5_3_0\n1e300,240\n", "expected times in seconds"),
        ("yarp", b"0 nan " + b"240 " * 280, "expected times in seconds"),
        (
            "can-log",
            seeds.asc()[0].replace(b"1  450", b"1  " + b"9" * 32 + b"x"),
            "expected frames of the boards 5 to 10",
        ),
        ("mcap", seeds.mcap()[0][:60], "expected an MCAP file, found one that cannot be read"),
        ("zero-json", b"[" * 100_000, "not JSON that can be read"),
    ],
)
def test_input_of_earlier_findings_is_refused_with_a_message(target, data, words):
    with pytest.raises(InsoleError, match=words):
        TARGETS[target].take(data)


@pytest.mark.parametrize(
    ("target", "data"),
    [
        (
            "frames",
            struct.pack("<IB3x8s", 0x6750, 8, b"\x1c"),
        ),  # an identifier of more than 11 bits that says it has 11
        ("reference-message", b"[" * 100_000),
        ("reference-message", b'{"fz_n": 1' + b"0" * 400 + b', "mx_nm": 0, "my_nm": 0}'),
        ("websocket", b"[" * 4000),
        ("websocket", b'{"number": 1, "do": "mark", "text": "\\ud800"}'),  # text that cannot be sent
        ("websocket", b'{"number": 1, "do": "zero", "foot": ' + b"[" * 3000 + b"]" * 3000 + b"}"),
    ],
)
def test_input_of_earlier_findings_is_ignored(target, data):
    TARGETS[target].take(data)


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        ("wrench", "f_z_n", [[[[0]]]]),
        ("wrench", "f_z_n", float("nan")),
        ("wrench", "f_z_n", float("inf")),
        ("raw", "seq", 1 << 63),
        ("health", "boards", [{"a": b"bytes"}]),
        ("health", "boards", [{b"a": 2}]),
        ("health", "bus", {"frames": float("nan")}),
        ("event", "figures", {"stance_s": [float("inf")]}),
        ("meta", "zero", {"a": {"b": b""}}),
    ],
)
def test_a_payload_outside_every_schema_is_no_message(kind, name, value):
    with pytest.raises(WireError, match=rf"insole\.{kind}/\d: {name}: expected"):
        seeds.BY_KEY[kind].decode(field(kind, name, value))


def test_there_are_not_more_triangles_than_boards_have():
    with pytest.raises(WireError, match=r"counts: expected bytes of .u1 .*65536"):
        Raw.decode(field("raw", "n_triangles", 65_536))


def test_a_message_has_a_maximum_size():
    payload = field("health", "boards", [{}] * (1 << 20))
    with pytest.raises(WireError, match=r"insole\.health/\d: expected at most 1048576 bytes, found 10"):
        Health.decode(payload)


def test_a_value_that_is_too_deep_to_be_shown_is_refused():
    payload = field("wrench", "f_z_n", 0).replace(b"\xa5f_z_n\x00", b"\xa5f_z_n" + DEEP)
    with pytest.raises(WireError, match="f_z_n: expected"):
        Wrench.decode(payload)


def test_how_deep_plain_values_go():
    def nested(n):
        return [nested(n - 1)] if n else 1

    assert is_plain(nested(MAX_DEPTH))
    assert not is_plain(nested(MAX_DEPTH + 1))


@pytest.mark.parametrize(
    ("of_effect", "words"),
    [
        ({"parameters": {"tau_s": {"value": [[1], [2, 3]], "std": 1, "unit": "s"}}}, "tau_s.value: expected a number"),
        ({"parameters": {"tau_s": {"value": 0.03, "std": [[1], [2, 3]], "unit": "s"}}}, "tau_s.std: expected a number"),
        ({"parameters": {"tau_s": {"value": 0.03, "std": 10**400, "unit": "s"}}}, "tau_s.std: expected a number"),
        ({"parameters": {"tau_s": {"unit": "s"}}}, "tau_s.value: missing key: expected a value"),
        ({"valid_range": {"pressure_pa": [0, 10**400]}}, "valid_range.pressure_pa: expected two numbers"),
    ],
)
def test_an_effect_of_other_shapes_is_refused(of_effect, words):
    model = json.loads(seeds.calibration()[-1])
    model["effects"][0] |= of_effect
    with pytest.raises(InsoleError, match=words):
        TARGETS["calibration-json"].take(json.dumps(model).encode())


@pytest.mark.parametrize("limits", [["a", 1], [0, 10**400], [0, None]])
def test_a_valid_range_of_no_numbers_is_refused(limits):
    calibration = json.loads(seeds.calibration()[0])
    calibration["taxels"][0]["extensions"]["valid_range"]["activation_count"] = limits
    with pytest.raises(InsoleError, match="two numbers that ascend"):
        TARGETS["calibration-json"].take(json.dumps(calibration).encode())


def test_a_taxel_of_many_coefficients_does_not_flood_the_memory():
    calibration = json.loads(seeds.calibration()[0])
    calibration["taxels"][1]["coefficients_pa"] = [1] * 400_000  # 1 GB for all taxels
    with pytest.raises(InsoleError, match=r"expected a list of 1 to 32, found a list of 400000"):
        TARGETS["calibration-json"].take(json.dumps(calibration, separators=(",", ":")).encode())


def test_a_verb_that_is_no_text_is_no_mistake_of_ours():
    operations = BoardOperations(None, lambda *_: None)
    for verb in (["list"], {"list": 1}, None, 3):
        with pytest.raises(WireError, match="expected do: one of list, configure"):
            operations.handle({"do": verb})
    with pytest.raises(WireError, match="force is true or false"):
        operations.handle({"do": "start", "force": [[[[[1]]]]]})
    zero = zero_handler(None, None)
    for request in ({"seconds": [[1]]}, {"seconds": float("nan")}, {"force": 1}, {"second": 1}):
        with pytest.raises(InsoleError, match="^zero: .*expected"):
            zero(request)
    with pytest.raises(WireError, match="expected a msgpack map"):
        unpack(b"\x80" * (1 << 21), REQUEST_SCHEMA)


def test_a_cycle_with_inconsistent_messages_is_not_shown():
    from insole_daemon.view.viewer import Viewer

    meta, raw, pressure, wrench = (
        seeds.BY_KEY[kind].decode(field(kind, "foot", "left")) for kind in ("meta", "raw", "pressure", "wrench")
    )
    assert isinstance(meta, Meta)
    assert isinstance(raw, Raw)
    n = meta.n_triangles
    other = Raw.decode(
        msgpack.packb(
            msgpack.unpackb(raw.encode())
            | {"n_triangles": 1, "counts": bytes(12), "status": bytes(2), "triangle_t_ns": bytes(8)}
            | {"age_ms": bytes(4), "missing": bytes(1), "valid": bytes(12)}
        )
    )

    async def shown(messages):
        hub, viewer = Hub(Client(), "test", OtherSources("simulation", {})), Viewer()
        hub._ask = lambda name: None
        hub.join(viewer)
        for message in messages:
            hub._take(message)
        viewer.answered()
        return [payload for payload in (viewer.take() for _ in range(3)) if isinstance(payload, bytes)]

    assert len(asyncio.run(shown([meta, raw, pressure, wrench]))) == 1, f"{n} triangles"
    assert asyncio.run(shown([meta, other, pressure, wrench])) == []
    huge = Wrench.decode(field("wrench", "f_z_n", 1e300))
    assert len(asyncio.run(shown([meta, raw, pressure, huge]))) == 1


def test_a_small_zstd_file_does_not_flood_the_memory(tmp_path):
    plain = 1 << 30  # in 32 kB
    packed = zstandard.ZstdCompressor(level=19).compress(bytes(plain))
    assert len(packed) < 1 << 17
    (tmp_path / "can.log").write_bytes(packed)
    file = LogFile(tmp_path / "can.log")
    file.readinto(memoryview(bytearray(10)))
    assert len(file._text) < 200 << 20
    file.close()


def test_a_json_file_of_many_keys_is_refused_at_once(tmp_path):
    keys = ",".join(f'"k{number}": 1' for number in range(20_000))
    head = b'{"format": "insole-zero/1", "foot": "left", "t_ns": 1, "taxels": [], "extensions": {'
    with pytest.raises(InsoleError, match="unknown key"):
        TARGETS["zero-json"].take(head + keys.encode() + b'}, "x": 1}')


@pytest.mark.parametrize("name", ["../out.txt", ".hidden", "a/b", "a\0b", ""])
def test_no_file_of_an_mcap_is_written_outside_its_folder(tmp_path, name):
    from mcap.writer import Writer

    with open(tmp_path / "x.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        for attachment in ("recording.yaml", name):
            writer.add_attachment(0, 0, attachment, "text/plain", b"format: insole-recording/1\n")
        writer.finish()
    with pytest.raises(InsoleError, match="expected an MCAP file with a recording in its attachments"):
        import_mcap(tmp_path / "x.mcap", tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.mcap"]


@pytest.mark.parametrize("compressed", [False, True])
def test_matrices_are_those_that_scipy_reads(tmp_path, compressed):
    random = np.random.default_rng(3)
    matrices = [random.normal(size=shape) for shape in ((1, 1), (3, 5), (4, 1), (2, 3, 4), (0, 3))]
    matrices += [random.integers(0, 100, (3, 4)).astype(kind) for kind in "bBhHiIqQfd"]
    matrices += [np.arange(6.0).reshape(2, 3) * (1 + 2j), np.ones((70, 60))]
    struct_of = {f"m{number}": matrix for number, matrix in enumerate(matrices)}
    path = tmp_path / "x.mat"
    scipy.io.savemat(
        path, {"other": np.eye(3), "experiment": struct_of | {"text": "words", "cell": np.array([1, "a"], object)}},
        do_compression=compressed,
    )  # fmt: skip
    read_back = read_struct(path, "experiment")
    assert (read_back.pop("text"), read_back.pop("cell")) == (None, None)
    assert read_back.keys() == struct_of.keys()
    for name, matrix in struct_of.items():
        np.testing.assert_array_equal(read_back[name], np.real(matrix))
    assert read_struct(path, "nothing") == {}


def test_every_cut_of_a_matlab_file_is_refused_or_read(tmp_path):
    for content, size in itertools.product(seeds.matlab(), (0, 5, 127, 128, 131, 135, 140, 160, 200, 260)):
        (tmp_path / "x.mat").write_bytes(content[:size])
        if size == 128:
            assert read_struct(tmp_path / "x.mat", "experiment") == {}
            continue
        with pytest.raises(ValueError, match=r"begins with|cut off|are left|damaged"):
            read_struct(tmp_path / "x.mat", "experiment")


def test_a_matlab_file_of_another_version_is_named(tmp_path):
    (tmp_path / "x.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512))
    with pytest.raises(ValueError, match="save it with -v7"):
        read_struct(tmp_path / "x.mat", "experiment")


def test_counts_that_are_no_archive_leave_no_file_open(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for content in (b"PK\3\4", seeds.counts()[0][:100], io.BytesIO().getvalue(), json.dumps({}).encode()):
            with pytest.raises(InsoleError, match="expected arrays that numpy wrote"):
                TARGETS["counts"].take(content)


def test_health_of_a_foot_is_json():
    good = Health.decode(field("health", "state", "ok"))
    json.dumps({"boards": good.boards, "bus": good.bus}, allow_nan=False)
