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


def predictor(named: str) -> Predictor:
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
