"""Faults of taxels, triangles, boards and the reference."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .boards import OPEN_BYTES, OPEN_STATUS, Readings, Sent
from .geometry import PRESSURE_TAXELS, Geometry
from .ranges import entry
from .trial import Trial

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


def fault(rng: np.random.Generator, geometry: Geometry, trial: Trial, word: str) -> Fault:
    """A fault of that word somewhere in the part the tool is given."""
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
        shape = {"kind": kind, "size": size, "t_s": float(rng.uniform(0.3, 0.6)) * trial.main_s}
        shape["sign"] = 1.0 if rng.random() < 0.5 else -1.0
        return Fault(word, {"scope": "insole", "ids": []}, mask, shape, [])
    peak = trial.pressure(geometry.centre_mm).max(0)
    triangle = int(rng.choice(np.flatnonzero(peak >= 0.3 * peak.max())))
    address = int(geometry.address[triangle])
    whole_board = word == "frame_loss" or (word == "noise_burst" and rng.random() < 0.5)
    where: dict[str, Any] = {"scope": "board", "ids": [[address]]}
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
    return Fault(word, where, mask, shape, _intervals(rng, word, trial.main_s))


def _during(fault_: Fault, seconds: np.ndarray) -> np.ndarray:
    inside = np.zeros(seconds.shape, bool)
    for begin, end in fault_.when_s:
        inside |= (seconds >= begin) & (seconds < end)
    return inside


def burst_factor(faults: tuple[Fault, ...], these: Readings) -> np.ndarray:
    """(n, m, 12): what bursts multiply the noise with."""
    factor = np.ones((*these.converted_s.shape, 12), np.float32)
    for f in faults:
        if f.word == "noise_burst":
            here = f.place[these.triangles]
            factor *= 1 + (f.shape["factor"] - 1) * _during(f, these.converted_s)[..., None] * here
    return factor


def break_frames(
    rng: np.random.Generator, faults: tuple[Fault, ...], these: Readings, values: np.ndarray, no_load: int
) -> Sent:
    """What the bus carries of one board's values (n, m, 12)."""
    values = values.copy()
    status = np.zeros(values.shape[:2], np.uint8)
    kept = np.ones((*values.shape[:2], 2), bool)
    for f in faults:
        mine = f.place.any(1)[these.triangles]
        if not mine.any():
            continue
        if f.word == "frame_loss" and f.shape["kind"] == "lost":
            kept &= ~((rng.random(kept.shape) < f.shape["share"]) & mine[:, None])
        elif f.word == "frame_loss":
            again = rng.random(len(values)) < f.shape["share"]
            again[0] = False
            source = np.maximum.accumulate(np.where(again, 0, np.arange(len(values))))
            values[:, mine] = values[source][:, mine]
        elif f.word == "open_triangle":
            loose = _during(f, these.sent_s) & mine
            values[loose] = OPEN_BYTES
            status[loose] = OPEN_STATUS
        elif f.word == "dead_taxels":
            kill(f, values, these.triangles, no_load)
    return Sent(these, values, status, kept)


def kill(f: Fault, values: np.ndarray, triangles: np.ndarray, no_load: int) -> None:
    """Put the constant of each dead taxel into `values` (n, m, 12) of these triangles."""
    for (t, k), kind in zip(f.shape["taxels"], f.shape["values"], strict=True):
        constant = {"stuck": 40 + (37 * k + 11 * t) % 150, "zero": 0, "full": 255, "rest": no_load}[kind]
        values[:, triangles == t, k] = constant


def break_reference(
    rng: np.random.Generator, faults: tuple[Fault, ...], seconds: np.ndarray, values: np.ndarray, span: float
) -> np.ndarray:
    """The main channel of the reference (n,) as it is written down; `span` is its highest value."""
    for f in faults:
        if f.word != "reference_fault":
            continue
        size, late = span * f.shape["size"] * f.shape["sign"], np.maximum(seconds - f.shape["t_s"], 0)
        if f.shape["kind"] == "spikes":
            values = values + size * rng.choice([-1.0, 1.0], len(values)) * (rng.random(len(values)) < 0.004)
        elif f.shape["kind"] == "step":
            values = values + size * (late > 0)
        else:
            values = values + size * late / (seconds[-1] - f.shape["t_s"])
    return values
