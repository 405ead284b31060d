"""Generator of chamber recordings with concealed effects, on which the thresholds of the diagnosis were chosen.

    python -m benchmarks.diagnosis.training OUT --seed 1 --cases 40

This is not the blind benchmark (`benchmarks/diagnosis/blind`), which no threshold was chosen on: this generator has the
same author as the diagnosis. Its laws differ from those of the diagnosis: Bouc–Wen instead of plays, a Preisach
density, a fractional power law instead of a spectrum of exponentials. Each case is a folder; `truth.json` beside the
folders lists the concealed effects.

Takes about a minute, and needs OUT.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.document import dump
from insole_daemon.recording.reference import text
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.geometry import PRESSURE_TAXELS

Array = NDArray[np.float64]
DT = 0.005
LAYOUT = layouts.builtin("left", (5, 6, 7))
PRESSURE_SLOTS = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(LAYOUT)))
BASE_S = 1_750_000_000.0


def load(rng: np.random.Generator, seconds: float, top: float, speeds: int, holds: bool) -> Array:
    """(N,) Pa on DT: cycles between rest and changing tops, minor loops, holds."""
    p, level = [0.0] * int(3 / DT), 0.0
    rates = top / np.array([3.0, 12.0])[:speeds] * rng.uniform(0.8, 1.2)
    while len(p) * DT < seconds:
        rate = rng.choice(rates)
        minor = rng.random() < 0.35
        goal = level * rng.uniform(0.4, 0.9) if minor and level > 0.3 * top else rng.uniform(0.5, 1.0) * top
        if level > 0.45 * top and not minor:
            goal = 0.0 if rng.random() < 0.7 else rng.uniform(0.0, 0.3) * top
        n = max(int(abs(goal - level) / rate / DT), 1)
        p += list(np.linspace(level, goal, n))
        level = goal
        if holds and rng.random() < 0.4:
            p += [level] * int(rng.uniform(4, 25) / DT)
    p = np.array(p[: int(seconds / DT)])
    kernel = np.ones(9) / 9
    return np.convolve(np.pad(p, 4, mode="edge"), kernel, mode="valid")


def bouc_wen(p: Array, a: float, width: float) -> Array:
    h, out = 0.0, np.empty_like(p)
    for i, dp in enumerate(np.diff(p, prepend=p[:1])):
        h += dp * (1 - abs(h / width) * (0.6 * np.sign(dp * h) + 0.4))
        out[i] = p[i] - a * h
    return out


def preisach(p: Array, a: float, top: float, rng: np.random.Generator) -> Array:
    """Relays with a bell of widths, drawn."""
    n = 1500
    centre, half = rng.uniform(0, top, n), np.abs(rng.normal(0, 0.12 * top, n))
    state, out = np.zeros(n), np.empty_like(p)
    for i, x in enumerate(p):
        state[x >= centre + half] = 1
        state[x <= centre - half] = 0
        out[i] = state.mean()
    return (1 - a) * p + a * top * out


def power_law(p: Array, share: float, exponent: float, horizon: float) -> Array:
    """Boltzmann's superposition with J(t) = share · (t/horizon)^n, by convolution."""
    t = np.arange(len(p)) * DT
    j = share * (np.maximum(t, DT / 2) / horizon) ** exponent
    dp = np.diff(p, prepend=0.0)
    n = 2 * len(p)
    grown = np.fft.irfft(np.fft.rfft(dp, n) * np.fft.rfft(j, n), n)[: len(p)]
    return p + grown


def solid(p: Array, a: float, tau: float) -> Array:
    z, out, k = p[0], np.empty_like(p), np.exp(-DT / tau)
    for i, x in enumerate(p):
        z = x + (z - x) * k
        out[i] = (1 - a) * x + a * z
    return out


def lagged(p: Array, tau: float) -> Array:
    return solid(p, 1.0, tau)


def relay(p: Array, up: float, down: float, step: float) -> Array:
    on, out = False, np.empty_like(p)
    for i, x in enumerate(p):
        on = x >= up or (on and x > down)
        out[i] = x + step * on
    return out


