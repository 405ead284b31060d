"""Walks for the tests: a few triangles, steps from heel to toe, effects applied by hand, and a force shoe."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.document import dump
from insole_daemon.recording.reference import text
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.layout import Layout

from ..chamber import LAYOUT, SLOTS, Sensors

Array = NDArray[np.float64]
DT_S = 0.002
BEGAN_S = 1_750_000_000.0
PA_PER_COUNT = 7e3


def load(seconds: float, seed: int, layout: Layout = LAYOUT) -> tuple[Array, Array]:
    """Return times (N,) s and pressures (N, 72) Pa: a second in the air, then different steps of about 1.1 s."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, seconds, DT_S)
    x = layout.xy_m[..., 0].ravel()[:, None]
    along = (x - x.min()) / np.ptp(x)
    p = np.zeros((len(along), len(t_s)))
    began_s = 1.0
    while began_s < seconds - 1.5:
        stance_s, top_pa = rng.normal(0.65, 0.03), rng.normal(200e3, 15e3)
        phase = (t_s - began_s) / stance_s
        within = (phase > 0) & (phase < 1)
        edges = np.minimum(np.minimum(phase / 0.1, (1 - phase) / 0.12), 1.0)  # heel strike and toe-off
        bump = np.exp(-(((phase - 0.15 - 0.65 * along) / rng.normal(0.25, 0.01)) ** 2))
        p += np.where(within, top_pa * np.sin(np.clip(edges, 0, 1) * np.pi / 2) ** 2 * bump, 0.0)
        began_s += stance_s + rng.normal(0.45, 0.02)
    return t_s, p.T


def late(p: Array, tau_s: float) -> Array:
    """Return `p` (N, m) after a first-order low pass, by the trapezoidal rule."""
    k = DT_S / (2 * tau_s)
    return np.asarray(lfilter([k / (1 + k), k / (1 + k)], [1.0, -(1 - k) / (1 + k)], p, axis=0))


def write(
    folder: Path,
    effect: Callable[[Array], Array] = lambda p: p,
    where: NDArray[np.bool_] | None = None,
    delay_s: float = 0.0,
    clock: str = "can",
    seconds: float = 26.0,
    seed: int = 1,
    calibrated: bool = True,
    force: float = 1.0,
    stands_s: float = 0.0,
    sensors: Sensors | None = None,
    touch: Callable[[Array, Array], None] = lambda t_s, read: None,
    period_ms: int = 20,
) -> Path:
    """Write a recording whose taxels `where` (72,) bear `effect(load)` and are read `delay_s` late; it begins standing.

    `sensors`: of the insole, else straight ones. `touch` changes what is read (n, 72) at times (n,) in place.
    `period_ms`: of all boards.
    """
    rng = np.random.default_rng(seed + 1000)
    t_s, p = load(seconds, seed)
    p[t_s < stands_s] = 100e3
    q = np.where(np.ones(p.shape[1], bool) if where is None else where, effect(p), p)
    cycle_s = np.arange(0.1, seconds - 0.05, period_ms * 1e-3)
    felt = np.stack([np.interp(cycle_s - delay_s, t_s, column) for column in q.T], axis=1)
    rest = rng.normal(240.0, 1.0, p.shape[1])
    straight = rest - felt / PA_PER_COUNT / rng.normal(1.0, 0.03, p.shape[1])
    read = (straight if sensors is None else sensors.read(felt)) + rng.normal(0.0, 0.8, felt.shape)
    touch(cycle_s, read)
    counts = np.clip(np.rint(read), 0, 255).astype(np.uint8).reshape(len(cycle_s), -1, 12)
    folder.mkdir(parents=True)
    # Ages say that readings were taken when their rows were written: without them a reading may be a row old.
    age_ms = np.full(counts.shape[:2], 1e-3, np.float32)
    table = CountsTable(np.rint((BEGAN_S + cycle_s) * 1e9).astype(np.int64), counts, age_ms=age_ms)
    counts_file.write(folder / "counts.npz", {"left": table})
    own = np.isin(np.arange(p.shape[1]), SLOTS)
    xy = LAYOUT.xy_m.reshape(-1, 2)
    arms = LAYOUT.taxel_area_m2 * np.stack([np.ones(len(xy)), xy[:, 1], -xy[:, 0]], axis=1)
    wrench = (p[:, own] @ arms[own])[::5] * force + rng.normal(0.0, (1.0, 0.05, 0.05), (len(t_s[::5]), 3))
    began = BEGAN_S if clock == "can" else 3.0
    columns = {"time_s": began + t_s[::5], "fz_n": wrench[:, 0], "mx_nm": wrench[:, 1], "my_nm": wrench[:, 2]}
    (folder / "reference.csv").write_text(text(columns))
    layouts.write(folder / "layout.yaml", LAYOUT)
    taxels = [
        {"board": int(LAYOUT.identities[slot // 12, 0]), "triangle": int(LAYOUT.identities[slot // 12, 1]),
         "taxel": slot % 12, "baseline_count": float(rest[slot]), "coefficients_pa": [0.0, PA_PER_COUNT]}
        for slot in SLOTS.tolist()
    ]  # fmt: skip
    model = {"format": "insole-calibration/1", "foot": "left", "taxels": taxels, "effects": [], "provenance": {}}
    if sensors is not None:
        model = sensors.model(LAYOUT)
    boards = [{"address": a, "period_ms": period_ms, "shift": 3, "no_load": 240, "skin_type": 0} for a in (5, 6, 7)]
    insole = {"foot": "left", "layout": "layout.yaml", "boards": boards}
    if calibrated:
        (folder / "calibration.json").write_text(json.dumps(model))
        insole["calibration"] = "calibration.json"
    said_of = {"foot": "left", "file": "reference.csv", "clock": clock}
    document = {"kind": "shoe", "counts": "counts.npz", "can_origin": "simulated", "insoles": [insole]}
    (folder / "recording.yaml").write_text(dump({**document, "reference": [said_of]}))
    return folder


def change_force(folder: Path, change: Callable[[Array], Array]) -> None:
    """Replace the force (N,) of the reference of a recording by `change` of it."""
    rows = [row.split(",") for row in (folder / "reference.csv").read_text().splitlines()]
    f_z = rows[0].index("fz_n")
    force_n = change(np.array([float(row[f_z]) for row in rows[1:]]))
    for row, value in zip(rows[1:], force_n.tolist(), strict=True):
        row[f_z] = str(value)
    (folder / "reference.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
