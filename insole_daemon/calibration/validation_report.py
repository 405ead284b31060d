"""The page of a validation: its tables, every figure defined, and what insole and reference said."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..physics.calibration import Calibration
from ..report import page
from ..report.insole_map import value_map
from ..report.plot import Plot, axis
from .validation import DEFINITIONS, ChamberResult, Result, ShoeResult
from .validation_rows import CHAMBER_COLUMNS, SHOE_COLUMNS, chamber_rows, shoe_rows


def html(results: Sequence[Result], calibration: Calibration, name: str) -> str:
    """The whole page; `name` of the calibration's file."""
    shoe = [each for each in results if isinstance(each.outcome, ShoeResult)]
    chamber = [each for each in results if isinstance(each.outcome, ChamberResult)]
    parts = []
    if shoe:
        parts.append(page.section("Force shoe", page.table(SHOE_COLUMNS, shoe_rows(shoe))))
    if chamber:
        parts.append(page.section("Chamber", page.table(CHAMBER_COLUMNS, chamber_rows(chamber))))
    parts += [page.section(each.trial.name, *_figures(each, calibration)) for each in results]
    parts.append(page.section("What the figures mean", page.definitions(DEFINITIONS)))
    beyond = max(each.extrapolated for each in results)
    lead = f"By {name}. At most {beyond:.0%} of a recording's cycles go beyond what a curve was fitted to."
    return page.page(f"Validation of the {results[0].trial.foot.foot} insole", lead, parts)


def _figures(result: Result, calibration: Calibration) -> list[str]:
    trial, own, said = result.trial, result.estimate, result.reference
    time = axis("time, s", trial.t_s)
    if isinstance(result.outcome, ChamberResult):
        plot = Plot(time, axis("mean pressure, kPa", own / 1e3, said / 1e3), height=220)
        plot.line(trial.t_s, said[:, 0] / 1e3, 1, "reference")
        plot.line(trial.t_s, own[:, 0] / 1e3, 0, "insole")
        values = np.full(calibration.usable.size, np.nan)
        values[calibration.usable.ravel()] = result.outcome.rmse_pa / 1e3
        drawn = value_map(trial.layout, values, "kPa", "RMSE of every taxel")
        return [
            page.figure(plot.svg(f"{trial.name}: mean pressure"), "Mean of all valid taxels beside the chamber."),
            page.row(page.figure(drawn, "RMSE of every taxel that the calibration lists.")),
        ]
    parts = []
    for at, label in enumerate(("f_z, N", "m_x, N·m", "m_y, N·m")):
        plot = Plot(time, axis(label, own[:, at], said[:, at]), height=190)
        plot.line(trial.t_s, said[:, at], 1, "reference" if at == 0 else "")
        plot.line(trial.t_s, own[:, at], 0, "insole" if at == 0 else "")
        parts.append(plot.svg(f"{trial.name}: {label} of insole and reference"))
    return [page.figure("".join(parts), "Every cycle, unfiltered, at the clock that fits best.")]
