"""The folders: what the tool is given, and what is kept back with the truth."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .boards import Readings, Sent, Timing, fix_times, fresh_noise, readings, rows_of, write_candump
from .calibration_file import document
from .case import Case, parameters
from .faults import break_frames, break_reference, burst_factor, kill
from .geometry import PRESSURE_TAXELS
from .plan import EQUIVALENT
from .ranges import draw
from .sensor import digitise
from .signal_path import Signal, s_step
from .trial import arms

_PRESSURE_COLUMNS = np.array([12 * t + k for t in range(28) for k in PRESSURE_TAXELS])
_SIMULATION_NOISE = 0.35  # count: dithers the rounding
_HOST_S = 0.02  # a host publishes every 20 ms
_KEPT_S = 0.02  # rows of what is kept back


def _recording(case: Case, counts: str, periods: tuple[int, ...], reference: bool) -> str:
    addresses = [int(case.geometry.address[case.geometry.board == b][0]) for b in range(3)]
    boards = [
        {
            "address": address,
            "interface": "can0",
            "period_ms": period,
            "shift": case.sensors.shift,
            "no_load": case.sensors.no_load,
            "skin_type": 0,
        }
        for address, period in zip(addresses, periods, strict=True)
    ]
    kind = {"chamber": "chamber", "walk": "shoe"}[case.trial.kind] if reference else "free"
    found: dict[str, Any] = {
        "format": "insole-recording/1",
        "kind": kind,
        counts.split(".")[0]: counts,
        "can_origin": "simulated",
        "insoles": [
            {"foot": case.geometry.foot, "layout": "layout.yaml", "calibration": "calibration.json", "boards": boards}
        ],
    }
    if reference:
        clock = "own" if case.clock.declared == "own" else "can"
        found["reference"] = [{"foot": case.geometry.foot, "file": "reference.csv", "clock": clock}]
    return yaml.safe_dump(found, sort_keys=False)


def _frame(folder: Path, case: Case, counts: str, periods: tuple[int, ...], reference: bool) -> None:
    folder.mkdir(parents=True)
    (folder / "recording.yaml").write_text(_recording(case, counts, periods, reference))
    (folder / "layout.yaml").write_text(case.geometry.document())
    (folder / "calibration.json").write_text(document(case.geometry, *case.curves))


def _write_reference(folder: Path, case: Case, rng: np.random.Generator, until_s: float, faults: bool) -> None:
    """`reference.csv`: the instrument's readings on its own clock, on the CAN clock, or without times."""
    trial, clock = case.trial, case.clock
    if clock.declared == "none":
        period = case.timing.period_ms[0] / 1e3
        rows = np.arange(int((clock.offset_s + (1 + clock.rate) * until_s) / period))
        true_s = clock.true_seconds(period * rows)
    else:
        period = (
            draw(rng, "walking", "shoe_period_s") if trial.kind == "walk" else draw(rng, "chamber", "gauge_period_s")
        )
        # Nobody starts two instruments at the same moment.
        true_s = np.arange(rng.uniform(0, 1.5), until_s, period)
    felt_s = true_s + rng.normal(0, 5e-5, len(true_s))
    broken = case.faults if faults else ()
    if trial.kind == "walk":
        columns = "fz_n,mx_nm,my_nm"
        wrench = trial.at(trial.wrench(case.at_mm), felt_s)
        span = float(np.quantile(wrench[:, 0], 0.99))
        wrench = wrench + case.reference_noise * rng.standard_normal(wrench.shape)
        wrench[:, 0] = break_reference(rng, broken, true_s, wrench[:, 0], span)
        text = [f"{f:.2f},{x:.4f},{y:.4f}" for f, x, y in wrench.tolist()]
    else:
        columns = "pressure_pa"
        pressure = trial.at(trial.courses[:, 0], felt_s) + case.reference_noise * rng.standard_normal(len(felt_s))
        pressure = break_reference(rng, broken, true_s, pressure, trial.span_pa)
        text = [f"{p:.0f}" for p in (np.round(pressure / 20) * 20).tolist()]
    temperature = trial.at(trial.temperature_c, felt_s) + 0.02 * rng.standard_normal(len(felt_s))
    if clock.declared == "none":
        lines = [f"{columns},temperature_c", *(f"{v},{c:.2f}" for v, c in zip(text, temperature.tolist(), strict=True))]
    else:
        reading = clock.offset_s + (1 + clock.rate) * true_s + (0 if clock.declared == "own" else case.epoch_s)
        rows_ = zip(reading.tolist(), text, temperature.tolist(), strict=True)
        lines = [f"time_s,{columns},temperature_c", *(f"{t:.6f},{values},{c:.2f}" for t, values, c in rows_)]
    (folder / "reference.csv").write_text("\n".join(lines) + "\n")


