"""Every parser that takes bytes from outside, each as a function of those bytes, with a few good inputs to start from.

A target may return or raise an InsoleError that says what and where. Whatever else comes out of it is a finding.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from insole_daemon import config as configs
from insole_daemon.bus.batched_socket import parts_of
from insole_daemon.bus.candump import CandumpReader
from insole_daemon.bus.candump_fast import PAD, TimeForm, decode
from insole_daemon.bus.candump_line import BadLine, interface_name, parse_line
from insole_daemon.bus.error_frames import count_kinds
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.documents import read
from insole_daemon.physics import calibration, zero
from insole_daemon.recording import document, reference
from insole_daemon.recording.importing import import_recording
from insole_daemon.recording.instrument import Instrument
from insole_daemon.skin import commands
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.reader import SkinReader
from insole_daemon.skin.streams import Streams
from insole_daemon.view.actions import Actions
from insole_daemon.view.hub import Hub
from insole_daemon.view.other_sources import OtherSources, parse_reference
from insole_daemon.view.viewer import Viewer
from insole_daemon.wire.client import Client
from insole_daemon.wire.messages import BY_KEY
from insole_daemon.wire.requests import REQUEST_SCHEMA, unpack

from . import seeds

LAYOUT = layouts.builtin("left", (5, 6, 7))
KINDS = tuple(BY_KEY)


class Units(NamedTuple):
    """What many of are handed over together, each an input of its own: how to take them apart, and join them again."""

    apart: Callable[[bytes], list[bytes]]
    together: Callable[[list[bytes]], bytes]
    n: int  # handed over together
    most_bytes: int  # of one


FRAMES = Units(
    lambda data: [data[at : at + 16] for at in range(0, len(data), 16)],
    lambda units: b"".join(unit.ljust(16, b"\0") for unit in units),
    n=64, most_bytes=16,
)  # fmt: skip
LINES = Units(lambda data: data.split(b"\n"), b"\n".join, n=16, most_bytes=200)


@dataclass(frozen=True, slots=True)
class Target:
    """`seeds` are good inputs; `byte_parser`: reads bytes one by one, so that it is given millions of inputs."""

    name: str
    take: Callable[[bytes], object]
    seeds: Callable[[], Sequence[bytes]]
    byte_parser: bool = False
    units: Units | None = None


@cache
def _folder() -> Path:
    """Where inputs that are files are put: in memory, gone with the process."""
    folder = Path(tempfile.mkdtemp(prefix="insole-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    import atexit

    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _as_file(name: str, take: Callable[[Path], object]) -> Callable[[bytes], object]:
    def taken(data: bytes) -> object:
        path = _folder() / name
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.write(file, data)
        os.close(file)
        return take(path)

    return taken


def _imported(name: str) -> Callable[[bytes], object]:
    def take(path: Path) -> None:
        out = path.with_suffix(".imported")
        try:
            import_recording(path, out, "left", None, None)
        finally:
            shutil.rmtree(out, ignore_errors=True)

    return _as_file(name, take)


def _batch(data: bytes) -> FrameBatch:
    """Frames as the kernel hands them over, 16 bytes each, 1 ms apart."""
    raw = np.frombuffer(data[: len(data) // 16 * 16], np.uint8).reshape(-1, 16).copy()
    t_ns = np.arange(len(raw), dtype=np.int64) * 1_000_000
    return FrameBatch(t_ns, t_ns, np.zeros(len(raw), np.uint8), *parts_of(raw))


@cache
def _streams() -> Streams:
    return Streams([LAYOUT])


def _frames(data: bytes) -> None:
    """Whose each frame is, what it counts as, and what it says if a board answers."""
    batch = _batch(data)
    slots = _streams().slots(batch)
    assert ((slots >= -4) & (slots < 2 * len(LAYOUT))).all()
    count_kinds(batch, {})
    for can_id, dlc, payload in zip(batch.can_id.tolist(), batch.dlc.tolist(), batch.data, strict=True):
        for answer in (commands.read_discovery, commands.read_version, commands.read_temperature):
            answer(can_id, payload[:dlc].tobytes())


def _cycles(data: bytes) -> None:
    """Frames into cycles, until nothing is expected any more."""
    batch = _batch(data)
    skin = SkinReader([LAYOUT], 20_000_000, 5_000_000)
    for cycles in skin.feed(batch)[0] + skin.advance(len(batch) * 1_000_000 + 200_000_000)[0]:
        assert cycles.counts.shape[1:] == (len(LAYOUT), 12)


def _candump_lines(data: bytes) -> None:
    """Each line many at once and one with care, which say the same."""
    text = data + b"\n"
    form = TimeForm.of(text) or TimeForm(10, 6)
    columns = decode(np.frombuffer(bytes(PAD) + text + bytes(PAD), np.uint8), PAD, PAD + len(text), form)
    for row, line in enumerate(text.split(b"\n")[:-1]):
        try:
            parsed = parse_line(line)
        except BadLine:
            name = columns.key[:, row].tobytes().rstrip(b"\0")  # as PieceDecoder judges it
            assert not (columns.ok[row] and name.startswith(b" ") and interface_name(name.strip(b" ")))
            continue
        if columns.ok[row]:
            columns_say = columns.t_ns, columns.can_id, columns.dlc, columns.flags
            assert [column[row] for column in columns_say] == [parsed.t_ns, parsed.can_id, parsed.dlc, parsed.flags]
            assert columns.data[row].tobytes() == parsed.data


def _candump(path: Path) -> None:
    with CandumpReader(path) as reader:
        for batch in reader.pieces():
            assert (np.diff(batch.t_mono_ns) >= 0).all()


def _message(data: bytes) -> None:
    """The first byte says which message the rest is sent as."""
    BY_KEY[KINDS[data[0] % len(KINDS)]].decode(data[1:])


def _reference_message(data: bytes) -> None:
    parse_reference(data)
    Instrument("left", "shoe").take_json(data, 1.0)


class _NoDaemon(Client):
    """Nothing is asked of anybody."""

    def meta(self, foot: str, rig: str | None = None) -> Any:
        raise AssertionError("nobody asks")

    def request(self, foot: str, verb: str, **arguments: Any) -> dict[str, Any]:
        return {"ok": True, "asked": [foot, verb, sorted(arguments)]}


class _NoRecording:
    running = False

    def mark(self, text: str) -> bool:
        text.encode()  # as it is written into a file
        return True

    def start(self, feet: list[str]) -> str:
        return "walk-1"

    def stop(self) -> str:
        return ""


def _websocket(data: bytes) -> None:
    """What the page sends, after aiohttp has made text of it; what it is told then can be sent to every viewer."""
    text = data.decode("utf-8", "ignore")

    async def reply() -> None:
        hub, viewer = Hub(_NoDaemon(), "test", OtherSources("simulation", {})), Viewer()
        hub.join(viewer)
        actions = Actions(_NoDaemon(), hub, _NoRecording())  # type: ignore[arg-type]
        with contextlib.suppress(ValueError):  # the socket is closed
            viewer.queue_text(str(await actions.reply(text)))
        _drain(viewer)

    _loop().run_until_complete(reply())


def _page(data: bytes) -> None:
    """Messages of anybody who can publish, on their way to the page; each begins with its kind and its length."""

    async def show() -> None:
        hub, viewer = Hub(_NoDaemon(), "test", OtherSources("simulation", {})), Viewer()
        hub._ask = lambda name: None  # type: ignore[method-assign]
        hub.join(viewer)
        for kind, payload in seeds.parts(data):
            hub._take(BY_KEY[KINDS[kind % len(KINDS)]].decode(payload))
            _drain(viewer)

    _loop().run_until_complete(show())


def _drain(viewer: Viewer) -> None:
    while (message := viewer.take()) is not None:
        if isinstance(message, str):
            message.encode()
        viewer.answered()


@cache
def _loop() -> asyncio.AbstractEventLoop:
    return asyncio.new_event_loop()


def _all() -> Iterator[Target]:
    yield Target("frames", _frames, seeds.frames, byte_parser=True, units=FRAMES)
    yield Target("cycles", _cycles, seeds.cycles)
    yield Target("candump-lines", _candump_lines, seeds.candump_lines, byte_parser=True, units=LINES)
    yield Target("candump", _as_file("can.log", _candump), seeds.candump_logs)
    yield Target("message", _message, seeds.messages, byte_parser=True)
    yield Target("request", lambda data: unpack(data, REQUEST_SCHEMA), seeds.requests, byte_parser=True)
    yield Target("reference-message", _reference_message, seeds.reference_messages, byte_parser=True)
    yield Target("config-yaml", _as_file("config.yaml", configs.load), seeds.config)
    yield Target(
        "recording-yaml",
        _as_file("recording.yaml", lambda p: read(p, document.Document, document.FORMAT, document.check)),
        seeds.recording,
    )
    yield Target("layout-yaml", _as_file("layout.yaml", layouts.load), seeds.layout)
    yield Target("calibration-json", _as_file("c.json", lambda p: calibration.load(p, LAYOUT)), seeds.calibration)
    yield Target("zero-json", _as_file("zero.json", lambda p: zero.load(p, LAYOUT)), seeds.zero)
    yield Target(
        "reference-csv", _as_file("r.csv", lambda p: reference.read(p, "shoe", "left", "own")), seeds.reference
    )
    yield Target("matlab", _imported("x.mat"), seeds.matlab)
    yield Target("mcap", _imported("x.mcap"), seeds.mcap)
    yield Target("yarp", _imported("data.log"), seeds.yarp)
    yield Target("bench-csv", _imported("bench.csv"), seeds.bench)
    yield Target("can-log", _imported("x.asc"), seeds.asc)
    yield Target("counts", _as_file("counts.npz", _counts), seeds.counts)
    yield Target("websocket", _websocket, seeds.websocket)
    yield Target("page", _page, seeds.page)


def _counts(path: Path) -> None:
    from insole_daemon.recording import counts

    counts.read(path, {"left": len(LAYOUT)})


TARGETS = {target.name: target for target in _all()}
