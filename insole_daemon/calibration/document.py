"""A calibration as a file: `insole-calibration/1`, with what is known of its quality as documented extensions.

| extension | where | says |
|---|---|---|
| `coefficients_covariance_pa2` | taxel | covariance of its coefficients |
| `valid_range` | taxel | `{activation_count: [0, highest]}`, where its curve was seen |
| `residual_std_pa` | taxel | standard deviation of what the curve leaves of the chamber's pressure |
| `wrench_residual_std` | file | the same of the shoe's `f_z_n`, `m_x_nm`, `m_y_nm` |
| `verdict` | file | taxels and triangles that are not healthy: which, in what recording, since when |
| `left_out` | file | pressure taxels without a curve, and why |
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
from ..physics.calibration import COVARIANCE, FORMAT, VALID_RANGE
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from .calibrating import Calibrated
from .verdict import Verdict, of_triangle

_DIGITS = 10  # of a coefficient


def calibration_document(calibrated: Calibrated) -> dict[str, Any]:
    """The file's content, as plain maps, lists and numbers."""
    fit, layout = calibrated.fit, calibrated.layout
    taxels = []
    for at, slot in enumerate(calibrated.slots.tolist()):
        extensions: dict[str, Any] = {
            COVARIANCE: [[_short(value) for value in row] for row in fit.covariance_pa2[at].tolist()],
            VALID_RANGE: {"activation_count": [0.0, round(float(calibrated.highest_count[at]), 2)]},
        }
        if math.isfinite(fit.residual_pa[at]):
            extensions["residual_std_pa"] = round(float(fit.residual_pa[at]), 1)
        taxels.append(
            {
                **_named(calibrated, slot),
                "baseline_count": round(float(calibrated.rest_count[slot]), 4),
                "coefficients_pa": [_short(value) for value in fit.coefficients_pa[at].tolist()],
                "extensions": extensions,
            }
        )
    extensions = {
        "verdict": _verdicts(calibrated),
        "left_out": [{**_named(calibrated, slot), "why": why} for slot, why in sorted(calibrated.left_out.items())],
    }
    if np.isfinite(fit.residual_wrench).all():
        names = ("f_z_n", "m_x_nm", "m_y_nm")
        extensions["wrench_residual_std"] = {
            n: _short(v) for n, v in zip(names, fit.residual_wrench.tolist(), strict=True)
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
    """Write the file, all or nothing; FileError where it cannot be written."""
    try:
        write_text(path, json.dumps(calibration_document(calibrated), indent=1) + "\n")
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror or error}") from error


def provenance(calibrated: Calibrated) -> dict[str, Any]:
    """What the curves come from, and how they were found."""
    fit, layout = calibrated.fit, calibrated.layout
    shoe = any(each.trial.kind == "shoe" for each in calibrated.samples)
    return {
        "made_by": f"insole calibrate, insole-daemon {__version__}",
        "method": calibrated.method,
        "degree": fit.degree,
        "penalty": fit.penalty,
        "weights": {"f_z_1_n2": _short(fit.weights.shoe[0]), "m_x_1_nm2": _short(fit.weights.shoe[1]),
                    "m_y_1_nm2": _short(fit.weights.shoe[2]),
                    "pressure_1_pa2": _short(float(np.median(fit.weights.chamber)))},
        "kkt_residual": _short(fit.solution.kkt),
        "active_constraints": fit.solution.active,
        "taxel_area_m2": _short(layout.taxel_area_m2),
        "area_meaning": layout.area_meaning,
        "area_from": "the layout; the shoe's force fits the curves to it" if shoe else
        "the layout: without a shoe, a force is the pressure times that area, and nothing has checked it",
        "recordings": [
            {
                "name": each.trial.name,
                "kind": each.trial.kind,
                "cycles": len(each.trial.t_s),
                "fitted": len(each.t_s),
                "clock": {
                    "offset_s": round(each.clock.offset_s, 5),
                    "offset_std_s": round(each.clock.offset_std_s, 5),
                    "rate": _short(each.clock.rate),
                    "rate_std": _short(each.clock.rate_std),
                },
            }
            for each in calibrated.samples
        ],
    }  # fmt: skip


def _verdicts(calibrated: Calibrated) -> list[dict[str, Any]]:
    """Of triangles first, then of taxels; healthy ones are left out."""
    found = []
    for row, triangle in enumerate(calibrated.layout.triangles):
        verdict = of_triangle([calibrated.verdicts[row * N_TAXELS + int(t)] for t in np.flatnonzero(PRESSURE_TAXELS)])
        if verdict.word != "healthy":
            found.append({"board": triangle.board, "triangle": triangle.triangle, **_said(verdict)})
    for slot, verdict in sorted(calibrated.verdicts.items()):
        if verdict.word != "healthy":
            found.append({**_named(calibrated, slot), **_said(verdict)})
    return found


def _said(verdict: Verdict) -> dict[str, Any]:
    since_s = None if verdict.since_s is None else round(verdict.since_s, 2)
    return {"verdict": verdict.word, "recording": verdict.recording, "since_s": since_s, "detail": verdict.detail}


def _named(calibrated: Calibrated, slot: int) -> dict[str, int]:
    triangle = calibrated.layout.triangles[slot // N_TAXELS]
    return {"board": triangle.board, "triangle": triangle.triangle, "taxel": slot % N_TAXELS}


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