def multiplicative(p: Array, share: float, tau: float) -> Array:
    """Outside the library: the gain tires with the load's own history."""
    tired = np.cumsum(np.maximum(np.diff(p, prepend=p[:1]), 0))
    return p * (1 + share * np.sin(tired / p.max() / tau))


def fatigue(p: Array, share: float) -> Array:
    """Outside the library: rate stiffening, q depends on the speed without memory."""
    rate = np.gradient(p, DT)
    return p * (1 + share * np.tanh(np.abs(rate) / (0.1 * p.max())))


def law_of(word: str, rng: np.random.Generator, p: Array, top: float, seconds: float) -> Callable[[float], Array]:
    """Draw the shape of an effect on the load `p`; the load that the sensor then sees, by the effect's amplitude."""
    t = np.arange(len(p)) * DT
    if word == "hysteresis":
        if rng.random() < 0.5:
            width = rng.uniform(0.08, 0.3) * top
            return lambda a: bouc_wen(p, a, width)
        seed = int(rng.integers(1 << 30))
        return lambda a: preisach(p, a, top, np.random.default_rng(seed))
    if word == "snap":
        up = rng.uniform(0.15, 0.5) * top
        down = up * rng.uniform(0.3, 0.7)
        return lambda a: relay(p, up, down, a * top)
    if word == "viscoelasticity":
        tau = np.exp(rng.uniform(np.log(0.2), np.log(3.0)))
        return lambda a: solid(p, a, tau)
    if word == "creep":
        exponent = rng.uniform(0.1, 0.4)
        return lambda a: power_law(p, a, exponent, seconds)
    if word == "lag":
        return lambda a: lagged(p, max(a, 1e-3))
    if word == "delay":
        return lambda a: np.interp(t - a, t, p)
    if word == "multiplicative":
        tau = rng.uniform(0.3, 1.0)
        return lambda a: multiplicative(p, a, tau)
    assert word == "fatigue", word
    return lambda a: fatigue(p, a)


def count_change(
    word: str, rng: np.random.Generator, k: float, cycle: Array, p: Array, warm: Array, seconds: float
) -> Array:
    """Draw an effect on the counts, of k × the noise; (n, 1) or (n, taxels).

    `p` and `warm`, the temperature without its mean, are (n,) at the times `cycle`.
    """
    if word == "rezero":
        board = LAYOUT.identities[:, 0] == rng.choice([5, 6, 7])
        jump = (cycle > seconds * rng.uniform(0.2, 0.7))[:, None] * np.repeat(board, 12)
        return 2.0 * k * rng.choice([-1, 1]) * jump
    if word == "temperature":
        u = p / p.max()
        share = rng.uniform(0, 1)
        shape = share * warm / warm.std() + (1 - share) * warm * u / np.std(warm * u)
        return k * 1.12 * shape[:, None]
    assert word == "drift", word
    knots = seconds * (np.arange(3) + rng.uniform(0.3, 0.9, 3)) / 3.2
    wander = np.interp(cycle, np.r_[0, knots, seconds], np.r_[0, rng.normal(0, 1, 4)])
    return k * 1.12 * (wander / wander.std())[:, None]


