"""Write a calibration file (`insole-calibration/1`) with information on its quality as extensions.

| extension | in | content |
|---|---|---|
| `coefficients_covariance_pa2` | taxel | covariance of its coefficients |
| `valid_range` | taxel | `{activation_count: [0, highest]}`, where its curve was fitted |
| `residual_std_pa` | taxel | standard deviation of the residual in the chamber |
| `wrench_residual_std` | file | the same for the shoe's `f_z_n`, `m_x_nm`, `m_y_nm` |
| `verdict` | file | taxels and triangles that are not healthy: which, in which recording, since when |
| `left_out` | file | pressure taxels without a curve, with the reason |
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import FileError
from ..files import write_text
from ..physics.calibration import COVARIANCE, FORMAT, valid_up_to
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from .calibrating import Calibrated
from .verdict import Verdict, judge_triangle

_DIGITS = 10  # significant digits of a coefficient


def calibration_document(calibrated: Calibrated) -> dict[str, Any]:
    """Return the file's content as plain maps, lists and numbers."""
    fit, layout = calibrated.fit, calibrated.layout
    taxels = []
    for row, slot in enumerate(calibrated.slots.tolist()):
        extensions: dict[str, Any] = {
            COVARIANCE: [[_rounded(value) for value in line] for line in fit.covariance_pa2[row].tolist()],
            **valid_up_to(float(calibrated.highest_count[row])),
        }
        if math.isfinite(fit.residual_pa[row]):
            extensions["residual_std_pa"] = round(float(fit.residual_pa[row]), 1)
        taxels.append(
            {
                **_taxel_identity(calibrated, slot),
                "baseline_count": round(float(calibrated.rest_count[slot]), 4),
                "coefficients_pa": [_rounded(value) for value in fit.coefficients_pa[row].tolist()],
                "extensions": extensions,
            }
        )
    extensions = {
        "verdict": _verdicts(calibrated),
        "left_out": [
            {**_taxel_identity(calibrated, slot), "why": why} for slot, why in sorted(calibrated.left_out.items())
        ],
    }
    if np.isfinite(fit.residual_wrench).all():
        names = ("f_z_n", "m_x_nm", "m_y_nm")
        extensions["wrench_residual_std"] = {
            n: _rounded(v) for n, v in zip(names, fit.residual_wrench.tolist(), strict=True)
        }
    return {
        "format": FORMAT,
        "foot": layout.foot,
        "taxels": taxels,
        "effects": [],
        "provenance": provenance(calibrated),
        "extensions": extensions,
    }


def save_calibration(calibrated: Calibrated, path: Path) -> None:
    """Write the file, all or nothing; FileError if it cannot be written."""
    try:
        write_text(path, json.dumps(calibration_document(calibrated), indent=1) + "\n")
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror or error}") from error


def provenance(calibrated: Calibrated) -> dict[str, Any]:
    """Return the data and method that the curves come from."""
    fit, layout = calibrated.fit, calibrated.layout
    shoe = any(trial_samples.trial.kind == "shoe" for trial_samples in calibrated.samples)
    return {
        "made_by": f"insole calibrate, insole-daemon {__version__}",
        "method": calibrated.method,
        "degree": fit.degree,
        "penalty": fit.penalty,
        "weights": {"f_z_1_n2": _rounded(fit.weights.shoe[0]), "m_x_1_nm2": _rounded(fit.weights.shoe[1]),
                    "m_y_1_nm2": _rounded(fit.weights.shoe[2]),
                    "pressure_1_pa2": _rounded(float(np.median(fit.weights.chamber)))},
        "kkt_residual": _rounded(fit.solution.kkt),
        "active_constraints": fit.solution.active,
        "taxel_area_m2": _rounded(layout.taxel_area_m2),
        "area_meaning": layout.area_meaning,
        "area_from": "the layout; the shoe's force fits the curves to it" if shoe else
        "the layout: without a shoe, a force is the pressure times that area, and nothing has checked it",
        "recordings": [
            {
                "name": trial_samples.trial.name,
                "kind": trial_samples.trial.kind,
                "cycles": len(trial_samples.trial.t_s),
                "fitted": len(trial_samples.t_s),
                "clock": {
                    "offset_s": round(trial_samples.clock.offset_s, 5),
                    "offset_std_s": round(trial_samples.clock.offset_std_s, 5),
                    "rate": _rounded(trial_samples.clock.rate),
                    "rate_std": _rounded(trial_samples.clock.rate_std),
                },
            }
            for trial_samples in calibrated.samples
        ],
    }  # fmt: skip


def _verdicts(calibrated: Calibrated) -> list[dict[str, Any]]:
    """Return the verdicts of triangles, then of taxels, without the healthy ones."""
    entries = []
    for row, triangle in enumerate(calibrated.layout.triangles):
        verdict = judge_triangle(
            [calibrated.verdicts[row * N_TAXELS + int(t)] for t in np.flatnonzero(PRESSURE_TAXELS)]
        )
        if verdict.word != "healthy":
            entries.append({"board": triangle.board, "triangle": triangle.triangle, **_verdict_entry(verdict)})
    for slot, verdict in sorted(calibrated.verdicts.items()):
        if verdict.word != "healthy":
            entries.append({**_taxel_identity(calibrated, slot), **_verdict_entry(verdict)})
    return entries


def _verdict_entry(verdict: Verdict) -> dict[str, Any]:
    since_s = None if verdict.since_s is None else round(verdict.since_s, 2)
    return {"verdict": verdict.word, "recording": verdict.recording, "since_s": since_s, "detail": verdict.detail}


def _taxel_identity(calibrated: Calibrated, slot: int) -> dict[str, int]:
    triangle = calibrated.layout.triangles[slot // N_TAXELS]
    return {"board": triangle.board, "triangle": triangle.triangle, "taxel": slot % N_TAXELS}


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
