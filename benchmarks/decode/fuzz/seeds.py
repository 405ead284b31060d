"""Good inputs of every target, small: what a fuzzer starts from and what hypothesis damages."""

from __future__ import annotations

import io
import json
import math
import struct
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import msgpack
import numpy as np
import scipy.io
from mcap.writer import Writer

from insole_daemon.config import Config
from insole_daemon.physics import zero as zeros
from insole_daemon.physics.zero import Zero
from insole_daemon.recording.copies import InsoleContents
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.export_mcap import export_mcap
from insole_daemon.recording.loading import load
from insole_daemon.recording.writer import ReferenceContents, write
from insole_daemon.service.foot import Foot, load_feet
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.identifiers import TAG_A, TAG_B, skin_id
from insole_daemon.wire.messages import BY_KEY, Array, Message, wire_fields
from insole_daemon.wire.requests import pack

ROOT = Path(__file__).resolve().parents[3]
_LOG = (
    b"(1741532714.334381) can0 450#40EEEFF1EFF1F1F0\n(1741532714.334581) can0 450#C0EEEFF1EFF10000\n"
    b"(1741532714.334781) can1 00000470#40EE R\n(1741532714.334981) can0 470#R4\n"
    b"(1741532714.335181) can0 20000004#0004000000000000\n(1741532714.335381) can0 470##1AABB\n"
    b"(1741532714.335581) can0 470#40EEEFF1EFF1F1F0_C\n"
)


