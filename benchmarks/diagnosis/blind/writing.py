"""Writes the folders of a case: those that the tool gets, and those that are sealed with the truth."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .boards import Readings, Sent, Timing, draw_conversion_noise, draw_readings, fix_times, host_rows, write_candump
from .calibration_file import document
from .case import Case
from .faults import break_frames, break_reference, burst_factor, set_dead_taxels
from .geometry import PRESSURE_TAXELS
from .ranges import draw
from .sensor import digitise
from .signal_path import Signal, extra_shift
from .trial import arms

_PRESSURE_COLUMNS = np.array([12 * t + k for t in range(28) for k in PRESSURE_TAXELS])
_SIMULATION_NOISE = 0.35  # count; it dithers the rounding
_HOST_PERIOD_S = 0.02  # a host publishes every 20 ms
_KEPT_BACK_PERIOD_S = 0.02  # period of the rows in sealed recordings


def _recording_yaml(case: Case, counts: str, periods: tuple[int, ...], has_reference: bool) -> str:
    """Text of `recording.yaml`, format `insole-recording/1`; `counts` is the file with the readings."""
    addresses = [int(case.geometry.address[case.geometry.board == board][0]) for board in range(3)]
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
    kind = {"chamber": "chamber", "walk": "shoe"}[case.trial.kind] if has_reference else "free"
    content: dict[str, Any] = {
        "format": "insole-recording/1",
        "kind": kind,
        counts.split(".")[0]: counts,
        "can_origin": "simulated",
        "insoles": [
            {"foot": case.geometry.foot, "layout": "layout.yaml", "calibration": "calibration.json", "boards": boards}
        ],
    }
    if has_reference:
        clock = "own" if case.clock.declared == "own" else "can"
        content["reference"] = [{"foot": case.geometry.foot, "file": "reference.csv", "clock": clock}]
    return yaml.safe_dump(content, sort_keys=False)


def _write_metadata(folder: Path, case: Case, counts: str, periods: tuple[int, ...], has_reference: bool) -> None:
    """Make the folder of a recording with `recording.yaml`, layout and calibration."""
    folder.mkdir(parents=True)
    (folder / "recording.yaml").write_text(_recording_yaml(case, counts, periods, has_reference))
    (folder / "layout.yaml").write_text(case.geometry.document())
    (folder / "calibration.json").write_text(document(case.geometry, *case.curves))


def _write_reference(folder: Path, case: Case, rng: np.random.Generator, until_s: float, with_faults: bool) -> None:
    """Write `reference.csv`: the instrument's readings on its own clock, on the CAN clock, or without times."""
    trial, clock = case.trial, case.clock
    if clock.declared == "none":
        period = case.timing.period_ms[0] / 1e3
        rows = np.arange(int((clock.offset_s + (1 + clock.rate) * until_s) / period))
        true_s = clock.true_seconds(period * rows)
    else:
        period = (
            draw(rng, "walking", "shoe_period_s") if trial.kind == "walk" else draw(rng, "chamber", "gauge_period_s")
        )
        # Two instruments never start at the same moment.
        true_s = np.arange(rng.uniform(0, 1.5), until_s, period)
    sampled_s = true_s + rng.normal(0, 5e-5, len(true_s))
    active_faults = case.faults if with_faults else ()
    if trial.kind == "walk":
        columns = "fz_n,mx_nm,my_nm"
        wrench = trial.at(trial.wrench(case.taxels_mm), sampled_s)
        span = float(np.quantile(wrench[:, 0], 0.99))
        wrench = wrench + case.reference_noise * rng.standard_normal(wrench.shape)
        wrench[:, 0] = break_reference(rng, active_faults, true_s, wrench[:, 0], span)
        texts = [f"{f_z:.2f},{m_x:.4f},{m_y:.4f}" for f_z, m_x, m_y in wrench.tolist()]
    else:
        columns = "pressure_pa"
        pressure = trial.at(trial.courses[:, 0], sampled_s) + case.reference_noise * rng.standard_normal(len(sampled_s))
        pressure = break_reference(rng, active_faults, true_s, pressure, trial.span_pa)
        texts = [f"{pascal:.0f}" for pascal in (np.round(pressure / 20) * 20).tolist()]
    temperature_c = trial.at(trial.temperature_c, sampled_s) + 0.02 * rng.standard_normal(len(sampled_s))
    if clock.declared == "none":
        lines = [
            f"{columns},temperature_c",
            *(f"{values},{temperature:.2f}" for values, temperature in zip(texts, temperature_c.tolist(), strict=True)),
        ]
    else:
        reading = clock.offset_s + (1 + clock.rate) * true_s + (0 if clock.declared == "own" else case.epoch_s)
        samples = zip(reading.tolist(), texts, temperature_c.tolist(), strict=True)
        lines = [
            f"time_s,{columns},temperature_c",
            *(f"{t_s:.6f},{values},{temperature:.2f}" for t_s, values, temperature in samples),
        ]
    (folder / "reference.csv").write_text("\n".join(lines) + "\n")


