"""What the model is worth on data nobody has fitted: the share of the oracle's gain it recovers."""

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

# predictor(model_json, recording, simulation or None) -> {foot: counts (n, 28, 12)} at the rows of counts.npz
Predictor = Callable[[Path, Path, Path | None], dict[str, np.ndarray]]
GAIN_WORTH_SHARING = 1.02  # the static model's error over the oracle's


# compensator(model_json, recording) -> {foot: (t_s (m,), fz_n (m,))}, causal, t_s in the epoch of the recording
Compensator = Callable[[Path, Path], dict[str, tuple[np.ndarray, np.ndarray]]]


def imported(named: str) -> Any:
    """The function called module:function."""
    module, _, function = named.partition(":")
    return getattr(importlib.import_module(module), function)


def compare(kept: Path, foot: str, model: Path, predict: Predictor) -> dict[str, Any]:
    """RMS errors over the continuation, all usable taxels: static (recalibrated), model, oracle (the true mean)."""
    with np.load(kept / "scoring.npz") as scoring, np.load(kept / "recording" / "counts.npz") as recording:
        untouched, usable = scoring["untouched"], scoring["usable"]
        counts = recording["counts"][untouched].astype(float)[:, usable]
        static = scoring["baseline"][:, usable]
        oracle = scoring["mean"][:, usable]

    def rms(of: np.ndarray) -> float:
        return float(np.sqrt(np.mean((of - counts) ** 2)))

    row: dict[str, Any] = {"static": rms(static), "oracle": rms(oracle), "model": None, "failure": None}
    simulation = kept / "simulation"
    try:
        json.loads(model.read_text())
        said = predict(model, kept / "recording", simulation if simulation.is_dir() else None)
        predicted = np.asarray(said[foot], float)[untouched][:, usable]
        if not np.isfinite(predicted).all():
            raise ValueError("the prediction holds values that are not finite")
        row["model"] = rms(predicted)
    except Exception as failure:  # whatever the tool's code does, the case is scored
        row["failure"] = f"{type(failure).__name__}: {failure}"
        return row
    row["change"] = row["model"] / row["static"] - 1
    if row["static"] > GAIN_WORTH_SHARING * row["oracle"]:
        row["recovered"] = (row["static"] - row["model"]) / (row["static"] - row["oracle"])
    return row


def compare_force(kept: Path, foot: str, model: Path, compensate: Compensator) -> dict[str, Any]:
    """RMS errors of f_z over the continuation, N: the calibration as handed in, static (recalibrated on the truth),
    compensated, oracle (nothing concealed)."""
    with np.load(kept / "scoring.npz") as scoring:
        t_s, true = scoring["t_s"], scoring["fz_n"]
        errors = {name: scoring[f"{name}_fz_n"] - true for name in ("static", "oracle")}
    row: dict[str, Any] = {name: float(np.sqrt(np.mean(e**2))) for name, e in errors.items()}
    row["failure"] = None

    def left(calibration: Path) -> float:
        when, said = (np.asarray(x, float) for x in compensate(calibration, kept / "recording")[foot])
        late = (when >= t_s[0]) & (when <= t_s[-1])
        if late.sum() < 0.9 * len(t_s) or not np.isfinite(said[late]).all():
            raise ValueError(f"expected a finite f_z for each of {len(t_s)} rows, found {late.sum()}")
        return float(np.sqrt(np.mean((said[late] - np.interp(when[late], t_s, true)) ** 2)))

    try:
        row["handed_in"], row["model"] = left(kept / "recording" / "calibration.json"), left(model)
    except Exception as failure:  # whatever the tool's code does, the case is scored
        row["failure"] = f"{type(failure).__name__}: {failure}"
        return row
    row["change"] = row["model"] / row["static"] - 1
    row["over_handed_in"] = row["model"] / row["handed_in"]
    row["over_oracle"] = row["model"] / row["oracle"]
    return row
