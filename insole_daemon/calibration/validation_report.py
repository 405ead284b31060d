"""Render the HTML report of a validation: tables, definitions, and courses of insole and reference."""

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

LOADED_N, UNLOADED_S, STEP_S = 20.0, 0.2, 0.8  # of the enlarged heel strike


def validation_page(results: Sequence[Result], calibration: Calibration, name: str) -> str:
    """Return the HTML page; `name` is the calibration's file."""
    shoe = [result for result in results if isinstance(result.outcome, ShoeResult)]
    chamber = [result for result in results if isinstance(result.outcome, ChamberResult)]
    sections = []
    if shoe:
        sections.append(page.section("Force shoe", page.table(SHOE_COLUMNS, shoe_rows(shoe))))
    if chamber:
        sections.append(page.section("Chamber", page.table(CHAMBER_COLUMNS, chamber_rows(chamber))))
    sections += [page.section(result.title, *_draw_figures(result, calibration)) for result in results]
    pairs = [(static, dynamic) for static, dynamic in pairwise(results) if dynamic.model == "dynamic"]
    strikes = [drawing for static, dynamic in pairs if (drawing := _draw_heel_strike(static, dynamic)) is not None]
    if strikes:
        sections.append(page.section("A heel strike, before and after", *strikes))
    sections.append(page.section("What the figures mean", page.definitions(FULL_DEFINITIONS)))
    beyond = max(result.extrapolated for result in results)
    lead = f"By {name}. At most {beyond:.0%} of a recording's cycles are outside the fitted range of a curve."
    foot = results[0].trial.foot.foot
    boards = (result.board for result in results[0].trial.layout.triangles)
    about = [page.insole_label(foot, boards), f"calibration {name}"]
    return page.page(f"Validation of the {foot} insole", lead, sections, about)


def _draw_heel_strike(static: Result, dynamic: Result) -> str | None:
    """Return the step in the middle of a walk by both models, or None if nobody walks."""
    force_n, t_s = np.nan_to_num(dynamic.reference[:, 0]), dynamic.trial.t_s
    loaded = force_n > LOADED_N
    strikes = np.flatnonzero(loaded[1:] & ~loaded[:-1]) + 1
    before = np.searchsorted(t_s, t_s[strikes] - UNLOADED_S)
    strikes = strikes[[not loaded[first:strike].any() for first, strike in zip(before, strikes, strict=True)]]
    if isinstance(dynamic.outcome, ChamberResult) or not len(strikes):
        return None
    moment_s = t_s[strikes[len(strikes) // 2]]
    # Both are plotted over the reference's time, each with its own clock.
    dynamic_s = t_s - moment_s
    static_s = dynamic_s + static.clock.offset_s - dynamic.clock.offset_s
    shown = (dynamic_s > -UNLOADED_S) & (dynamic_s < STEP_S)
    static_shown = (static_s > -UNLOADED_S) & (static_s < STEP_S)
    values = (dynamic.reference[shown, 0], dynamic.estimate[shown, 0], static.estimate[static_shown, 0])
    plot = Plot(axis("time from the heel's strike, s", dynamic_s[shown]), axis("f_z, N", *values), height=260)
    plot.line(dynamic_s[shown], values[0], 1, "reference")
    plot.line(static_s[static_shown], values[2], 2, "static")
    plot.line(dynamic_s[shown], values[1], 0, "dynamic")
    name = dynamic.trial.name
    return page.figure(plot.svg(f"{name}: a heel strike"), f"{name}, from {moment_s:.1f} s on; each at its best clock.")


def _draw_figures(result: Result, calibration: Calibration) -> list[str]:
    """Draw the courses of insole and reference for one result."""
    trial, estimated, reference = result.trial, result.estimate, result.reference
    time = axis("time, s", trial.t_s)
    if isinstance(result.outcome, ChamberResult):
        plot = Plot(time, axis("mean pressure, kPa", estimated / 1e3, reference / 1e3), height=220)
        plot.line(trial.t_s, reference[:, 0] / 1e3, 1, "reference")
        plot.line(trial.t_s, estimated[:, 0] / 1e3, 0, "insole")
        values = np.full(calibration.usable.size, np.nan)
        values[calibration.usable.ravel()] = result.outcome.rmse_pa / 1e3
        rmse_map = value_map(trial.layout, values, "kPa", "RMSE of every taxel")
        return [
            page.figure(plot.svg(f"{result.title}: mean pressure"), "Mean of all valid taxels beside the chamber."),
            page.row(page.figure(rmse_map, "RMSE of every taxel that the calibration lists.")),
        ]
    plots = []
    for channel, label in enumerate(("f_z, N", "m_x, N·m", "m_y, N·m")):
        plot = Plot(time, axis(label, estimated[:, channel], reference[:, channel]), height=190)
        plot.line(trial.t_s, reference[:, channel], 1, "reference" if channel == 0 else "")
        plot.line(trial.t_s, estimated[:, channel], 0, "insole" if channel == 0 else "")
        plots.append(plot.svg(f"{result.title}: {label} of insole and reference"))
    return [page.figure("".join(plots), "Every cycle, unfiltered, at the clock that fits best.")]
