"""The folders: what the tool is given, and what is kept back with the truth."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.blind.case import Case, parameters
from benchmarks.blind.chamber_case import EQUIVALENT
from benchmarks.blind.faults import break_frames, break_reference, kill, noisier
from benchmarks.blind.frames import PERIOD_S, can_log, digitise, fix_times, sample_times
from benchmarks.blind.geometry import PRESSURE_TAXELS
from benchmarks.blind.ranges import draw
from benchmarks.blind.sensor import calibration_document
from benchmarks.blind.walk_chain import force_features
from benchmarks.blind.walking import Walk, Wrench

_SIMULATION_NOISE = 0.35  # count: dithers the rounding


def _recording(case: Case, counts: str, reference: bool) -> str:
    boards = [
        {
            "address": address,
            "interface": "can0",
            "period_ms": round(PERIOD_S * 1e3),
            "shift": case.sensors.shift,
            "no_load": case.sensors.no_load,
            "skin_type": 0,
        }
        for address in case.geometry.addresses
    ]
    document: dict[str, Any] = {
        "format": "insole-recording/1",
        "kind": "free" if not reference else "shoe" if isinstance(case.load, Walk) else "chamber",
        counts.split(".")[0]: counts,
        "can_origin": "simulated",
        "insoles": [
            {"foot": case.geometry.foot, "layout": "layout.yaml", "calibration": "calibration.json", "boards": boards}
        ],
    }
    if reference:
        clock = "own" if case.own_clock else "can"
        document["reference"] = [{"foot": case.geometry.foot, "file": "reference.csv", "clock": clock}]
    return yaml.safe_dump(document, sort_keys=False)


def _frame(folder: Path, case: Case, counts: str, reference: bool) -> None:
    folder.mkdir(parents=True)
    (folder / "recording.yaml").write_text(_recording(case, counts, reference))
    (folder / "layout.yaml").write_text(case.geometry.document())
    (folder / "calibration.json").write_text(
        calibration_document(case.geometry, case.sensors, 1.05 * case.load.span_pa)
    )


def _reference(folder: Path, case: Case, rng: np.random.Generator, seconds: float, faults: bool) -> None:
    period = draw(rng, "chamber", "gauge_period_s")
    # Nobody starts two instruments in the same moment.
    when = np.arange(rng.uniform(0, 1.5), seconds, period)
    when = when + rng.normal(0, 0.00005, len(when))
    grid = case.load.seconds
    if isinstance(case.load, Walk):
        columns = "fz_n,mx_nm,my_nm"
        wrench = Wrench(case.load, case.at_mm).courses
        noise = np.array([draw(rng, "walking", f"shoe_noise_{unit}") for unit in ("n", "nm", "nm")])
        values = np.stack([np.interp(when, grid, w) for w in wrench.T], 1) + noise * rng.standard_normal((len(when), 3))
        text = [f"{f:.2f},{x:.4f},{y:.4f}" for f, x, y in values.tolist()]
    else:
        columns = "pressure_pa"
        pressure = np.interp(when, grid, case.load.pressure_pa)
        pressure = pressure + draw(rng, "chamber", "gauge_noise_pa") * rng.standard_normal(len(when))
        if faults:
            pressure = break_reference(rng, list(case.faults), when, pressure)
        text = [f"{p:.0f}" for p in (np.round(pressure / 20) * 20).tolist()]
    temperature = np.interp(when, grid, case.load.temperature_c) + 0.02 * rng.standard_normal(len(when))
    reading = case.offset_s + (1 + case.rate) * when if case.own_clock else case.epoch_s + when
    rows = zip(reading.tolist(), text, temperature.tolist(), strict=True)
    lines = [f"time_s,{columns},temperature_c", *(f"{t:.6f},{values},{c:.2f}" for t, values, c in rows)]
    (folder / "reference.csv").write_text("\n".join(lines) + "\n")


def _stamps(case: Case, seconds: np.ndarray) -> np.ndarray:
    return case.epoch_s * 1_000_000 + np.rint(seconds * 1e6).astype(np.int64)


def _steps(case: Case) -> np.ndarray:
    """(28,) what the digitiser's shift really is more than said."""
    step = np.zeros(28, np.int64)
    for effect in case.effects:
        if effect.word == "bit_shift":
            step[effect.place.any(1)] = effect.shape["step"]
    return step


def write_case(folder: Path, case: Case) -> None:
    """`folder`/recording, and `folder`/simulation where the load is known from one."""
    rng = case.rng
    seconds = sample_times(rng, case.geometry, case.load.main_s)
    made = case.chain
    factor = noisier(list(case.faults), seconds, made.noise_factor(seconds))
    values = digitise(rng, made.mean_byte(seconds), factor, case.sensors, _steps(case))
    values, status, kept = break_frames(rng, list(case.faults), seconds, values, case.sensors.no_load)
    recording = folder / "recording"
    _frame(recording, case, "can.log.gz", reference=not case.simulated)
    can_log(recording / "can.log.gz", case.geometry, _stamps(case, seconds), values, status, kept)
    if case.simulated:
        write_simulation(folder / "simulation", case, rng, case.load.main_s)
    else:
        _reference(recording, case, rng, case.load.main_s, faults=True)
    fix_times(folder)


def write_simulation(folder: Path, case: Case, rng: np.random.Generator, until_s: float) -> None:
    """What the believed sensors would have said under this load, its clock off by a constant."""
    seconds = sample_times(rng, case.geometry, until_s)
    late = rng.uniform(-1, 1)
    clean = case.believed_chain.mean_byte(seconds + late)
    activation = (case.sensors.rest - clean) * case.sensors.believed_gain
    believed = case.sensors.rest + case.sensors.believed_offset - activation
    factor = np.broadcast_to(_SIMULATION_NOISE / case.sensors.noise, clean.shape)
    values = digitise(rng, believed, factor, case.sensors, np.zeros(28, np.int64))
    _frame(folder, case, "can.log.gz", reference=False)
    status, kept = np.zeros(values.shape[:2], np.uint8), np.ones((*values.shape[:2], 2), bool)
    can_log(folder / "can.log.gz", case.geometry, _stamps(case, seconds), values, status, kept)


