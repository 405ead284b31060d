"""Chamber recordings for the tests: a few triangles, a load at two speeds with holds, and effects applied by hand."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.document import dump
from insole_daemon.recording.reference import text
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import Layout

Array = NDArray[np.float64]
DT_S = 0.01
BEGAN_S = 1_750_000_000.0
NOISE_COUNT = 1.0

WHOLE = layouts.builtin("left", (5, 6, 7))
# Two triangles of each board are enough to tell places apart.
KEPT = [row for board in (5, 6, 7) for row in np.flatnonzero(WHOLE.identities[:, 0] == board)[:2].tolist()]
LAYOUT = Layout(
    "left", WHOLE.taxel_area_m2, WHOLE.area_meaning, tuple(WHOLE.triangles[row] for row in KEPT), WHOLE.xy_m[KEPT]
)
SLOTS = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(LAYOUT)))


@dataclass(frozen=True)
class Sensors:
    """Taxels of an insole, all 72 slots of LAYOUT: their readings under a load, and their calibration."""

    sensitivity: Array  # counts a pascal, at first
    bend: Array  # Pa
    rest: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator, n: int = 72) -> Sensors:
        return cls(rng.normal(1.6e-4, 1e-5, n), rng.normal(900e3, 50e3, n), rng.normal(240.5, 1.0, n))

    def read(self, q: Array) -> Array:
        """Return mean counts (n, 72)."""
        return self.rest - self.sensitivity * q / (1 + q / self.bend)

    def model(self, layout: Layout) -> dict[str, Any]:
        loads = np.linspace(0.0, 300e3, 60)
        taxels = []
        for slot in SLOTS.tolist():
            a = self.sensitivity[slot] * loads / (1 + loads / self.bend[slot])
            cubic = np.linalg.lstsq(np.stack([a, a**2, a**3], axis=1), loads, rcond=None)[0]
            board, triangle = layout.identities[slot // 12].tolist()
            taxels.append(
                {"board": board, "triangle": triangle, "taxel": slot % 12,
                 "baseline_count": float(self.rest[slot]), "coefficients_pa": [0.0, *cubic.tolist()]}
            )  # fmt: skip
        return {"format": "insole-calibration/1", "foot": "left", "taxels": taxels, "effects": [], "provenance": {}}


def load(seconds: float = 90.0, top_pa: float = 300e3) -> tuple[Array, Array]:
    """Return times (N,) s and pressures (N,) Pa: rest, then fast and slow cycles, minor loops and holds in turn."""
    corners = [(0.0, 0.0), (2.0, 0.0)]
    tops = [1.0, 0.7, 0.9, 0.5, 1.0, 0.8, 0.6, 1.0]
    for i in range(40):
        top, ramp = tops[i % len(tops)] * top_pa, (1.5, 6.0)[i % 2]
        t = corners[-1][0]
        corners += [(t + ramp, top), (t + ramp + (8.0 if i % 3 == 0 else 0.5), top)]
        if i % 2:
            t = corners[-1][0]
            corners += [(t + ramp / 2, 0.4 * top), (t + ramp, 0.9 * top)]
        t = corners[-1][0]
        corners += [(t + ramp, 0.0), (t + ramp + (6.0 if i % 3 == 1 else 1.0), 0.0)]
    t_s = np.arange(0.0, seconds, DT_S)
    return t_s, np.interp(t_s, *np.array(corners).T)


def write(
    folder: Path,
    effect: Callable[[Array, Array], Array] = lambda t_s, p: p,
    where: NDArray[np.bool_] | Array | None = None,
    touch: Callable[[Array, Array], None] = lambda t_s, counts: None,
    reference: Callable[[Array, Array], Array] = lambda t_s, p: p,
    clock: str = "can",
    seconds: float = 90.0,
    seed: int = 1,
    temperature: Callable[[Array], Array] | None = lambda t_s: np.full_like(t_s, 25.0),
    layout: Layout = LAYOUT,
    elsewhere: Callable[[Array, Array], Array] = lambda t_s, p: p,
) -> Path:
    """Write a recording whose taxels bear `effect(t, load)`; `touch` changes the counts in place.

    `where` (6·12,): which of them, or by how much each; the others bear `elsewhere(t, load)`. `temperature`: None, and
    no thermometer is recorded.
    """
    rng = np.random.default_rng(seed)
    t_s, p = load(seconds)
    cycle_s = np.arange(0.05, seconds - 0.05, 0.02)
    strength = np.ones(len(layout) * 12) if where is None else where.astype(float)
    here, there = (np.interp(cycle_s, t_s, changed(t_s, p))[:, None] for changed in (effect, elsewhere))
    q = there + strength * (here - there)
    sensors = Sensors.drawn(rng, strength.size)
    counts = sensors.read(q) + rng.normal(0.0, NOISE_COUNT, q.shape)
    touch(cycle_s, counts)
    whole = np.clip(np.floor(counts + rng.random(counts.shape)), 0, 255).astype(np.uint8)
    folder.mkdir(parents=True)
    table = CountsTable(
        np.rint((BEGAN_S + cycle_s) * 1e9).astype(np.int64), whole.reshape(len(cycle_s), -1, 12), *[None] * 7
    )
    counts_file.write(folder / "counts.npz", {"left": table})
    said = reference(t_s, p.copy()) + rng.normal(0.0, 100.0, p.shape)
    began = BEGAN_S if clock == "can" else 3.0
    columns = {"time_s": began + t_s, "pressure_pa": said}
    if temperature is not None:
        columns["temperature_c"] = temperature(t_s)
    (folder / "reference.csv").write_text(text(columns))
    layouts.write(folder / "layout.yaml", layout)
    (folder / "calibration.json").write_text(json.dumps(sensors.model(layout)))
    boards = [{"address": a, "period_ms": 20, "shift": 3, "no_load": 240, "skin_type": 0} for a in (5, 6, 7)]
    insole = {"foot": "left", "layout": "layout.yaml", "calibration": "calibration.json", "boards": boards}
    said_of = {"foot": "left", "file": "reference.csv", "clock": clock}
    document = {"kind": "chamber", "counts": "counts.npz", "can_origin": "simulated", "insoles": [insole]}
    (folder / "recording.yaml").write_text(dump({**document, "reference": [said_of]}))
    return folder


def relaxing(share: float, tau_s: float) -> Callable[[Array, Array], Array]:
    """A standard linear solid, by small Euler steps."""

    def effect(t_s: Array, p: Array) -> Array:
        z, out, n = p[0], np.empty_like(p), 20
        for i in range(len(p)):
            before = p[max(i - 1, 0)]
            for k in range(n):
                z += (before + (p[i] - before) * (k + 0.5) / n - z) * DT_S / n / tau_s
            out[i] = (1 - share) * p[i] + share * z
        return out

    return effect


def bouc_wen(share: float, width_pa: float) -> Callable[[Array, Array], Array]:
    """Hysteresis by another law than those of the diagnosis."""

    def effect(t_s: Array, p: Array) -> Array:
        h, out = 0.0, np.empty_like(p)
        for i, step in enumerate(np.diff(p, prepend=p[:1])):
            h += step * (1 - abs(h / width_pa) * (0.6 * np.sign(step * h) + 0.4))
            out[i] = p[i] - share * h
        return out

    return effect
