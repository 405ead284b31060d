"""The boards: when a triangle is converted and when it is sent, and the frames on the bus as a candump file."""

import gzip
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .geometry import Geometry
from .ranges import draw, entry

FRAME_S = 0.00013  # on a bus of 1 Mbit/s
_A, _B = (0, 1, 2, 3, 4, 5, 6), (7, 8, 9, 10, 11)
# An open line reads 0xFFFF; the temperature compensation of type 0 then turns taxel 9 over.
OPEN_BYTES = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 0, 0], np.uint8)
OPEN_STATUS = 2
_HEX = np.array([f"{k:02X}".encode() for k in range(256)], "S2").view("S1").reshape(256, 2)


@dataclass(frozen=True)
class Timing:
    """Of the three boards: front, middle, rear."""

    period_ms: tuple[int, int, int]  # as configured
    conversion_s: float  # between new values of a converter; 0: converted when it is read
    b_first: bool  # the second half of a triangle is sent before the first


@dataclass(frozen=True)
class Readings:
    """What one board sends: n ticks of m triangles."""

    triangles: np.ndarray  # (m,) of the layout
    converted_s: np.ndarray  # (n, m) when the value sent was converted, s since the first tick
    conversion: np.ndarray  # (n, m) number of that conversion; the same number is the same value
    sent_s: np.ndarray  # (n, m)


def timing(rng: np.random.Generator, steady: bool) -> Timing:
    """Draw board periods and converters. steady: converters have a new value whenever they are read."""
    found = entry("boards")
    kind = found["kinds"][int(rng.choice(len(found["kinds"]), p=np.array(found["share"]) / sum(found["share"])))]
    b_first = bool(rng.random() < 0.2)
    if kind == "slow_converter" and steady:
        kind = "equal"
    if kind == "mixed":
        periods = [int(p) for p in rng.choice(found["period_ms"], 3)]
        if len(set(periods)) == 1:
            periods[int(rng.integers(3))] = 50 if periods[0] != 50 else 20
        return Timing((periods[0], periods[1], periods[2]), 0.0, b_first)
    if kind == "slow_converter":
        period = int(rng.choice([10, 20]))
        return Timing((period, period, period), draw(rng, "boards", "conversion_s"), b_first)
    period = int(rng.choice(found["period_ms"], p=np.array(found["period_share"]) / sum(found["period_share"])))
    return Timing((period, period, period), 0.0, b_first)


def readings(rng: np.random.Generator, geometry: Geometry, timing_: Timing, until_s: float) -> list[Readings]:
    """When each board converts and sends; boards are out of phase and their crystals differ by tens of ppm."""
    out = []
    for board in range(3):
        triangles = np.flatnonzero(geometry.board == board)
        period = timing_.period_ms[board] / 1e3 * (1 + 1e-6 * rng.uniform(-15, 15))
        phase = board * 0.3 * period + rng.uniform(0, 0.25 * period)
        n = int((until_s - 0.05 - phase) / period)
        tick = phase + period * np.arange(n) + np.abs(rng.normal(0, 4e-5, n))
        sent = tick[:, None] + np.arange(len(triangles)) * 2 * FRAME_S
        if timing_.conversion_s:
            each = timing_.conversion_s * (1 + 1e-3 * rng.uniform(-1, 1, len(triangles)))
            start = rng.uniform(0, timing_.conversion_s, len(triangles))
            conversion = np.floor((sent - start) / each).astype(np.int64)
            converted = start + each * conversion
        else:
            conversion = np.broadcast_to(np.arange(n)[:, None], sent.shape)
            converted = sent
        out.append(Readings(triangles, converted, conversion - conversion.min(0), sent))
    return out


def fresh_noise(rng: np.random.Generator, these: Readings) -> np.ndarray:
    """(n, m, 12) standard normal numbers, one per conversion and taxel."""
    drawn = rng.standard_normal((int(these.conversion.max()) + 1, len(these.triangles), 12), np.float32)
    return np.take_along_axis(drawn, these.conversion[..., None], 0)


