"""Simulates the boards: times at which triangles are converted and sent, and their frames as a candump file."""

import gzip
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .geometry import Geometry
from .ranges import draw, entry

FRAME_S = 0.00013  # on a bus of 1 Mbit/s
_HALF_A, _HALF_B = (0, 1, 2, 3, 4, 5, 6), (7, 8, 9, 10, 11)
# An open line reads 0xFFFF; the temperature compensation of type 0 then turns taxel 9 over.
OPEN_BYTES = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 0, 0], np.uint8)
OPEN_STATUS = 2
_HEX_DIGITS = np.array([f"{k:02X}".encode() for k in range(256)], "S2").view("S1").reshape(256, 2)


@dataclass(frozen=True)
class Timing:
    """Periods and converters of the three boards: front, middle, rear."""

    period_ms: tuple[int, int, int]  # as configured
    conversion_s: float  # time between new values of a converter; 0: it converts whenever it is read
    b_first: bool  # the second half of a triangle is sent before the first


@dataclass(frozen=True)
class Readings:
    """Times at which one board converts and sends, for n ticks and m triangles."""

    triangles: np.ndarray  # (m,) indices into the layout
    converted_s: np.ndarray  # (n, m) time at which the sent value was converted
    conversion: np.ndarray  # (n, m) number of that conversion; equal numbers mean the same value
    sent_s: np.ndarray  # (n, m)


def draw_timing(rng: np.random.Generator, steady: bool) -> Timing:
    """Draw the boards' periods and converters.

    steady: no slow converter is drawn, so that every reading is a new value.
    """
    board_ranges = entry("boards")
    kinds, kind_shares = board_ranges["kinds"], np.array(board_ranges["share"])
    kind = kinds[int(rng.choice(len(kinds), p=kind_shares / sum(kind_shares)))]
    b_first = bool(rng.random() < 0.2)
    if kind == "slow_converter" and steady:
        kind = "equal"
    if kind == "mixed":
        periods = [int(p) for p in rng.choice(board_ranges["period_ms"], 3)]
        if len(set(periods)) == 1:
            periods[int(rng.integers(3))] = 50 if periods[0] != 50 else 20
        return Timing((periods[0], periods[1], periods[2]), 0.0, b_first)
    if kind == "slow_converter":
        period = int(rng.choice([10, 20]))
        return Timing((period, period, period), draw(rng, "boards", "conversion_s"), b_first)
    period_shares = np.array(board_ranges["period_share"])
    period = int(rng.choice(board_ranges["period_ms"], p=period_shares / sum(period_shares)))
    return Timing((period, period, period), 0.0, b_first)


def draw_readings(rng: np.random.Generator, geometry: Geometry, timing: Timing, until_s: float) -> list[Readings]:
    """Draw the conversion and send times of each board up to `until_s`.

    The boards are out of phase, and their crystals differ by tens of ppm.
    """
    boards = []
    for board in range(3):
        triangles = np.flatnonzero(geometry.board == board)
        period = timing.period_ms[board] / 1e3 * (1 + 1e-6 * rng.uniform(-15, 15))
        phase = board * 0.3 * period + rng.uniform(0, 0.25 * period)
        n = int((until_s - 0.05 - phase) / period)
        tick = phase + period * np.arange(n) + np.abs(rng.normal(0, 4e-5, n))
        sent = tick[:, None] + np.arange(len(triangles)) * 2 * FRAME_S
        if timing.conversion_s:
            period_of_conversion = timing.conversion_s * (1 + 1e-3 * rng.uniform(-1, 1, len(triangles)))
            first_s = rng.uniform(0, timing.conversion_s, len(triangles))
            conversion = np.floor((sent - first_s) / period_of_conversion).astype(np.int64)
            converted = first_s + period_of_conversion * conversion
        else:
            conversion = np.broadcast_to(np.arange(n)[:, None], sent.shape)
            converted = sent
        boards.append(Readings(triangles, converted, conversion - conversion.min(0), sent))
    return boards


def draw_conversion_noise(rng: np.random.Generator, board: Readings) -> np.ndarray:
    """Draw (n, m, 12) standard normal numbers, one per conversion and taxel: a repeated value repeats its noise."""
    drawn = rng.standard_normal((int(board.conversion.max()) + 1, len(board.triangles), 12), np.float32)
    return np.take_along_axis(drawn, board.conversion[..., None], 0)