def write_untouched(folder: Path, case: Case) -> None:
    """The whole trial with its continuation as a recording (`counts.npz`), and `scoring.npz` beside it.

    Every taxel is read at the row's time, nothing is lost or noisy; `scoring.npz` says where what the tool has seen
    ends, which taxels are usable, the true mean, and what a static recalibration on the part seen predicts.
    """
    rng = case.rng
    load = case.load
    seconds = np.arange(PERIOD_S, load.seconds[-1] - PERIOD_S, PERIOD_S)
    every = np.repeat(seconds[:, None], 28, 1)
    made = case.chain
    mean = made.mean_byte(every)
    values = digitise(rng, mean, made.noise_factor(every), case.sensors, _steps(case))
    usable = np.zeros((28, 12), bool)
    usable[:, PRESSURE_TAXELS] = True
    for f in case.faults:
        if f.word == "dead_taxels":
            usable &= ~f.place
            kill(f, values, case.sensors.no_load)
    seen = seconds < load.main_s
    baseline = _recalibrated(case.believed_pressure(seconds) / load.span_pa, values, seen)
    recording = folder / "recording"
    _frame(recording, case, "counts.npz", reference=not case.simulated)
    np.savez(recording / "counts.npz", t_s=case.epoch_s + seconds, counts=values)
    if case.simulated:
        write_simulation(folder / "simulation", case, rng, seconds[-1])
    else:
        _reference(recording, case, rng, load.seconds[-1], faults=False)
    np.savez_compressed(
        folder / "scoring.npz",
        untouched=~seen,
        usable=usable,
        mean=np.clip(mean[~seen], 0, 255).astype(np.float32),
        baseline=np.clip(baseline[~seen], 0, 255).astype(np.float32),
        **(_forces(case, seconds, values, seen) if isinstance(load, Walk) else {}),
    )


def _recalibrated(pressure: np.ndarray, values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(n, 28, 12) bytes of the best cubic of each taxel, fitted to the part seen."""
    out = np.empty(values.shape)
    for t in range(28):
        for k in range(12):
            powers = np.vander(pressure[:, t, k], 4)
            out[:, t, k] = powers @ np.linalg.lstsq(powers[seen], values[seen, t, k].astype(float), rcond=None)[0]
    return out


def _forces(case: Case, seconds: np.ndarray, values: np.ndarray, seen: np.ndarray) -> dict[str, np.ndarray]:
    """Over the continuation, N: the true f_z, what a static model recalibrated on the part seen makes of the bytes, and
    what it would make of them had nothing been concealed: the oracle."""
    rng = case.rng
    true = np.interp(seconds, case.load.seconds, Wrench(case.load, case.at_mm).courses[:, 0])
    clean = case.believed_chain.mean_byte(np.repeat(seconds[:, None], 28, 1))
    innocent = digitise(rng, clean, np.ones_like(clean), case.sensors, np.zeros(28, np.int64))
    out = {"t_s": case.epoch_s + seconds[~seen], "fz_n": true[~seen]}
    for name, bytes_ in (("static_fz_n", values), ("oracle_fz_n", innocent)):
        features = force_features(case.sensors, bytes_.astype(float))
        out[name] = features[~seen] @ np.linalg.lstsq(features[seen], true[seen], rcond=None)[0]
    return out


def truth(case: Case) -> dict[str, Any]:
    """What is sealed."""
    g = case.geometry

    def taxels(mask: np.ndarray) -> list[list[int]]:
        return [[int(g.address[t]), int(g.slot[t]), int(k)] for t, k in np.argwhere(mask)]

    every = np.zeros((28, 12), bool)
    every[:, PRESSURE_TAXELS] = True
    effects = []
    for e in case.effects:
        effects.append(
            {
                "effect": e.word,
                "law": e.law,
                "where": e.where,
                "taxels": [] if e.word == "clock" else taxels(e.place),
                "k_floor": round(case.k[e.word], 4) if e.word in case.k else None,
                "parameters": parameters(e)
                | ({"shift": [float(case.sensors.shift + e.shape["step"])]} if e.word == "bit_shift" else {})
                | ({"step_pa": [e.amplitude * case.load.span_pa]} if e.word == "snap" else {}),
                "amplitude_fraction": case.amplitude_fraction.get(e.word),
                "shape": e.shape,
            }
        )
    for f in case.faults:
        effects.append(
            {
                "effect": f.word,
                "law": f.shape.get("kind", f.word),
                "where": f.where,
                "taxels": taxels(f.place),
                "k_floor": None,
                "parameters": {},
                "when_s": f.when_s,
            }
        )
    return {
        "suite": case.spec.suite,
        "kind": case.spec.kind,
        "k_asked": case.spec.k,
        "variant": case.spec.variant,
        "foot": g.foot,
        "taxels": taxels(every),
        "effects": effects,
        "equivalent": list(EQUIVALENT[case.spec.variant]) if case.spec.kind == "undecidable" else [],
        "also_right": ["noise_burst"] if case.spec.variant == "load_noise" else [],
        "protocol": case.load.protocol,
        "span_pa": case.load.span_pa,
        "own_clock": case.own_clock,
        "offset_s": case.offset_s,
        "rate": case.rate,
        "simulated": case.simulated,
        "main_s": case.load.main_s,
    }