def _digits(values: np.ndarray, width: int) -> np.ndarray:
    powers = 10 ** np.arange(width - 1, -1, -1, dtype=np.int64)
    return (values[:, None] // powers % 10 + ord("0")).astype(np.uint8)


@dataclass(frozen=True)
class Sent:
    """What one board put on the bus."""

    readings: Readings
    values: np.ndarray  # (n, m, 12) uint8
    status: np.ndarray  # (n, m) uint8, the error nibble
    kept: np.ndarray  # (n, m, 2) bool, which halves reach the file


def _lines(geometry: Geometry, board: Sent, epoch_us: int, b_first: bool) -> tuple[np.ndarray, ...]:
    n, m = board.status.shape
    payload = np.zeros((n, m, 2, 8), np.uint8)
    payload[:, :, 0, 0], payload[:, :, 1, 0] = 0x40, 0xC0
    payload[:, :, 0, 1:] = board.values[..., _A]
    payload[:, :, 1, 1:6] = board.values[..., _B]
    payload[:, :, 1, 7] = board.status
    when = epoch_us + np.rint(board.readings.sent_s * 1e6).astype(np.int64)
    order = np.array([1, 0]) if b_first else np.array([0, 1])
    when = when[:, :, None] + order * round(FRAME_S * 1e6)
    triangles = board.readings.triangles
    head = (geometry.address[triangles] % 16 * 16 + geometry.slot[triangles] % 16).astype(np.uint8)
    heads = np.broadcast_to(head[None, :, None], (n, m, 2))
    kept = board.kept.reshape(-1)
    return when.reshape(-1)[kept], heads.reshape(-1)[kept], payload.reshape(-1, 8)[kept]


def write_candump(path: Path, geometry: Geometry, boards: list[Sent], epoch_s: int, b_first: bool) -> None:
    """Write `candump -L` text, compressed."""
    parts = [_lines(geometry, board, epoch_s * 1_000_000, b_first) for board in boards]
    when, heads, payload = (np.concatenate(x) for x in zip(*parts, strict=True))
    order = np.argsort(when, kind="stable")
    when, heads, payload = when[order], heads[order], payload[order]
    line = np.zeros((len(when), 46), np.uint8)
    line[:] = np.frombuffer(b"(0000000000.000000) can0 400#0000000000000000\n", np.uint8)
    line[:, 1:11] = _digits(when // 1_000_000, 10)
    line[:, 12:18] = _digits(when % 1_000_000, 6)
    line[:, 26:28] = _HEX[heads].view(np.uint8)
    line[:, 29:45] = _HEX[payload].view(np.uint8).reshape(len(when), 16)
    with path.open("wb") as raw, gzip.GzipFile("", "wb", 1, raw, mtime=0) as out:
        out.write(line.tobytes())


def rows_of(boards: list[Sent], period_s: float, until_s: float) -> tuple[np.ndarray, np.ndarray]:
    """What a host that publishes every `period_s` writes: times (n,) and the newest bytes (n, 28, 12).

    Only frames that arrived whole count; before the first one the host holds what it will be.
    """
    seconds = np.arange(0.1, until_s, period_s)
    counts = np.zeros((len(seconds), 28, 12), np.uint8)
    for board in boards:
        for j, triangle in enumerate(board.readings.triangles):
            whole = np.flatnonzero(board.kept[:, j].all(1))
            newest = np.searchsorted(board.readings.sent_s[whole, j], seconds) - 1
            counts[:, triangle] = board.values[whole[np.maximum(newest, 0)], j]
    return seconds, counts


def fix_times(folder: Path, epoch_s: int = 1_700_000_000) -> None:
    """One modification time for everything in `folder`: the order in which it was written says nothing."""
    for found in sorted(folder.rglob("*"), reverse=True):
        os.utime(found, (epoch_s, epoch_s))
    os.utime(folder, (epoch_s, epoch_s))
