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
    """A concealed fault; `place` is (28, 12) bool, and `shape` has the parameters of this kind of fault."""

    word: str
    where: dict[str, Any]
    place: np.ndarray
    shape: dict[str, Any]
    when_s: list[list[float]]


def _draw_intervals(rng: np.random.Generator, word: str, main_s: float) -> list[list[float]]:
    """Draw the intervals [start, end] in s in which the fault is present."""
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


def draw_fault(rng: np.random.Generator, geometry: Geometry, trial: Trial, word: str) -> Fault:
    """Draw a fault called `word`, its place and its times within the part that the tool gets."""
    fault_ranges = entry("faults", word)
    mask = np.zeros((28, 12), bool)
    if word == "dead_taxels":
        n = int(rng.integers(fault_ranges["count"][0], fault_ranges["count"][1] + 1))
        all_taxels = [(t, k) for t in range(28) for k in PRESSURE_TAXELS]
        chosen = sorted(all_taxels[int(i)] for i in rng.choice(len(all_taxels), n, replace=False))
        for t, k in chosen:
            mask[t, k] = True
        ids = [[int(geometry.address[t]), int(geometry.slot[t]), k] for t, k in chosen]
        values = [fault_ranges["values"][int(rng.integers(len(fault_ranges["values"])))] for _ in chosen]
        return Fault(word, {"scope": "taxel", "ids": ids}, mask, {"taxels": chosen, "values": values}, [])
    if word == "reference_fault":
        kind = fault_ranges["kinds"][int(rng.integers(3))]
        size = float(rng.uniform(*fault_ranges["spike_fraction" if kind == "spikes" else "step_fraction"]))
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
        kind = fault_ranges["kinds"][int(rng.integers(2))]
        return Fault(word, where, mask, {"kind": kind, "share": float(rng.uniform(*fault_ranges["share"]))}, [])
    shape = {"factor": float(rng.uniform(*fault_ranges["factor"]))} if word == "noise_burst" else {}
    return Fault(word, where, mask, shape, _draw_intervals(rng, word, trial.main_s))


def _is_during(fault: Fault, seconds: np.ndarray) -> np.ndarray:
    """Bool, of the shape of `seconds`: the fault is present at this time."""
    inside = np.zeros(seconds.shape, bool)
    for begin, end in fault.when_s:
        inside |= (seconds >= begin) & (seconds < end)
    return inside


def burst_factor(faults: tuple[Fault, ...], readings: Readings) -> np.ndarray:
    """(n, m, 12): the factor by which noise bursts raise the noise of one board's readings."""
    factor = np.ones((*readings.converted_s.shape, 12), np.float32)
    for fault in faults:
        if fault.word == "noise_burst":
            is_affected = fault.place[readings.triangles]
            factor *= 1 + (fault.shape["factor"] - 1) * _is_during(fault, readings.converted_s)[..., None] * is_affected
    return factor


def break_frames(
    rng: np.random.Generator, faults: tuple[Fault, ...], readings: Readings, values: np.ndarray, no_load: int
) -> Sent:
    """Apply lost and repeated frames, open triangles and dead taxels to one board's `values` (n, m, 12)."""
    values = values.copy()
    status = np.zeros(values.shape[:2], np.uint8)
    is_kept = np.ones((*values.shape[:2], 2), bool)
    for fault in faults:
        is_affected = fault.place.any(1)[readings.triangles]
        if not is_affected.any():
            continue
        if fault.word == "frame_loss" and fault.shape["kind"] == "lost":
            is_kept &= ~((rng.random(is_kept.shape) < fault.shape["share"]) & is_affected[:, None])
        elif fault.word == "frame_loss":
            is_repeated = rng.random(len(values)) < fault.shape["share"]
            is_repeated[0] = False
            sent_row = np.maximum.accumulate(np.where(is_repeated, 0, np.arange(len(values))))
            values[:, is_affected] = values[sent_row][:, is_affected]
        elif fault.word == "open_triangle":
            is_open = _is_during(fault, readings.sent_s) & is_affected
            values[is_open] = OPEN_BYTES
            status[is_open] = OPEN_STATUS
        elif fault.word == "dead_taxels":
            set_dead_taxels(fault, values, readings.triangles, no_load)
    return Sent(readings, values, status, is_kept)


def set_dead_taxels(fault: Fault, values: np.ndarray, triangles: np.ndarray, no_load: int) -> None:
    """Write the constant of each dead taxel into `values` (n, m, 12) of these triangles (m,), in place."""
    for (t, k), kind in zip(fault.shape["taxels"], fault.shape["values"], strict=True):
        constant = {"stuck": 40 + (37 * k + 11 * t) % 150, "zero": 0, "full": 255, "rest": no_load}[kind]
        values[:, triangles == t, k] = constant


def break_reference(
    rng: np.random.Generator, faults: tuple[Fault, ...], seconds: np.ndarray, values: np.ndarray, span: float
) -> np.ndarray:
    """The main channel `values` (n,) of the reference with its fault; `span` is the channel's highest value."""
    for fault in faults:
        if fault.word != "reference_fault":
            continue
        size = span * fault.shape["size"] * fault.shape["sign"]
        seconds_since = np.maximum(seconds - fault.shape["t_s"], 0)
        if fault.shape["kind"] == "spikes":
            values = values + size * rng.choice([-1.0, 1.0], len(values)) * (rng.random(len(values)) < 0.004)
        elif fault.shape["kind"] == "step":
            values = values + size * (seconds_since > 0)
        else:
            values = values + size * seconds_since / (seconds[-1] - fault.shape["t_s"])
    return values
