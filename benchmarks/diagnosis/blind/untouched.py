"""What the model is worth on the part of the trial that nobody has seen: the share of the oracle's gain it recovers."""

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


def imported(named: str) -> Any:
    """The function called module:function."""
    module, _, function = named.partition(":")
    return getattr(importlib.import_module(module), function)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values, float) ** 2)))


def _compared(static: float, oracle: float, model: Callable[[], float]) -> dict[str, Any]:
    """Errors of the calibration handed out, of the truth and of the tool's model, and the model's share of the gain."""
    row: dict[str, Any] = {"static": static, "oracle": oracle, "model": None, "failure": None}
    try:
        row["model"] = model()
    except Exception as failure:  # whatever the tool's code does, the case is scored
        row["failure"] = f"{type(failure).__name__}: {failure}"
        return row
    row["change"] = row["model"] / static - 1
    if static > GAIN_WORTH_SHARING * oracle:
        row["recovered"] = (static - row["model"]) / (static - oracle)
    return row


def compare(kept: Path, foot: str, model: Path, predict: Predictor) -> dict[str, Any]:
    """RMS errors in counts over the continuation, of all usable taxels."""
    with np.load(kept / "scoring.npz") as scoring, np.load(kept / "recording" / "counts.npz") as recording:
        untouched, usable = scoring["untouched"], scoring["usable"]
        counts = recording["counts"][untouched].astype(float)[:, usable]
        static, oracle = (_rms(scoring[name][:, usable] - counts) for name in ("handed_out", "oracle"))
    simulation = kept / "simulation"

    def left() -> float:
        json.loads(model.read_text())
        said = predict(model, kept / "recording", simulation if simulation.is_dir() else None)
        predicted = np.asarray(said[foot], float)[untouched][:, usable]
        known = np.isfinite(predicted)
        if known.mean() < 0.5 or (not known.all() and not simulation.is_dir()):
            raise ValueError("the prediction holds values that are not finite")
        return _rms((predicted - counts)[known])

    return _compared(static, oracle, left)


def compare_force(kept: Path, foot: str, model: Path, compensate: Compensator) -> dict[str, Any]:
    """RMS errors of f_z in N over the continuation; the oracle is the same insole with nothing concealed."""
    with np.load(kept / "scoring.npz") as scoring:
        t_s, true = scoring["t_s"], scoring["fz_n"]
        static, oracle = (_rms(scoring[f"{name}_fz_n"] - true) for name in ("static", "oracle"))

    def left() -> float:
        when, said = (np.asarray(x, float) for x in compensate(model, kept / "recording")[foot])
        late = (when >= t_s[0]) & (when <= t_s[-1])
        if late.sum() < 0.9 * len(t_s) or not np.isfinite(said[late]).all():
            raise ValueError(f"expected a finite f_z for each of {len(t_s)} rows, found {late.sum()}")
        return _rms(said[late] - np.interp(when[late], t_s, true))

    return _compared(static, oracle, left)