def _steps(case: Case) -> np.ndarray:
    """(28,) how much the digitiser's real shift is more than the declared one."""
    step = np.zeros(28, np.int64)
    for effect in case.effects:
        if effect.word == "bit_shift":
            step[effect.place.any(1)] = s_step(effect)
    return step


def _pick(triangle: int) -> slice:
    return slice(12 * triangle, 12 * triangle + 12)


def _sent(case: Case, rng: np.random.Generator, board: Readings) -> Sent:
    """What one board of the real insole sends."""
    n, m = board.sent_s.shape
    mean, factor = np.empty((n, m, 12), np.float32), np.empty((n, m, 12), np.float32)
    for j, triangle in enumerate(board.triangles):
        mean[:, j] = case.signal.mean(board.converted_s[:, j], _pick(triangle))
        factor[:, j] = case.signal.noise_factor(board.converted_s[:, j], _pick(triangle))
    noise = fresh_noise(rng, board) * case.sensors.noise[board.triangles] * factor * burst_factor(case.faults, board)
    noise[..., [6, 10]] *= 0.5
    values = digitise(mean, noise, case.sensors, _steps(case)[board.triangles])
    return break_frames(rng, case.faults, board, values, case.sensors.no_load)


def write_case(folder: Path, case: Case) -> None:
    """`folder`/recording, and `folder`/simulation where the load is known from one."""
    rng, until = case.rng, case.trial.main_s
    sent = [_sent(case, rng, b) for b in readings(rng, case.geometry, case.timing, until)]
    recording, reference = folder / "recording", case.simulation is None
    counts = "counts.npz" if case.rows else "can.log.gz"
    _frame(recording, case, counts, case.timing.period_ms, reference)
    if case.rows:
        seconds, values = rows_of(sent, _HOST_S, until)
        np.savez(recording / counts, t_s=case.epoch_s + seconds, counts=values)
    else:
        write_candump(recording / counts, case.geometry, sent, case.epoch_s, case.timing.b_first)
    if reference:
        _write_reference(recording, case, rng, until, faults=True)
    else:
        write_simulation(folder / "simulation", case, rng, case.simulation.end_s if case.simulation else until)
    fix_times(folder)