def _digits(values: np.ndarray, width: int) -> np.ndarray:
    """(n, width) ASCII decimal digits of the integers `values` (n,)."""
    powers = 10 ** np.arange(width - 1, -1, -1, dtype=np.int64)
    return (values[:, None] // powers % 10 + ord("0")).astype(np.uint8)


@dataclass(frozen=True)
class Sent:
    """The values that one board sends, before they are frames."""

    readings: Readings
    values: np.ndarray  # (n, m, 12) uint8
    status: np.ndarray  # (n, m) uint8, the error nibble
    is_kept: np.ndarray  # (n, m, 2) bool: this half reaches the file


def _frames_of(geometry: Geometry, board: Sent, epoch_us: int, b_first: bool) -> tuple[np.ndarray, ...]:
    """Send times (k,) µs, low bytes of the identifiers (k,) and payloads (k, 8) of one board's k frames."""
    n, m = board.status.shape
    payload = np.zeros((n, m, 2, 8), np.uint8)
    payload[:, :, 0, 0], payload[:, :, 1, 0] = 0x40, 0xC0
    payload[:, :, 0, 1:] = board.values[..., _HALF_A]
    payload[:, :, 1, 1:6] = board.values[..., _HALF_B]
    payload[:, :, 1, 7] = board.status
    sent_us = epoch_us + np.rint(board.readings.sent_s * 1e6).astype(np.int64)
    order = np.array([1, 0]) if b_first else np.array([0, 1])
    sent_us = sent_us[:, :, None] + order * round(FRAME_S * 1e6)
    triangles = board.readings.triangles
    low_byte = (geometry.address[triangles] % 16 * 16 + geometry.slot[triangles] % 16).astype(np.uint8)
    low_bytes = np.broadcast_to(low_byte[None, :, None], (n, m, 2))
    is_kept = board.is_kept.reshape(-1)
    return sent_us.reshape(-1)[is_kept], low_bytes.reshape(-1)[is_kept], payload.reshape(-1, 8)[is_kept]


def write_candump(path: Path, geometry: Geometry, boards: list[Sent], epoch_s: int, b_first: bool) -> None:
    """Write the frames of all boards in the order of their times, as `candump -L` text compressed with gzip."""
    frames = [_frames_of(geometry, board, epoch_s * 1_000_000, b_first) for board in boards]
    sent_us, low_bytes, payload = (np.concatenate(arrays) for arrays in zip(*frames, strict=True))
    order = np.argsort(sent_us, kind="stable")
    sent_us, low_bytes, payload = sent_us[order], low_bytes[order], payload[order]
    lines = np.zeros((len(sent_us), 46), np.uint8)
    lines[:] = np.frombuffer(b"(0000000000.000000) can0 400#0000000000000000\n", np.uint8)
    lines[:, 1:11] = _digits(sent_us // 1_000_000, 10)
    lines[:, 12:18] = _digits(sent_us % 1_000_000, 6)
    lines[:, 26:28] = _HEX_DIGITS[low_bytes].view(np.uint8)
    lines[:, 29:45] = _HEX_DIGITS[payload].view(np.uint8).reshape(len(sent_us), 16)
    with path.open("wb") as file, gzip.GzipFile("", "wb", 1, file, mtime=0) as compressed:
        compressed.write(lines.tobytes())


def host_rows(boards: list[Sent], period_s: float, until_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a host that publishes every `period_s`: times (n,) in s and the newest bytes (n, 28, 12).

    Only triangles of which both halves arrived count. Before the first one, a row holds the first one's bytes.
    """
    seconds = np.arange(0.1, until_s, period_s)
    counts = np.zeros((len(seconds), 28, 12), np.uint8)
    for board in boards:
        for j, triangle in enumerate(board.readings.triangles):
            complete = np.flatnonzero(board.is_kept[:, j].all(1))
            newest = np.searchsorted(board.readings.sent_s[complete, j], seconds) - 1
            counts[:, triangle] = board.values[complete[np.maximum(newest, 0)], j]
    return seconds, counts


def fix_times(folder: Path, epoch_s: int = 1_700_000_000) -> None:
    """Set one modification time for everything in `folder`, so that times do not show the order of writing."""
    for path in sorted(folder.rglob("*"), reverse=True):
        os.utime(path, (epoch_s, epoch_s))
    os.utime(folder, (epoch_s, epoch_s))
