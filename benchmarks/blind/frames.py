"""The boards: when they sample, what the firmware makes of it, and the frames on the bus, as a candump file."""

import gzip
import os
from pathlib import Path

import numpy as np

from benchmarks.blind.geometry import PADS, Geometry
from benchmarks.blind.sensor import Sensors

PERIOD_S = 0.02
FRAME_S = 0.00013  # on a bus of 1 Mbit/s
_A, _B = (0, 1, 2, 3, 4, 5, 6), (7, 8, 9, 10, 11)
# An open line reads 0xFFFF; the temperature compensation of type 0 then turns taxel 9 over.
OPEN_BYTES = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 0, 0], np.uint8)
OPEN_STATUS = 2
_HEX = np.array([f"{k:02X}".encode() for k in range(256)], "S2").view("S1").reshape(256, 2)


def sample_times(rng: np.random.Generator, geometry: Geometry, seconds: float) -> np.ndarray:
    """(n, 28) s since the first tick: when a triangle is read and, without delay, sent; boards drift against each other
    by less than would let them collide."""
    n = int((seconds - 0.1) / PERIOD_S)
    ticks = np.arange(n)[:, None] * PERIOD_S
    phase = np.array([0.0005, 0.0062, 0.0118]) + rng.uniform(0, 0.0008, 3)
    rate = 1 + 1e-6 * rng.uniform(-4, 4, 3)
    turn = np.zeros(28)
    for board in range(3):
        mine = geometry.board == board
        turn[mine] = np.arange(mine.sum()) * 2 * FRAME_S
    jitter = np.abs(rng.normal(0, 0.00004, (n, 3)))
    return ticks * rate[geometry.board] + phase[geometry.board] + jitter[:, geometry.board] + turn


def digitise(
    rng: np.random.Generator, mean: np.ndarray, factor: np.ndarray, sensors: Sensors, step: np.ndarray
) -> np.ndarray:
    """The byte (n, 28, 12): no_load - floor(value >> shift), clamped; `step` (28,) is what the shift really is more."""
    said, no_load = sensors.shift, sensors.no_load
    real = said + step[:, None]
    noise = rng.standard_normal(mean.shape, np.float32) * (sensors.noise * factor)
    noise[..., list(PADS)] *= 0.5
    # `mean` is the mean byte after the real shift; the noise arises before it.
    value = (no_load + (1 - 2.0**-real) / 2 - mean) * 2.0**real + noise * 2.0**said
    return np.clip(no_load - (np.rint(value).astype(np.int64) >> real), 0, 255).astype(np.uint8)


def _digits(values: np.ndarray, width: int) -> np.ndarray:
    powers = 10 ** np.arange(width - 1, -1, -1, dtype=np.int64)
    return (values[:, None] // powers % 10 + ord("0")).astype(np.uint8)


def can_log(
    path: Path, geometry: Geometry, stamps: np.ndarray, values: np.ndarray, status: np.ndarray, kept: np.ndarray
) -> None:
    """Writes `candump -L` text, compressed.

    stamps: (n, 28) s since the epoch as int64 us; values: (n, 28, 12) uint8; status: (n, 28) uint8, the error nibble;
    kept: (n, 28, 2) bool, which halves reach the file.
    """
    n = len(stamps)
    payload = np.zeros((n, 28, 2, 8), np.uint8)
    payload[:, :, 0, 0], payload[:, :, 1, 0] = 0x40, 0xC0
    payload[:, :, 0, 1:] = values[..., _A]
    payload[:, :, 1, 1:6] = values[..., _B]
    payload[:, :, 1, 7] = status
    when = stamps[:, :, None] + np.array([0, round(FRAME_S * 1e6)])
    head = ((geometry.address % 16) * 16 + geometry.slot % 16).astype(np.uint8)
    heads = np.broadcast_to(head[None, :, None], (n, 28, 2))
    flat = np.flatnonzero(kept.reshape(-1))
    flat = flat[np.argsort(when.reshape(-1)[flat], kind="stable")]
    when, heads, payload = when.reshape(-1)[flat], heads.reshape(-1)[flat], payload.reshape(-1, 8)[flat]
    line = np.zeros((len(flat), 46), np.uint8)
    line[:] = np.frombuffer(b"(0000000000.000000) can0 400#0000000000000000\n", np.uint8)
    line[:, 1:11] = _digits(when // 1_000_000, 10)
    line[:, 12:18] = _digits(when % 1_000_000, 6)
    line[:, 26:28] = _HEX[heads].view(np.uint8)
    line[:, 29:45] = _HEX[payload].view(np.uint8).reshape(len(flat), 16)
    with path.open("wb") as raw, gzip.GzipFile("", "wb", 1, raw, mtime=0) as out:
        out.write(line.tobytes())


def fix_times(folder: Path, epoch_s: int = 1_700_000_000) -> None:
    """One modification time for everything in `folder`: the order in which it was written says nothing."""
    for found in sorted(folder.rglob("*"), reverse=True):
        os.utime(found, (epoch_s, epoch_s))
    os.utime(folder, (epoch_s, epoch_s))