def frames() -> list[bytes]:
    """struct can_frame, 16 bytes: halves of cycles, answers, commands, an error frame."""
    payloads = [
        (0x450, "40EEEFF1EFF1F1F0"), (0x450, "C0EEEFF1EFF10000"), (0x468, "41EEEFF1EFF1F1F0"),
        (0x250, "1C0B010203020001"), (0x7A0, "FF0B010203"), (0x350, "01FA000000"), (0x205, "0700"), (0x70F, "FF"),
        (0x20000004, "0004000000000000"),
    ]  # fmt: skip
    return [struct.pack("<IB3x8s", i, len(d) // 2, bytes.fromhex(d)) for i, d in payloads]


def cycles() -> list[bytes]:
    """Frames one after another: two cycles of an insole, a half over and over, all kinds."""
    halves = [
        struct.pack("<IB3x8B", skin_id(at.board, at.triangle), 8, tag, *[240] * 7)
        for at in layouts.builtin("left", (5, 6, 7)).triangles
        for tag in (TAG_A, TAG_B)
    ]
    return [b"".join(halves) * 2, halves[0] * 40, b"".join(frames())]


def candump_lines() -> list[bytes]:
    """One line each."""
    return [*_LOG.splitlines(), b"DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)"]


def candump_logs() -> list[bytes]:
    """Plain, with other line ends and times, and compressed."""
    import gzip

    import zstandard

    plain = _LOG * 3
    return [
        plain, plain.replace(b"\n", b"\r\n"), plain.replace(b"1741532714.", b"4."), _LOG[:-20],
        gzip.compress(plain, mtime=0), zstandard.ZstdCompressor().compress(plain),
    ]  # fmt: skip


def reference_messages() -> list[bytes]:
    """What a reference instrument publishes."""
    return [b'{"fz_n": 1.5, "mx_nm": 0, "my_nm": null, "time_s": 3.25}', b'{"fz_n": 1e3, "mx_nm": -1, "my_nm": 2}']


def config() -> list[bytes]:
    """The commented one, and one with every section."""
    whole = (
        "format: insole-config/1\nrig: a\nbuses: ['virtual:b']\ninsoles:\n- foot: right\n  boards:\n"
        "  - {address: 8, interface: b}\n  - {address: 9, interface: b, shift: 4}\n  - {address: 10, interface: b}\n"
        "publish: {rate_hz: 50.0}\nboards: {configure: true}\nzenoh: {mode: client, connect: [tcp/127.0.0.1:7447]}\n"
        "extensions: {mine: [1, 2.5, null]}\n"
    )
    return [(ROOT / "config.yaml").read_bytes(), whole.encode()]


@cache
def _recorded() -> dict[str, bytes]:
    """The files of a recording of counts, and its MCAP."""
    insole = Config().insoles[0]
    foot = _foot()
    calibration, layout = foot.calibration, foot.layout
    usable = calibration.usable
    zero = Zero("left", 7, np.where(usable, 238.5, np.nan), np.where(usable, 0.5, np.nan))
    n = 5
    counts = np.random.default_rng(0).integers(1, 255, (n, len(layout), 12), np.uint8)
    time_s = np.arange(n) * 0.02
    shoe = {"time_s": time_s, "fz_n": time_s, "mx_nm": time_s, "my_nm": time_s}
    with tempfile.TemporaryDirectory() as made:
        folder = write(
            Path(made, "walk"), kind="shoe", can_origin="recorded",
            insoles=[InsoleContents("left", insole.boards, layout, calibration, zero)],
            counts={"left": CountsTable(np.arange(n) * 20_000_000, counts)},
            reference=[ReferenceContents("left", "own", shoe)],
        )  # fmt: skip
        export_mcap(load(folder), Path(made, "x.mcap"))
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
        return files | {"x.mcap": Path(made, "x.mcap").read_bytes()}


@cache
def _foot() -> Foot:
    return load_feet(Config())[0]


def recording() -> list[bytes]:
    """recording.yaml of the kinds there are."""
    chamber = (
        b"format: insole-recording/1\nkind: chamber\ncan: can.log\ncan_origin: reencoded\ninvented: [times]\ninsoles:\n"
        b"- foot: left\n  boards:\n  - {address: 5}\n  - {address: 6, shift: 3}\n  - {address: 7}\n"
        b"reference:\n- {foot: left, file: reference.csv, clock: own}\n"
    )
    return [_recorded()["recording.yaml"], chamber]


def layout() -> list[bytes]:
    """The whole insole, and two triangles."""
    two = (
        b"format: insole-layout/1\nfoot: left\ntaxel_area_mm2: 32.4\ntriangles:\n"
        b"- {board: 5, triangle: 0, patch: front, x_mm: 231.5, y_mm: 12.0, rotation_deg: 0.0}\n"
        b"- {board: 6, triangle: 3, patch: rear, x_mm: 31.5, y_mm: -2, rotation_deg: 90, mirrored: true}\n"
    )
    return [_recorded()["layout.yaml"], two]


def calibration() -> list[bytes]:
    """Of two taxels, with all there may be, and with effects."""
    taxel: dict[str, Any] = {"board": 5, "triangle": 0, "taxel": 0, "baseline_count": 240.0}
    extensions = {
        "coefficients_covariance_pa2": [[1.0, 0.1], [0.1, 2.0]],
        "valid_range": {"activation_count": [0, 100.5]},
    }
    document = {
        "format": "insole-calibration/1", "foot": "left", "effects": [], "provenance": {"by": "test"},
        "taxels": [
            taxel | {"coefficients_pa": [0.0, 7900.0], "extensions": extensions},
            taxel | {"taxel": 1, "coefficients_pa": [0.0, 7900.0, 12.0, 0.11]},
        ],
    }  # fmt: skip
    lag = {
        "effect": "lag", "where": {"scope": "board", "ids": [[6]]}, "valid_range": {"pressure_pa": [0, 340000]},
        "parameters": {"tau_s": {"value": 0.03, "std": 0.002, "unit": "s"}},
    }  # fmt: skip
    hysteresis = {
        "effect": "hysteresis", "where": {"scope": "taxel", "ids": [[5, 0, 0]]},
        "parameters": {
            "r_pa": {"value": [2000, 8000], "std": [300, 900], "unit": "Pa"},
            "w": {"value": [0.05, 0.03], "unit": "1"},
        },
    }  # fmt: skip
    model = document | {"effects": [lag, hysteresis]}
    return [json.dumps(document).encode(), json.dumps(document, indent=1).encode(), json.dumps(model).encode()]


def zero() -> list[bytes]:
    """Of a few taxels."""
    document = json.loads(_recorded()["zero.json"])
    assert document["format"] == zeros.FORMAT
    return [json.dumps(document | {"taxels": document["taxels"][:3]}).encode()]


def reference() -> list[bytes]:
    """Of a force shoe."""
    return [_recorded()["reference.csv"], b"fz_n,mx_nm,my_nm,temperature_c\n1,2,3,\n1e3,,-3,25.5\n"]


def matlab() -> list[bytes]:
    """The published form, plain and compressed."""
    made = []
    table = np.column_stack([np.arange(3), 1000 + np.arange(3) * 0.02, np.full((3, 280), 240)]).astype(float)
    for compressed in (False, True):
        file = io.BytesIO()
        scipy.io.savemat(file, {"experiment": {"C": table, "P": np.ones((2, 1))}}, do_compression=compressed)
        made.append(file.getvalue())
    return made


def mcap() -> list[bytes]:
    """What `insole export` writes, and a small one."""
    small = io.BytesIO()
    writer = Writer(small, use_chunking=False)
    writer.start()
    writer.add_attachment(0, 0, "recording.yaml", "application/yaml", b"format: insole-recording/1")
    writer.finish()
    return [_recorded()["x.mcap"], small.getvalue()]


def yarp() -> list[bytes]:
    """One foot, with one stamp and with two."""
    row = " ".join(["240"] * 280)
    return [f"0 1.0 {row}\n1 1.02 {row}\n".encode(), f"0 1e9 1e9 ({row})\n1 1e9 1e9 ({row})\n".encode()]


def bench() -> list[bytes]:
    """A table of two taxels."""
    return [b"time_s,reference,count_5_3_0,count_5_3_1\n0.00,12.5,238,240\n0.02,13,237,\n"]


def asc() -> list[bytes]:
    """What Vector's tools write, which python-can reads."""
    moment = b"Sun Mar 9 15:05:14.334 2025\n"
    return [
        b"date "
        + moment
        + b"base hex timestamps absolute\nBegin Triggerblock "
        + moment
        + b"   0.000000 Start of measurement\n   0.000200 1  450             Rx   d 8 40 EE EF F1 EF F1 F1 F0\n"
        b"   0.000400 1  450             Rx   d 8 C0 EE EF F1 EF F1 00 00\nEnd TriggerBlock\n"
    ]


def counts() -> list[bytes]:
    """counts.npz, and one that is not compressed."""
    stored = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(_recorded()["counts.npz"])) as packed, zipfile.ZipFile(stored, "w") as plain:
        for name in packed.namelist():
            plain.writestr(name, packed.read(name))
    return [_recorded()["counts.npz"], stored.getvalue()]


def _made(cls: type[Message]) -> Message:
    """One of its kind that its schema allows."""
    sizes: dict[str | int, int] = {"n_triangles": 2, "n_coefficients": 3}
    said: dict[str, Any] = {}
    for name, hint in wire_fields(cls).items():
        arrays = [extra for extra in getattr(hint, "__metadata__", ()) if isinstance(extra, Array)]
        if arrays:
            shape = [sizes.get(axis, axis) for axis in arrays[0].shape]
            said[name] = bytes(np.dtype(arrays[0].dtype).itemsize * math.prod(map(int, shape)))
        elif get_origin(hint) is Literal:
            said[name] = get_args(hint)[0]
        else:
            plain = next(
                (kind for kind in (bool, int, float, str, dict, list) if kind in (hint, get_origin(hint))), None
            )
            said[name] = {bool: False, int: 7, float: 0.5, str: "words", dict: {}, list: []}[plain] if plain else None
    return cls.decode(msgpack.packb(said | {name: n for name, n in sizes.items() if name in said}))


@cache
def _messages() -> dict[str, Message]:
    """One of every kind."""
    return {kind: _made(cls) for kind, cls in BY_KEY.items()}


def messages() -> list[bytes]:
    """A byte for the kind, then the payload."""
    return [bytes([kind]) + message.encode() for kind, message in enumerate(_messages().values())]


def requests() -> list[bytes]:
    """Of every verb."""
    asked = ({"do": "list"}, {"do": "configure", "force": True}, {"seconds": 2.0, "force": False}, {"do": "stop"})
    return [pack(each) for each in asked]


def websocket() -> list[bytes]:
    """What the page asks for."""
    asked: tuple[dict[str, Any], ...] = (
        {"do": "zero", "foot": "left"}, {"do": "temperature", "foot": "right"}, {"do": "mark", "text": "he stumbles"},
        {"do": "record"}, {"do": "stop"},
    )  # fmt: skip
    return [json.dumps(each | {"number": number}).encode() for number, each in enumerate(asked)]


def page() -> list[bytes]:
    """A cycle after its description."""
    said, kinds = _messages(), list(BY_KEY)
    cycle = ("meta", "raw", "pressure", "wrench", "health", "event")
    return [joined([(kinds.index(kind), said[kind].encode()) for kind in cycle])]


def joined(parts: Sequence[tuple[int, bytes]]) -> bytes:
    """Messages in a row: kind, length in two bytes, payload."""
    return b"".join(struct.pack("<BH", kind, len(payload)) + payload for kind, payload in parts)


def parts(data: bytes) -> Iterator[tuple[int, bytes]]:
    """The same apart again, whatever `data` is."""
    while len(data) > 3:
        kind, size = struct.unpack_from("<BH", data)
        yield kind, data[3 : 3 + size]
        data = data[3 + size :]