def _extra_shifts(case: Case) -> np.ndarray:
    """(28,) real shift of each triangle's board minus its declared shift."""
    extra = np.zeros(28, np.int64)
    for effect in case.effects:
        if effect.word == "bit_shift":
            extra[effect.place.any(1)] = extra_shift(effect)
    return extra


def _columns_of(triangle: int) -> slice:
    """Flat numbers of a triangle's taxels."""
    return slice(12 * triangle, 12 * triangle + 12)


def _send_board(case: Case, rng: np.random.Generator, board: Readings) -> Sent:
    """The values that one board of the real insole sends, with noise, effects and faults."""
    n, m = board.sent_s.shape
    mean, factor = np.empty((n, m, 12), np.float32), np.empty((n, m, 12), np.float32)
    for index, triangle in enumerate(board.triangles):
        mean[:, index] = case.signal.mean(board.converted_s[:, index], _columns_of(triangle))
        factor[:, index] = case.signal.noise_factor(board.converted_s[:, index], _columns_of(triangle))
    noise = (
        draw_conversion_noise(rng, board)
        * case.sensors.noise[board.triangles]
        * factor
        * burst_factor(case.faults, board)
    )
    noise[..., [6, 10]] *= 0.5
    values = digitise(mean, noise, case.sensors, _extra_shifts(case)[board.triangles])
    return break_frames(rng, case.faults, board, values, case.sensors.no_load)


def write_case(folder: Path, case: Case) -> None:
    """Write `folder`/recording, and `folder`/simulation if the case has one."""
    rng, until_s = case.rng, case.trial.main_s
    sent = [_send_board(case, rng, board) for board in draw_readings(rng, case.geometry, case.timing, until_s)]
    recording, has_reference = folder / "recording", case.simulation is None
    counts = "counts.npz" if case.rows else "can.log.gz"
    _write_metadata(recording, case, counts, case.timing.period_ms, has_reference)
    if case.rows:
        seconds, values = host_rows(sent, _HOST_PERIOD_S, until_s)
        np.savez(recording / counts, t_s=case.epoch_s + seconds, counts=values)
    else:
        write_candump(recording / counts, case.geometry, sent, case.epoch_s, case.timing.b_first)
    if has_reference:
        _write_reference(recording, case, rng, until_s, with_faults=True)
    else:
        write_simulation(folder / "simulation", case, rng, case.simulation.end_s if case.simulation else until_s)
    fix_times(folder)