def _believed_counts(case: Case, pressure: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(n, n_columns) counts that the calibration handed out makes of pressures (n, n_columns)."""
    baselines, coefficients = (x.reshape(336, -1) for x in case.curves)
    activation = np.linspace(-20, 255, 1200)
    out = np.empty(pressure.shape, np.float32)
    for c, column in enumerate(columns):
        if column % 12 in PRESSURE_TAXELS:
            table = np.maximum.accumulate(np.polyval(coefficients[column][::-1], activation))
            out[:, c] = baselines[column] - np.interp(pressure[:, c], table, activation)
        else:
            out[:, c] = case.sensors.no_load
    return out


def write_simulation(folder: Path, case: Case, rng: np.random.Generator, until_s: float) -> None:
    """What sensors as believed say under the load as a simulation believes it, on a clock of its own."""
    assert case.simulation is not None
    sim, flat = case.simulation, case.geometry.taxel_mm.reshape(-1, 2)
    load = sim.trial.pressure(flat)
    sent = []
    for b in readings(rng, case.geometry, Timing((20, 20, 20), 0.0, False), until_s - sim.begin_s):
        values = np.empty((*b.sent_s.shape, 12), np.uint8)
        for j, triangle in enumerate(b.triangles):
            own = b.sent_s[:, j] + sim.begin_s
            pressure = sim.trial.at(load[:, _pick(triangle)], own)
            counts = _believed_counts(case, pressure, np.arange(336)[_pick(triangle)])
            counts = counts + _SIMULATION_NOISE * rng.standard_normal(counts.shape)
            values[:, j] = np.clip(np.rint(counts), 0, 255)
        own_s = sim.offset_s + (1 + sim.rate) * (b.sent_s + sim.begin_s)
        own_board = Readings(b.triangles, own_s, b.conversion, own_s)
        whole = np.ones((*values.shape[:2], 2), bool)
        sent.append(Sent(own_board, values, np.zeros(values.shape[:2], np.uint8), whole))
    _frame(folder, case, "can.log.gz", (20, 20, 20), reference=False)
    write_candump(folder / "can.log.gz", case.geometry, sent, case.epoch_s, b_first=False)


def write_kept_back(folder: Path, case: Case) -> None:
    """The whole trial with its continuation as a recording (`counts.npz`), and `scoring.npz` beside it.

    Every taxel is read at the row's time, nothing is lost or noisy. `scoring.npz` says which rows the tool has not
    seen, which taxels are usable, and what three models make of those rows: the calibration handed out, the true
    physics (counts: the true mean), and for a shoe the same insole with nothing concealed.
    """
    rng, trial = case.rng, case.trial
    seconds = np.arange(_KEPT_S, trial.end_s - 0.1, _KEPT_S)
    mean = np.stack([case.signal.mean(seconds, _pick(t)) for t in range(28)], 1)
    factor = np.stack([case.signal.noise_factor(seconds, _pick(t)) for t in range(28)], 1)
    noise = rng.standard_normal(mean.shape, np.float32) * case.sensors.noise * factor
    values = digitise(mean, noise, case.sensors, _steps(case))
    usable = np.zeros((28, 12), bool)
    usable[:, PRESSURE_TAXELS] = True
    for f in case.faults:
        if f.word == "dead_taxels":
            usable &= ~f.place
            kill(f, values, np.arange(28), case.sensors.no_load)
    kept = seconds >= trial.main_s
    recording, reference = folder / "recording", case.simulation is None
    _frame(recording, case, "counts.npz", (20, 20, 20), reference)
    np.savez(recording / "counts.npz", t_s=case.epoch_s + seconds, counts=values)
    scoring: dict[str, np.ndarray] = {"untouched": kept, "usable": usable}
    if case.simulation is not None:
        write_simulation(folder / "simulation", case, rng, trial.end_s)
    else:
        _write_reference(recording, case, rng, trial.end_s, faults=False)
    if trial.kind == "walk" and case.simulation is None:
        scoring |= _forces(case, rng, seconds, values, kept)
    else:
        believed = case.simulation.trial if case.simulation else trial
        flat = case.geometry.taxel_mm.reshape(-1, 2)
        pressure = (
            believed.pressure(flat) if believed.kind == "walk" else np.repeat(believed.pressure(flat[:1]), 336, 1)
        )
        handed = _believed_counts(case, trial.at(pressure, seconds[kept]), np.arange(336))
        oracle = mean[kept]
        if case.simulation is not None:
            knows = Signal(believed, case.at_mm, case.sensors, case.effects, np.arange(336))
            oracle = np.stack([knows.mean(seconds[kept], _pick(t)) for t in range(28)], 1)
        scoring["oracle"] = np.clip(oracle, 0, 255).astype(np.float32)
        scoring["handed_out"] = np.clip(handed.reshape(-1, 28, 12), 0, 255).astype(np.float32)
    np.savez_compressed(folder / "scoring.npz", **scoring)


def _forces(
    case: Case, rng: np.random.Generator, seconds: np.ndarray, values: np.ndarray, kept: np.ndarray
) -> dict[str, np.ndarray]:
    """Over the continuation, N: the true f_z, what the calibration handed out makes of the bytes, and what it would
    make of them had nothing been concealed."""
    true = case.trial.at(case.trial.wrench(case.at_mm), seconds[kept])[:, 0]
    clean = np.stack([case.clean.mean(seconds[kept], _pick(t)) for t in range(28)], 1)
    noise = rng.standard_normal(clean.shape, np.float32) * case.sensors.noise
    innocent = digitise(clean, noise, case.sensors, np.zeros(28, np.int64))
    baselines, coefficients = (x.reshape(336, -1) for x in case.curves)
    area = arms(np.zeros((1, 2)))[0, 0]
    out = {"t_s": case.epoch_s + seconds[kept], "fz_n": true}
    for name, counts in (("static_fz_n", values[kept]), ("oracle_fz_n", innocent)):
        force = np.zeros(len(true))
        for column in _PRESSURE_COLUMNS:
            a = baselines[column] - counts.reshape(-1, 336)[:, column].astype(float)
            force += area * np.polyval(coefficients[column][::-1], a)
        out[name] = force
    return out


def truth(case: Case) -> dict[str, Any]:
    """What is sealed."""
    g = case.geometry

    def names(mask: np.ndarray) -> list[list[int]]:
        return [[int(g.address[t]), int(g.slot[t]), int(k)] for t, k in np.argwhere(mask)]

    every = np.zeros((28, 12), bool)
    every[:, PRESSURE_TAXELS] = True
    effects = [
        {
            "effect": e.word,
            "law": e.law,
            "where": e.where,
            "taxels": [] if e.word == "clock" else names(e.place),
            "k_floor": round(case.k[e.word], 4),
            "accept": case.accept[e.word],
            "parameters": parameters(case, e),
            "amplitude_fraction": case.amplitude_fraction.get(e.word),
            "shape": {k: v for k, v in e.shape.items() if k != "departure"},
        }
        for e in case.effects
    ]
    effects += [
        {
            "effect": f.word,
            "law": f.shape.get("kind", f.word),
            "where": f.where,
            "taxels": names(f.place),
            "k_floor": None,
            "accept": case.accept[f.word],
            "parameters": {},
            "amplitude_fraction": None,
            "when_s": f.when_s,
        }
        for f in case.faults
    ]
    slow = case.timing.conversion_s > 0
    sim = case.simulation
    return {
        "kind": case.spec.kind,
        "recording": case.spec.recording,
        "against": case.spec.against,
        "k_asked": case.spec.k,
        "variant": case.spec.variant,
        "local": case.spec.local,
        "foot": g.foot,
        "taxels": names(every),
        "effects": effects,
        "equivalent": list(EQUIVALENT[case.spec.variant]) if case.spec.kind == "undecidable" else [],
        # Readings that are up to a conversion old look like these.
        "tolerated": ["lag", "delay", "clock", "frame_loss"] if slow else [],
        "protocol": case.trial.protocol,
        "span_pa": case.trial.span_pa,
        "main_s": case.trial.main_s,
        "clock": {"declared": case.clock.declared, "offset_s": case.clock.offset_s, "rate": case.clock.rate},
        "period_ms": list(case.timing.period_ms),
        "conversion_s": case.timing.conversion_s,
        "rows": case.rows,
        "memory_in_calibration": case.memory_in_calibration,
        "simulation": None if sim is None else {"level": sim.level, "begin_s": sim.begin_s, "end_s": sim.end_s},
    }
