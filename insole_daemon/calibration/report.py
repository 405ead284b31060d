"""Render the HTML report of a calibration: its curves, residuals, recordings and method."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from ..report import page
from ..report.insole_map import value_map, word_map
from ..report.plot import Axis, Plot, axis
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from .calibrating import Calibrated, curve_pa
from .samples import Samples, reference_at_cycles
from .verdict import judge_triangle

Array = NDArray[np.float64]

_POINTS = 80  # points per drawn curve
_SENSITIVE_PA = 50e3  # pressure at which sensitivities are compared


def calibration_page(calibrated: Calibrated) -> str:
    """Return the HTML page."""
    fit = calibrated.fit
    words = Counter(verdict.word for verdict in calibrated.verdicts.values())
    shoe = np.isfinite(fit.residual_wrench).all()
    facts = [
        (f"{len(calibrated.slots)} of {len(calibrated.verdicts)}", "taxels have a curve"),
        (f"{words['healthy']}", "taxels are healthy"),
        (f"{fit.degree}", "degree of the polynomials"),
    ]
    if np.isfinite(fit.residual_pa).any():
        facts.append((f"{np.nanmedian(fit.residual_pa) / 1e3:.2f} kPa", "residual in the chamber (σ, median taxel)"))
    if shoe:
        f_z, m_x, m_y = fit.residual_wrench
        facts.append((f"{f_z:.1f} N", f"residual of f_z (σ); m_x {m_x:.2f}, m_y {m_y:.2f} N·m"))
    sections = [
        page.facts(*facts),
        page.section("Curves", *_draw_curves(calibrated)),
        page.section("Sensitivity and health", *_draw_maps(calibrated)),
        page.section("Residuals of the curves", *(_draw_residuals(calibrated))),
        page.section("Recordings and their clocks", _recordings_table(calibrated)),
        page.section("How it was fitted", *_describe_method(calibrated)),
    ]
    return page.page(
        f"Calibration of the {calibrated.foot} insole",
        f"From {', '.join(fitted.trial.name for fitted in calibrated.samples)}. Residuals are of smoothed samples "
        "in which the load changes slowly; 'insole validate' measures the error on other recordings.",
        sections,
        [
            page.insole_label(calibrated.foot, (triangle.board for triangle in calibrated.layout.triangles)),
            f"calibration made of {', '.join(fitted.trial.name for fitted in calibrated.samples)}",
        ],
    )


def _draw_curves(calibrated: Calibrated) -> list[str]:
    """Draw all curves, and their uncertainty."""
    fit, highest = calibrated.fit, calibrated.highest_count
    to_count = float(highest.max())
    plot = Plot(
        Axis("activation, counts below rest", 0.0, to_count * 1.02),
        axis("pressure, kPa", np.array([0.0]), _highest_pressures(calibrated) / 1e3),
    )
    for row in range(len(calibrated.slots)):
        x = np.linspace(0, float(highest[row]), _POINTS)
        plot.line(x, curve_pa(fit.coefficients_pa[row : row + 1], x[:, None])[:, 0] / 1e3, faint=True)
    x = np.linspace(0, to_count, _POINTS)
    if fit.common_pa.any():
        plot.line(x, curve_pa(fit.common_pa[None], x[:, None])[:, 0] / 1e3, 1, "common to all taxels")
    powers = x[:, None] ** np.arange(fit.coefficients_pa.shape[1])
    std = np.sqrt(np.maximum(np.einsum("mij,ni,nj->nm", fit.covariance_pa2, powers, powers), 0.0)) / 1e3
    std[x[:, None] > highest] = np.nan
    known = np.isfinite(std).any(axis=1)
    low, middle, high = np.nanpercentile(std[known], (5, 50, 95), axis=1)
    spread = Plot(
        Axis("activation, counts below rest", 0.0, to_count * 1.02), axis("σ of the pressure, kPa", high, low)
    )
    spread.band(x[known], low, high, 0, "90 % of the taxels")
    spread.line(x[known], middle, 0, "median")
    return [
        page.figure(
            plot.svg("pressure over activation of every taxel"),
            "Every taxel's curve over its fitted range. Beyond it, the daemon continues the polynomial and counts the "
            "cycle as extrapolated.",
        ),
        page.figure(
            spread.svg("standard deviation of the pressure over activation"),
            "Uncertainty of the curves from coefficients and baseline, without the noise of a single reading.",
        ),
    ]


def _highest_pressures(calibrated: Calibrated) -> Array:
    ends: Array = curve_pa(calibrated.fit.coefficients_pa, calibrated.highest_count[None])[0]
    return ends


def _draw_maps(calibrated: Calibrated) -> list[str]:
    """Draw maps of sensitivity and verdicts, with tables of the irregular taxels and triangles."""
    layout, slots = calibrated.layout, calibrated.slots
    counts = np.linspace(0, float(calibrated.highest_count.max()), 400)
    pressures = curve_pa(calibrated.fit.coefficients_pa, np.tile(counts[:, None], len(slots)))
    first = np.argmax(pressures >= _SENSITIVE_PA, axis=0)
    answers = np.full(len(layout) * N_TAXELS, np.nan)
    answers[slots] = np.where(first > 0, counts[first], np.nan)
    words = {slot: verdict.word for slot, verdict in calibrated.verdicts.items()}
    bad = [
        (
            _taxel_name(calibrated, slot), verdict.word, verdict.recording or "",
            "" if verdict.since_s is None else f"{verdict.since_s:.1f} s", verdict.detail,
            calibrated.left_out.get(slot, ""),
        )
        for slot, verdict in sorted(calibrated.verdicts.items())
        if verdict.word != "healthy" or slot in calibrated.left_out
    ]  # fmt: skip
    triangles = []
    for row, triangle in enumerate(layout.triangles):
        overall = judge_triangle(
            [calibrated.verdicts[row * N_TAXELS + int(t)] for t in np.flatnonzero(PRESSURE_TAXELS)]
        )
        if overall.word != "healthy" or overall.detail:
            triangles.append((f"{triangle.board}.{triangle.triangle}", overall.word, overall.detail))
    blocks = [
        page.row(
            page.figure(
                value_map(layout, answers, "counts", "response of every taxel to 50 kPa"),
                "Response of every taxel to 50 kPa in counts. Toes are up, the wearer's left is left.",
            ),
            page.figure(word_map(layout, words, "healthy", "health of every taxel"), "Verdict on every taxel."),
        )
    ]
    if bad:
        columns = ("taxel (board.triangle.taxel)", "verdict", "seen in", "since", "because", "left out: why")
        blocks.append(page.table(columns, bad, range(len(columns))))
    else:
        blocks.append(page.paragraph("Every taxel is healthy and has a curve."))
    if triangles:
        blocks.append(page.table(("triangle (board.triangle)", "verdict", ""), triangles, (0, 1, 2)))
    return blocks


def _draw_residuals(calibrated: Calibrated) -> list[str]:
    """Draw the residuals of every trial and taxel."""
    figures = [_draw_trial(calibrated, fitted) for fitted in calibrated.samples]
    residual = calibrated.fit.residual_pa
    if np.isfinite(residual).any():
        values = np.full(len(calibrated.layout) * N_TAXELS, np.nan)
        values[calibrated.slots] = residual / 1e3
        residual_map = value_map(calibrated.layout, values, "kPa", "residual of every taxel in the chamber")
        figures.append(page.row(page.figure(residual_map, "Residual of every taxel's curve in the chamber (σ).")))
    return figures


def _draw_trial(calibrated: Calibrated, fitted: Samples) -> str:
    """Return the figure of a whole trial, including the cycles that were not fitted."""
    trial = fitted.trial
    reference = reference_at_cycles(trial, fitted.clock)
    valid = trial.valid[:, calibrated.slots]
    pressure = np.where(valid, calibrated.pressure_pa(trial), np.nan)
    if trial.kind == "chamber":
        with np.errstate(invalid="ignore"):
            insole, shown_reference = np.nanmean(pressure, axis=1) / 1e3, reference[:, 0] / 1e3
        unit, label, quantity = "kPa", "mean", "mean pressure of all taxels"
    else:
        area = calibrated.layout.taxel_area_m2
        insole, shown_reference = np.nansum(pressure, axis=1) * area, reference[:, 0]
        unit, label, quantity = "N", "f_z", "f_z"
    time = axis("time, s", trial.t_s)
    plot = Plot(time, axis(f"{label}, {unit}", insole, shown_reference), height=210)
    plot.line(trial.t_s, shown_reference, 1, "reference")
    plot.line(trial.t_s, insole, 0, "insole")
    error_plot = Plot(time, axis(f"error, {unit}", insole - shown_reference), height=150)
    error_plot.line(trial.t_s, insole - shown_reference, 0)
    return page.figure(
        plot.svg(f"{trial.name}: {quantity} of insole and reference") + error_plot.svg(f"{trial.name}: what is left"),
        f"{trial.name}: {quantity} and its error (insole − reference), every cycle, unfiltered; {len(fitted.t_s)} of "
        f"{len(trial.t_s)} cycles were fitted.",
    )


def _recordings_table(calibrated: Calibrated) -> str:
    """Return the table of recordings with their clocks."""
    rows = [
        (
            fitted.trial.name, fitted.trial.kind, f"{len(fitted.trial.t_s)}", f"{len(fitted.t_s)}",
            f"{fitted.covered:.0%}",
            f"{fitted.clock.offset_s:.4f} ± {fitted.clock.offset_std_s:.4f}",
            f"{fitted.clock.rate * 1e6:.0f} ± {fitted.clock.rate_std * 1e6:.0f}",
        )
        for fitted in calibrated.samples
    ]  # fmt: skip
    columns = ("recording", "kind", "cycles", "fitted", "with reference", "clock offset, s", "rate, ppm")
    return page.table(columns, rows, (0, 1))


def _describe_method(calibrated: Calibrated) -> list[str]:
    """Describe the method, with the cross-validation errors."""
    fit, layout = calibrated.fit, calibrated.layout
    shoe = any(fitted.trial.kind == "shoe" for fitted in calibrated.samples)
    area = f"{layout.taxel_area_m2 * 1e6:.1f} mm² a taxel ({layout.area_meaning or 'meaning not stated'})"
    checked = "the shoe's force fits the curves to it" if shoe else "without a shoe, nothing has checked it"
    blocks = [page.paragraph(f"Forces are pressures times the layout's area, {area}: {checked}.")]
    if calibrated.method == "paper":
        text = (
            "As published (Sorrentino et al. 2020): a cubic in raw counts with its constant, weights tuned by hand and "
            "λ = 10⁻⁹, with the signs of the moments' regressors corrected; no constraints."
        )
        return [page.paragraph(text), *blocks]
    blocks.insert(
        0,
        page.paragraph(
            f"Degree {fit.degree} and penalty {fit.penalty:g} by cross-validation over five stretches of every trial: "
            "the strongest penalty that is as good as the best choice, and its best degree. Weights are one "
            f"over the variance and the correlation time of the residuals. Curves start at 0 and never fall "
            f"({fit.solution.active} limits are active; KKT residual {fit.solution.kkt:.0e})."
        ),
    )
    degrees = sorted({degree for degree, _, _ in fit.tried})
    errors = np.array([error for _, _, error in fit.tried])
    least = float(errors.min())
    penalties = np.array([penalty for _, penalty, _ in fit.tried])
    shown = errors[errors < 1.5 * least] / least
    plot = Plot(Axis("penalty", float(penalties.min()), float(penalties.max()), True), axis("error / least", shown))
    for series, degree in enumerate(degrees):
        points = sorted((penalty, error) for d, penalty, error in fit.tried if d == degree)
        x, y = np.array(points).T
        plot.line(x, np.where(y < 1.5 * least, y / least, np.nan), series, f"degree {degree}")
    blocks.append(page.figure(plot.svg("held-out error over penalty, by degree"), "Error on what was not fitted."))
    return blocks


def _taxel_name(calibrated: Calibrated, slot: int) -> str:
    triangle = calibrated.layout.triangles[slot // N_TAXELS]
    return f"{triangle.board}.{triangle.triangle}.{slot % N_TAXELS}"
