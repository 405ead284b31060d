"""The page of a validation: its tables, every figure defined, and what insole and reference said."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..physics.calibration import Calibration
from ..report import page
from ..report.insole_map import value_map
from ..report.plot import Plot, axis
from .validation import FULL_DEFINITIONS, ChamberResult, Result, ShoeResult
from .validation_rows import CHAMBER_COLUMNS, SHOE_COLUMNS, chamber_rows, shoe_rows

LOADED_N, UNLOADED_S, STEP_S = 20.0, 0.2, 0.8  # of the step that is shown larger


def validation_page(results: Sequence[Result], calibration: Calibration, name: str) -> str:
    """The whole page; `name` of the calibration's file."""
    shoe = [each for each in results if isinstance(each.outcome, ShoeResult)]
    chamber = [each for each in results if isinstance(each.outcome, ChamberResult)]
    parts = []
    if shoe:
        parts.append(page.section("Force shoe", page.table(SHOE_COLUMNS, shoe_rows(shoe))))
    if chamber:
        parts.append(page.section("Chamber", page.table(CHAMBER_COLUMNS, chamber_rows(chamber))))
    parts += [page.section(each.title, *_figures(each, calibration)) for each in results]
    pairs = [(static, dynamic) for static, dynamic in pairwise(results) if dynamic.model == "dynamic"]
    strikes = [drawn for static, dynamic in pairs if (drawn := _heel_strike(static, dynamic)) is not None]
    if strikes:
        parts.append(page.section("A heel strike, before and after", *strikes))
    parts.append(page.section("What the figures mean", page.definitions(FULL_DEFINITIONS)))
    beyond = max(each.extrapolated for each in results)
    lead = f"By {name}. At most {beyond:.0%} of a recording's cycles go beyond what a curve was fitted to."
    foot = results[0].trial.foot.foot
    boards = (each.board for each in results[0].trial.layout.triangles)
    about = [page.insole_label(foot, boards), f"calibration {name}"]
    return page.page(f"Validation of the {foot} insole", lead, parts, about)


def _heel_strike(static: Result, dynamic: Result) -> str | None:
    """The step in the middle of a walk by both models, as the paper shows one; None where nobody walks."""
    force_n, t_s = np.nan_to_num(dynamic.reference[:, 0]), dynamic.trial.t_s
    loaded = force_n > LOADED_N
    strikes = np.flatnonzero(loaded[1:] & ~loaded[:-1]) + 1
    before = np.searchsorted(t_s, t_s[strikes] - UNLOADED_S)
    strikes = strikes[[not loaded[first:at].any() for first, at in zip(before, strikes, strict=True)]]
    if isinstance(dynamic.outcome, ChamberResult) or not len(strikes):
        return None
    moment_s = t_s[strikes[len(strikes) // 2]]
    # Both at the reference's time, each by its own clock.
    own_s = t_s - moment_s
    static_s = own_s + static.clock.offset_s - dynamic.clock.offset_s
    shown = (own_s > -UNLOADED_S) & (own_s < STEP_S)
    static_shown = (static_s > -UNLOADED_S) & (static_s < STEP_S)
    values = (dynamic.reference[shown, 0], dynamic.estimate[shown, 0], static.estimate[static_shown, 0])
    plot = Plot(axis("time from the heel's strike, s", own_s[shown]), axis("f_z, N", *values), height=260)
    plot.line(own_s[shown], values[0], 1, "reference")
    plot.line(static_s[static_shown], values[2], 2, "static")
    plot.line(own_s[shown], values[1], 0, "dynamic")
    name = dynamic.trial.name
    return page.figure(plot.svg(f"{name}: a heel strike"), f"{name}, from {moment_s:.1f} s on; each at its best clock.")


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
            page.figure(plot.svg(f"{result.title}: mean pressure"), "Mean of all valid taxels beside the chamber."),
            page.row(page.figure(drawn, "RMSE of every taxel that the calibration lists.")),
        ]
    parts = []
    for at, label in enumerate(("f_z, N", "m_x, N·m", "m_y, N·m")):
        plot = Plot(time, axis(label, own[:, at], said[:, at]), height=190)
        plot.line(trial.t_s, said[:, at], 1, "reference" if at == 0 else "")
        plot.line(trial.t_s, own[:, at], 0, "insole" if at == 0 else "")
        parts.append(plot.svg(f"{result.title}: {label} of insole and reference"))
    return [page.figure("".join(parts), "Every cycle, unfiltered, at the clock that fits best.")]
