"""Compares a tool's model with the oracle on the sealed continuation of the trial."""

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .tables import GAIN_WORTH_SHARING

# predictor(model_json, recording, simulation or None) -> {foot: counts (n, 28, 12)} at the rows of counts.npz
Predictor = Callable[[Path, Path, Path | None], dict[str, np.ndarray]]
# compensator(model_json, recording) -> {foot: (t_s (m,), fz_n (m,))}, causal, t_s in the epoch of the recording
Compensator = Callable[[Path, Path], dict[str, tuple[np.ndarray, np.ndarray]]]


def import_function(reference: str) -> Any:
    """Import the function that `reference` names as module:function."""
    module, _, function = reference.partition(":")
    return getattr(importlib.import_module(module), function)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values, float) ** 2)))


def _compare_errors(static: float, oracle: float, model: Callable[[], float]) -> dict[str, Any]:
    """Errors of static calibration, oracle and the tool's model, and the share of the oracle's gain it recovers."""
    row: dict[str, Any] = {"static": static, "oracle": oracle, "model": None, "failure": None}
    try:
        row["model"] = model()
    except Exception as failure:  # the case is scored whatever error the tool's code raises
        row["failure"] = f"{type(failure).__name__}: {failure}"
        return row
    row["change"] = row["model"] / static - 1
    if static > GAIN_WORTH_SHARING * oracle:
        row["recovered"] = (static - row["model"]) / (static - oracle)
    return row


def compare_counts(kept_back: Path, foot: str, model: Path, predict: Predictor) -> dict[str, Any]:
    """Compare RMS errors in counts over the continuation, of all usable taxels."""
    with np.load(kept_back / "scoring.npz") as scoring, np.load(kept_back / "recording" / "counts.npz") as recording:
        untouched, usable = scoring["untouched"], scoring["usable"]
        counts = recording["counts"][untouched].astype(float)[:, usable]
        static, oracle = (_rms(scoring[name][:, usable] - counts) for name in ("handed_out", "oracle"))
    simulation = kept_back / "simulation"

    def model_error() -> float:
        json.loads(model.read_text())
        prediction = predict(model, kept_back / "recording", simulation if simulation.is_dir() else None)
        predicted = np.asarray(prediction[foot], float)[untouched][:, usable]
        is_finite = np.isfinite(predicted)
        if is_finite.mean() < 0.5 or (not is_finite.all() and not simulation.is_dir()):
            raise ValueError("the prediction holds values that are not finite")
        return _rms((predicted - counts)[is_finite])

    return _compare_errors(static, oracle, model_error)


def compare_force(kept_back: Path, foot: str, model: Path, compensate: Compensator) -> dict[str, Any]:
    """Compare RMS errors of f_z in N over the continuation; the oracle is the same insole with nothing concealed."""
    with np.load(kept_back / "scoring.npz") as scoring:
        t_s, true_n = scoring["t_s"], scoring["fz_n"]
        static, oracle = (_rms(scoring[f"{name}_fz_n"] - true_n) for name in ("static", "oracle"))

    def model_error() -> float:
        stated_s, force_n = (np.asarray(column, float) for column in compensate(model, kept_back / "recording")[foot])
        is_scored = (stated_s >= t_s[0]) & (stated_s <= t_s[-1])
        if is_scored.sum() < 0.9 * len(t_s) or not np.isfinite(force_n[is_scored]).all():
            raise ValueError(f"expected a finite f_z for each of {len(t_s)} rows, found {is_scored.sum()}")
        return _rms(force_n[is_scored] - np.interp(stated_s[is_scored], t_s, true_n))

    return _compare_errors(static, oracle, model_error)