def _calibrated_counts(case: Case, pressure: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Counts (n, n_columns) that belong to pressures (n, n_columns) by the calibration that is handed out."""
    baselines, coefficients = (array.reshape(336, -1) for array in case.curves)
    activation = np.linspace(-20, 255, 1200)
    counts = np.empty(pressure.shape, np.float32)
    for index, column in enumerate(columns):
        if column % 12 in PRESSURE_TAXELS:
            table = np.maximum.accumulate(np.polyval(coefficients[column][::-1], activation))
            counts[:, index] = baselines[column] - np.interp(pressure[:, index], table, activation)
        else:
            counts[:, index] = case.sensors.no_load
    return counts


def write_simulation(folder: Path, case: Case, rng: np.random.Generator, until_s: float) -> None:
    """Write the simulated recording: the handed-out calibration under the simulated load, on its own clock."""
    assert case.simulation is not None
    simulation, flat_mm = case.simulation, case.geometry.taxel_mm.reshape(-1, 2)
    load = simulation.trial.pressure(flat_mm)
    sent = []
    for board in draw_readings(rng, case.geometry, Timing((20, 20, 20), 0.0, False), until_s - simulation.begin_s):
        values = np.empty((*board.sent_s.shape, 12), np.uint8)
        for index, triangle in enumerate(board.triangles):
            true_s = board.sent_s[:, index] + simulation.begin_s
            pressure = simulation.trial.at(load[:, _columns_of(triangle)], true_s)
            counts = _calibrated_counts(case, pressure, np.arange(336)[_columns_of(triangle)])
            counts = counts + _SIMULATION_NOISE * rng.standard_normal(counts.shape)
            values[:, index] = np.clip(np.rint(counts), 0, 255)
        clock_s = simulation.offset_s + (1 + simulation.rate) * (board.sent_s + simulation.begin_s)
        timed = Readings(board.triangles, clock_s, board.conversion, clock_s)
        all_halves = np.ones((*values.shape[:2], 2), bool)
        sent.append(Sent(timed, values, np.zeros(values.shape[:2], np.uint8), all_halves))
    _write_metadata(folder, case, "can.log.gz", (20, 20, 20), has_reference=False)
    write_candump(folder / "can.log.gz", case.geometry, sent, case.epoch_s, b_first=False)


def write_kept_back(folder: Path, case: Case) -> None:
    """Write the whole trial with its continuation as a recording (`counts.npz`), and `scoring.npz`.

    Every taxel is read at the row's time; no frame is lost, and there are no noise bursts. `scoring.npz` holds which
    rows the tool has not seen, which taxels are usable, and the results of two models for those rows: the calibration
    that is handed out, and the oracle (counts: mean by the true physics; shoe: the insole with nothing concealed).
    """
    rng, trial = case.rng, case.trial
    seconds = np.arange(_KEPT_BACK_PERIOD_S, trial.end_s - 0.1, _KEPT_BACK_PERIOD_S)
    mean = np.stack([case.signal.mean(seconds, _columns_of(triangle)) for triangle in range(28)], 1)
    factor = np.stack([case.signal.noise_factor(seconds, _columns_of(triangle)) for triangle in range(28)], 1)
    noise = rng.standard_normal(mean.shape, np.float32) * case.sensors.noise * factor
    values = digitise(mean, noise, case.sensors, _extra_shifts(case))
    usable = np.zeros((28, 12), bool)
    usable[:, PRESSURE_TAXELS] = True
    for fault in case.faults:
        if fault.word == "dead_taxels":
            usable &= ~fault.place
            set_dead_taxels(fault, values, np.arange(28), case.sensors.no_load)
    is_unseen = seconds >= trial.main_s
    recording, has_reference = folder / "recording", case.simulation is None
    _write_metadata(recording, case, "counts.npz", (20, 20, 20), has_reference)
    np.savez(recording / "counts.npz", t_s=case.epoch_s + seconds, counts=values)
    scoring: dict[str, np.ndarray] = {"untouched": is_unseen, "usable": usable}
    if case.simulation is not None:
        write_simulation(folder / "simulation", case, rng, trial.end_s)
    else:
        _write_reference(recording, case, rng, trial.end_s, with_faults=False)
    if trial.kind == "walk" and case.simulation is None:
        scoring |= _forces(case, rng, seconds, values, is_unseen)
    else:
        load_trial = case.simulation.trial if case.simulation else trial
        flat_mm = case.geometry.taxel_mm.reshape(-1, 2)
        pressure = (
            load_trial.pressure(flat_mm)
            if load_trial.kind == "walk"
            else np.repeat(load_trial.pressure(flat_mm[:1]), 336, 1)
        )
        static_counts = _calibrated_counts(case, trial.at(pressure, seconds[is_unseen]), np.arange(336))
        oracle = mean[is_unseen]
        if case.simulation is not None:
            true_signal = Signal(load_trial, case.taxels_mm, case.sensors, case.effects, np.arange(336))
            oracle = np.stack(
                [true_signal.mean(seconds[is_unseen], _columns_of(triangle)) for triangle in range(28)], 1
            )
        scoring["oracle"] = np.clip(oracle, 0, 255).astype(np.float32)
        scoring["handed_out"] = np.clip(static_counts.reshape(-1, 28, 12), 0, 255).astype(np.float32)
    np.savez_compressed(folder / "scoring.npz", **scoring)


def _forces(
    case: Case, rng: np.random.Generator, seconds: np.ndarray, values: np.ndarray, is_unseen: np.ndarray
) -> dict[str, np.ndarray]:
    """f_z (n,) in N over the continuation: true, by the handed-out calibration, and the same with nothing concealed."""
    true_n = case.trial.at(case.trial.wrench(case.taxels_mm), seconds[is_unseen])[:, 0]
    clean_mean = np.stack([case.clean.mean(seconds[is_unseen], _columns_of(triangle)) for triangle in range(28)], 1)
    noise = rng.standard_normal(clean_mean.shape, np.float32) * case.sensors.noise
    clean_values = digitise(clean_mean, noise, case.sensors, np.zeros(28, np.int64))
    baselines, coefficients = (array.reshape(336, -1) for array in case.curves)
    area_m2 = arms(np.zeros((1, 2)))[0, 0]
    forces = {"t_s": case.epoch_s + seconds[is_unseen], "fz_n": true_n}
    for name, counts in (("static_fz_n", values[is_unseen]), ("oracle_fz_n", clean_values)):
        force_n = np.zeros(len(true_n))
        for column in _PRESSURE_COLUMNS:
            activation = baselines[column] - counts.reshape(-1, 336)[:, column].astype(float)
            force_n += area_m2 * np.polyval(coefficients[column][::-1], activation)
        forces[name] = force_n
    return forces