def case(rng: np.random.Generator, out: Path, words: list[str], k: float, kind: dict) -> dict:
    seconds, top = kind["seconds"], kind["top"]
    p = load(rng, seconds, top, kind["speeds"], kind["holds"])
    t = np.arange(len(p)) * DT
    n_taxels = len(LAYOUT) * 12
    temperature = 25 + 6 * np.sin(2 * np.pi * t / seconds * rng.uniform(0.6, 1.4) + rng.uniform(0, 6)) * kind["warm"]
    # The true curve: activation = s·P/(1 + P/c), a few percent beside the one that is believed.
    s = rng.normal(18e-5, 2e-5, n_taxels)
    bend = rng.normal(900e3, 80e3, n_taxels)
    noise = rng.uniform(0.9, 1.3, n_taxels)
    cycle = np.sort(np.arange(0.1, seconds - 0.1, 0.02) + rng.normal(0, 2e-4, int(np.ceil((seconds - 0.2) / 0.02))))
    place = kind["place"](rng)
    truth: list[dict] = []

    def sampled(q: Array) -> Array:
        return np.interp(cycle, t, q)

    def amplitude_of(law: Callable[[float], Array]) -> float:
        """The amplitude at which a free cubic leaves k × the noise, at the middle taxel."""
        low, high = 0.0, kind.get("most", 0.5)
        basis = np.vander(sampled(p) / top, 6)
        for _ in range(12):
            middle = (low + high) / 2
            y = np.median(s) * sampled(law(middle)) / (1 + sampled(law(middle)) / 900e3)
            rest = y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
            low, high = (middle, high) if np.std(rest) < k * 1.12 else (low, middle)
        return middle

    q, timed, count_terms = p, p, np.zeros((len(cycle), 1))
    order = ["hysteresis", "snap", "viscoelasticity", "creep", "lag", "delay", "multiplicative", "fatigue"]
    for word in sorted(words, key=lambda w: order.index(w) if w in order else 99):
        if word not in order:
            warm = sampled(temperature) - temperature.mean()
            count_terms = count_terms + count_change(word, rng, k, cycle, sampled(p), warm, seconds)
            truth.append({"effect": word})
            continue
        law = law_of(word, rng, p, top, seconds)
        amplitude = amplitude_of(law)
        if word in ("lag", "delay"):  # of the electronics: the same for all taxels
            timed = timed + law(amplitude) - p
        else:
            q = q + law(amplitude) - p
        truth.append({"effect": word, "amplitude": amplitude})
    load_columns = np.where(place, sampled(q)[:, None], sampled(p)[:, None])
    scatter = rng.normal(1, 0.1, n_taxels)
    load_columns = sampled(p)[:, None] + scatter * (load_columns - sampled(p)[:, None])
    load_columns += sampled(timed - p)[:, None] * place
    activation = s * load_columns / (1 + load_columns / bend) + count_terms * place
    raw = activation + rng.normal(0, 1, activation.shape) * noise
    rest = rng.normal(240.5, 1.2, n_taxels)
    counts = np.clip(np.floor(rest - raw + rng.random(n_taxels)), 0, 255).astype(np.uint8)
    out.mkdir(parents=True)
    table = CountsTable(
        np.rint((BASE_S + cycle) * 1e9).astype(np.int64), counts.reshape(-1, len(LAYOUT), 12), *[None] * 7
    )
    counts_file.write(out / "counts.npz", {"left": table})
    write_reference(out, rng, t, p, temperature, kind)
    layouts.write(out / "layout.yaml", LAYOUT)
    write_calibration(out, rng, s, bend, rest, top)
    write_recording(out, kind["clock"])
    return {
        "words": words,
        "k": k,
        "truth": truth,
        "taxels": int(place[PRESSURE_SLOTS].sum()),
        "place": np.flatnonzero(place).tolist(),
        **{n: kind[n] for n in ("speeds", "holds", "clock", "top", "seconds")},
    }


def write_reference(out: Path, rng: np.random.Generator, t: Array, p: Array, temperature: Array, kind: dict) -> None:
    """The gauge's readings, on a clock of its own where `kind` says so."""
    gauge_t = np.arange(0.0, kind["seconds"], 0.01)
    gauge_p = np.interp(gauge_t, t, p) + rng.normal(0, kind["reference_noise"], gauge_t.size)
    own = kind["clock"] == "own"
    offset, rate = (rng.uniform(-2, 2), rng.uniform(-5e-5, 5e-5)) if own else (BASE_S, 0.0)
    columns = {
        "time_s": np.round(offset + (1 + rate) * gauge_t + (5.0 if own else 0.0), 6),
        "pressure_pa": np.round(gauge_p, 1),
        "temperature_c": np.round(np.interp(gauge_t, t, temperature), 2),
    }
    (out / "reference.csv").write_text(text(columns))


