"""Faults of boards, wires and the reference: what an audit has to find before anything is called physics."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.blind.frames import OPEN_BYTES, OPEN_STATUS
from benchmarks.blind.geometry import PRESSURE_TAXELS, Geometry
from benchmarks.blind.loads import Load
from benchmarks.blind.ranges import entry

FAULTS = tuple(entry("faults"))


@dataclass(frozen=True)
class Fault:
    """`place` (28, 12) bool; `shape` holds what this kind needs."""

    word: str
    where: dict[str, Any]
    place: np.ndarray
    shape: dict[str, Any]
    when_s: list[list[float]]


def _intervals(rng: np.random.Generator, word: str, main_s: float) -> list[list[float]]:
    low, high = entry("faults", word)["intervals"]
    shortest, longest = entry("faults", word)["duration_s"]
    n = int(rng.integers(low, high + 1))
    slots = np.linspace(5, main_s - 5, n + 1)
    out = []
    for begin, end in pairwise(slots):
        length = min(rng.uniform(shortest, longest), 0.8 * (end - begin))
        start = rng.uniform(begin, end - length)
        out.append([float(start), float(start + length)])
    return out


def fault(rng: np.random.Generator, geometry: Geometry, load: Load, word: str) -> Fault:
    """A fault of that word somewhere in the part the tool sees."""
    source = entry("faults", word)
    mask = np.zeros((28, 12), bool)
    if word == "dead_taxels":
        n = int(rng.integers(source["count"][0], source["count"][1] + 1))
        all_taxels = [(t, k) for t in range(28) for k in PRESSURE_TAXELS]
        chosen = sorted(all_taxels[int(i)] for i in rng.choice(len(all_taxels), n, replace=False))
        for t, k in chosen:
            mask[t, k] = True
        ids = [[int(geometry.address[t]), int(geometry.slot[t]), k] for t, k in chosen]
        values = [source["values"][int(rng.integers(len(source["values"])))] for _ in chosen]
        return Fault(word, {"scope": "taxel", "ids": ids}, mask, {"taxels": chosen, "values": values}, [])
    if word == "reference_fault":
        kind = source["kinds"][int(rng.integers(3))]
        size = float(rng.uniform(*source["spike_fraction" if kind == "spikes" else "step_fraction"]))
        shape = {"kind": kind, "size_pa": size * load.span_pa, "t_s": float(rng.uniform(0.3, 0.6)) * load.main_s}
        shape["sign"] = 1.0 if rng.random() < 0.5 else -1.0
        return Fault(word, {"scope": "insole", "ids": []}, mask, shape, [])
    triangle = int(rng.integers(28))
    address = int(geometry.address[triangle])
    whole_board = word == "frame_loss" or (word == "noise_burst" and rng.random() < 0.5)
    where = {"scope": "board", "ids": [[address]]}
    if whole_board:
        mask[geometry.address == address] = True
    else:
        mask[triangle] = True
        where = {"scope": "triangle", "ids": [[address, int(geometry.slot[triangle])]]}
    mask[:, [k for k in range(12) if k not in PRESSURE_TAXELS]] = False
    if word == "frame_loss":
        kind = source["kinds"][int(rng.integers(2))]
        return Fault(word, where, mask, {"kind": kind, "share": float(rng.uniform(*source["share"]))}, [])
    shape = {"factor": float(rng.uniform(*source["factor"]))} if word == "noise_burst" else {}
    return Fault(word, where, mask, shape, _intervals(rng, word, load.main_s))


def _during(fault_: Fault, seconds: np.ndarray) -> np.ndarray:
    inside = np.zeros(seconds.shape, bool)
    for begin, end in fault_.when_s:
        inside |= (seconds >= begin) & (seconds < end)
    return inside


def noisier(faults: list[Fault], seconds: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """The noise's factor (n, 28, 12) with the bursts in it."""
    for f in faults:
        if f.word == "noise_burst":
            factor = factor * (1 + (f.shape["factor"] - 1) * _during(f, seconds)[..., None] * f.place)
    return factor


def break_frames(
    rng: np.random.Generator, faults: list[Fault], seconds: np.ndarray, values: np.ndarray, no_load: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(values, status, kept) as the bus carries them."""
    values = values.copy()
    status = np.zeros(values.shape[:2], np.uint8)
    kept = np.ones((*values.shape[:2], 2), bool)
    for f in faults:
        boards = f.place.any(1)
        if f.word == "frame_loss" and f.shape["kind"] == "lost":
            lost = rng.random((len(values), 28, 2)) < f.shape["share"]
            kept &= ~(lost & boards[:, None])
        elif f.word == "frame_loss":
            again = rng.random(len(values)) < f.shape["share"]
            again[0] = False
            source = np.maximum.accumulate(np.where(again, 0, np.arange(len(values))))
            values[:, boards] = values[source][:, boards]
        elif f.word == "open_triangle":
            loose = _during(f, seconds) & boards
            values[loose] = OPEN_BYTES
            status[loose] = OPEN_STATUS
        elif f.word == "dead_taxels":
            kill(f, values, no_load)
    return values, status, kept


def kill(f: Fault, values: np.ndarray, no_load: int) -> None:
    """Puts the constant of each dead taxel into `values` (n, 28, 12)."""
    for (t, k), kind in zip(f.shape["taxels"], f.shape["values"], strict=True):
        values[:, t, k] = {"stuck": 40 + (37 * k + 11 * t) % 150, "zero": 0, "full": 255, "rest": no_load}[kind]


def break_reference(
    rng: np.random.Generator, faults: list[Fault], seconds: np.ndarray, pressure: np.ndarray
) -> np.ndarray:
    """The gauge's pressure (n,) as it is written down."""
    for f in faults:
        if f.word != "reference_fault":
            continue
        size, late = f.shape["size_pa"] * f.shape["sign"], np.maximum(seconds - f.shape["t_s"], 0)
        if f.shape["kind"] == "spikes":
            pressure = pressure + size * rng.choice([-1.0, 1.0], len(pressure)) * (rng.random(len(pressure)) < 0.004)
        elif f.shape["kind"] == "step":
            pressure = pressure + size * (late > 0)
        else:
            pressure = pressure + size * late / (seconds[-1] - f.shape["t_s"])
    return pressure