def write_calibration(out: Path, rng: np.random.Generator, s: Array, bend: Array, rest: Array, top: float) -> None:
    """The believed curves: a cubic a taxel, with the gain and the baseline a little off."""
    grid = np.linspace(0, top, 60)
    taxels = []
    identities = LAYOUT.identities.tolist()
    for slot in PRESSURE_SLOTS:
        a = s[slot] * grid / (1 + grid / bend[slot]) * rng.normal(1, 0.02)
        design = np.stack([a, a**2, a**3], axis=1)
        c = np.linalg.lstsq(design, grid, rcond=None)[0]
        taxels.append(
            {
                "board": identities[slot // 12][0],
                "triangle": identities[slot // 12][1],
                "taxel": int(slot % 12),
                "baseline_count": float(rest[slot] + rng.normal(0, 0.3)),
                "coefficients_pa": [0.0, *c.tolist()],
            }
        )
    (out / "calibration.json").write_text(
        json.dumps(
            {"format": "insole-calibration/1", "foot": "left", "taxels": taxels, "effects": [], "provenance": {}}
        )
    )


def write_recording(out: Path, clock: str) -> None:
    boards = [
        {"address": a, "interface": "can0", "period_ms": 20, "shift": 3, "no_load": 240, "skin_type": 0}
        for a in (5, 6, 7)
    ]
    insole = {"foot": "left", "layout": "layout.yaml", "calibration": "calibration.json", "boards": boards}
    document = {
        "kind": "chamber",
        "counts": "counts.npz",
        "can_origin": "simulated",
        "insoles": [insole],
        "reference": [{"foot": "left", "file": "reference.csv", "clock": clock}],
    }
    (out / "recording.yaml").write_text(dump(document))


def everywhere(rng: np.random.Generator) -> NDArray[np.bool_]:
    return np.ones(len(LAYOUT) * 12, bool)


def somewhere(rng: np.random.Generator) -> NDArray[np.bool_]:
    found = np.zeros((len(LAYOUT), 12), bool)
    boards = LAYOUT.identities[:, 0]
    what = rng.integers(3)
    if what == 0:
        found[boards == rng.choice([5, 6, 7])] = True
    elif what == 1:
        found[rng.choice(len(LAYOUT), rng.integers(1, 3), replace=False)] = True
    else:
        found.ravel()[rng.choice(PRESSURE_SLOTS, rng.integers(1, 5), replace=False)] = True
    return found.ravel()


KNOWN = ["hysteresis", "snap", "viscoelasticity", "creep", "lag", "delay", "temperature", "drift", "rezero"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--k", type=float, nargs="*", default=[0.5, 1.0, 3.0])
    arguments = parser.parse_args()
    truths = {}
    for i in range(arguments.cases):
        rng = np.random.default_rng([arguments.seed, i])
        words = [list(x) for x in ([], *[[w] for w in KNOWN], ["multiplicative"], ["fatigue"])]
        if i % 3 == 2:
            chosen = list(rng.choice(KNOWN, 2, replace=False))
        elif i % 9 == 4:
            chosen = list(rng.choice(KNOWN, 3, replace=False))
        else:
            chosen = words[(i // 3 * 2 + i % 3) % len(words)]
        kind = {
            "seconds": float(rng.uniform(100, 180)),
            "top": float(rng.choice([90e3, 330e3, 330e3])),
            "speeds": 2,
            "holds": True,
            "warm": True,
            "clock": "can" if {"lag", "delay"} & set(chosen) else str(rng.choice(["own", "can"])),
            "reference_noise": 300.0,
            "place": somewhere if len(chosen) == 1 and rng.random() < 0.3 else everywhere,
        }
        truths[f"case-{i:03}"] = case(
            rng, arguments.out / f"case-{i:03}", chosen, float(rng.choice(arguments.k)) if chosen else 0.0, kind
        )
        (arguments.out / "truth.json").write_text(json.dumps(truths, indent=1))


if __name__ == "__main__":
    main()
