"""The page that says what a calibration is made of and how good it is, to show to a colleague."""

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
from .verdict import of_triangle

Array = NDArray[np.float64]

_POINTS = 80  # of a curve
_SENSITIVE_PA = 50e3  # at which sensitivities are compared


def calibration_page(calibrated: Calibrated) -> str:
    """The whole page."""
    fit = calibrated.fit
    words = Counter(each.word for each in calibrated.verdicts.values())
    shoe = np.isfinite(fit.residual_wrench).all()
    facts = [
        (f"{len(calibrated.slots)} of {len(calibrated.verdicts)}", "taxels have a curve"),
        (f"{words['healthy']}", "taxels are healthy"),
        (f"{fit.degree}", "degree of the polynomials"),
    ]
    if np.isfinite(fit.residual_pa).any():
        facts.append((f"{np.nanmedian(fit.residual_pa) / 1e3:.2f} kPa", "left in the chamber (σ, median taxel)"))
    if shoe:
        f_z, m_x, m_y = fit.residual_wrench
        facts.append((f"{f_z:.1f} N", f"left of f_z (σ); m_x {m_x:.2f}, m_y {m_y:.2f} N·m"))
    parts = [
        page.facts(*facts),
        page.section("Curves", *_curves(calibrated)),
        page.section("Sensitivity and health", *_maps(calibrated)),
        page.section("What the curves leave", *(_residuals(calibrated))),
        page.section("Recordings and their clocks", _recordings(calibrated)),
        page.section("How it was fitted", *_method(calibrated)),
    ]
    return page.page(
        f"Calibration of the {calibrated.foot} insole",
        f"From {', '.join(each.trial.name for each in calibrated.samples)}. Residuals are of smoothed samples in which "
        "the load changes slowly; how good the calibration is on others, insole validate says.",
        parts,
        [
            page.insole_label(calibrated.foot, (each.board for each in calibrated.layout.triangles)),
            f"calibration made of {', '.join(each.trial.name for each in calibrated.samples)}",
        ],
    )


def _curves(calibrated: Calibrated) -> list[str]:
    fit, highest = calibrated.fit, calibrated.highest_count
    to_count = float(highest.max())
    plot = Plot(
        Axis("activation, counts below rest", 0.0, to_count * 1.02),
        axis("pressure, kPa", np.array([0.0]), _ends(calibrated) / 1e3),
    )
    for at in range(len(calibrated.slots)):
        x = np.linspace(0, float(highest[at]), _POINTS)
        plot.line(x, curve_pa(fit.coefficients_pa[at : at + 1], x[:, None])[:, 0] / 1e3, faint=True)
    x = np.linspace(0, to_count, _POINTS)
    if fit.common_pa.any():
        plot.line(x, curve_pa(fit.common_pa[None], x[:, None])[:, 0] / 1e3, 1, "what all taxels have in common")
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
            "Every taxel's curve as far as it was seen. Beyond, the daemon goes on with the polynomial and counts the "
            "cycle as extrapolated.",
        ),
        page.figure(
            spread.svg("standard deviation of the pressure over activation"),
            "How well the curves are known: of the coefficients and of rest, without the noise of one reading.",
        ),
    ]


def _ends(calibrated: Calibrated) -> Array:
    ends: Array = curve_pa(calibrated.fit.coefficients_pa, calibrated.highest_count[None])[0]
    return ends


def _maps(calibrated: Calibrated) -> list[str]:
    layout, slots = calibrated.layout, calibrated.slots
    counts = np.linspace(0, float(calibrated.highest_count.max()), 400)
    pressures = curve_pa(calibrated.fit.coefficients_pa, np.tile(counts[:, None], len(slots)))
    at = np.argmax(pressures >= _SENSITIVE_PA, axis=0)
    answers = np.full(len(layout) * N_TAXELS, np.nan)
    answers[slots] = np.where(at > 0, counts[at], np.nan)
    words = {slot: each.word for slot, each in calibrated.verdicts.items()}
    bad = [
        (
            _name(calibrated, slot), each.word, each.recording or "",
            "" if each.since_s is None else f"{each.since_s:.1f} s", each.detail, calibrated.left_out.get(slot, ""),
        )
        for slot, each in sorted(calibrated.verdicts.items())
        if each.word != "healthy" or slot in calibrated.left_out
    ]  # fmt: skip
    triangles = []
    for row, triangle in enumerate(layout.triangles):
        found = of_triangle([calibrated.verdicts[row * N_TAXELS + int(t)] for t in np.flatnonzero(PRESSURE_TAXELS)])
        if found.word != "healthy" or found.detail:
            triangles.append((f"{triangle.board}.{triangle.triangle}", found.word, found.detail))
    parts = [
        page.row(
            page.figure(
                value_map(layout, answers, "counts", "answer of every taxel to 50 kPa"),
                "Counts by which a taxel answers to 50 kPa. Toes are up, the wearer's left is left.",
            ),
            page.figure(word_map(layout, words, "healthy", "health of every taxel"), "What is wrong with which taxel."),
        )
    ]
    if bad:
        columns = ("taxel (board.triangle.taxel)", "verdict", "seen in", "since", "because", "left out: why")
        parts.append(page.table(columns, bad, range(len(columns))))
    else:
        parts.append(page.paragraph("Every taxel is healthy and has a curve."))
    if triangles:
        parts.append(page.table(("triangle (board.triangle)", "verdict", ""), triangles, (0, 1, 2)))
    return parts


def _residuals(calibrated: Calibrated) -> list[str]:
    parts = [_of_trial(calibrated, each) for each in calibrated.samples]
    residual = calibrated.fit.residual_pa
    if np.isfinite(residual).any():
        values = np.full(len(calibrated.layout) * N_TAXELS, np.nan)
        values[calibrated.slots] = residual / 1e3
        drawn = value_map(calibrated.layout, values, "kPa", "residual of every taxel in the chamber")
        parts.append(page.row(page.figure(drawn, "What a taxel's curve leaves of the chamber's pressure (σ).")))
    return parts


def _of_trial(calibrated: Calibrated, each: Samples) -> str:
    """The whole trial, smoothed or not: what was selected shows in what is left."""
    trial = each.trial
    reference = reference_at_cycles(trial, each.clock)
    valid = trial.valid[:, calibrated.slots]
    pressure = np.where(valid, calibrated.pressure_pa(trial), np.nan)
    if trial.kind == "chamber":
        with np.errstate(invalid="ignore"):
            own, said = np.nanmean(pressure, axis=1) / 1e3, reference[:, 0] / 1e3
        unit, label, what = "kPa", "mean", "mean pressure of all taxels"
    else:
        area = calibrated.layout.taxel_area_m2
        own, said = np.nansum(pressure, axis=1) * area, reference[:, 0]
        unit, label, what = "N", "f_z", "f_z"
    time = axis("time, s", trial.t_s)
    plot = Plot(time, axis(f"{label}, {unit}", own, said), height=210)
    plot.line(trial.t_s, said, 1, "reference")
    plot.line(trial.t_s, own, 0, "insole")
    left = Plot(time, axis(f"error, {unit}", own - said), height=150)
    left.line(trial.t_s, own - said, 0)
    return page.figure(
        plot.svg(f"{trial.name}: {what} of insole and reference") + left.svg(f"{trial.name}: what is left"),
        f"{trial.name}: {what} and its error (insole − reference), every cycle, unfiltered; {len(each.t_s)} of "
        f"{len(trial.t_s)} cycles were fitted.",
    )


def _recordings(calibrated: Calibrated) -> str:
    rows = [
        (
            each.trial.name, each.trial.kind, f"{len(each.trial.t_s)}", f"{len(each.t_s)}", f"{each.covered:.0%}",
            f"{each.clock.offset_s:.4f} ± {each.clock.offset_std_s:.4f}",
            f"{each.clock.rate * 1e6:.0f} ± {each.clock.rate_std * 1e6:.0f}",
        )
        for each in calibrated.samples
    ]  # fmt: skip
    columns = ("recording", "kind", "cycles", "fitted", "with reference", "clock offset, s", "rate, ppm")
    return page.table(columns, rows, (0, 1))


def _method(calibrated: Calibrated) -> list[str]:
    fit, layout = calibrated.fit, calibrated.layout
    shoe = any(each.trial.kind == "shoe" for each in calibrated.samples)
    area = f"{layout.taxel_area_m2 * 1e6:.1f} mm² a taxel ({layout.area_meaning or 'its meaning is not said'})"
    checked = "the shoe's force fits the curves to it" if shoe else "without a shoe, nothing has checked it"
    parts = [page.paragraph(f"Forces are pressures times the layout's area, {area}: {checked}.")]
    if calibrated.method == "paper":
        text = (
            "As published (Sorrentino et al. 2020): a cubic in raw counts with its constant, weights tuned by hand and "
            "λ = 10⁻⁹, with the signs of the moments' regressors corrected; no constraints."
        )
        return [page.paragraph(text), *parts]
    parts.insert(
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
    for at, degree in enumerate(degrees):
        own = sorted((penalty, error) for d, penalty, error in fit.tried if d == degree)
        x, y = np.array(own).T
        plot.line(x, np.where(y < 1.5 * least, y / least, np.nan), at, f"degree {degree}")
    parts.append(page.figure(plot.svg("held-out error over penalty, by degree"), "Error on what was not fitted."))
    return parts


def _name(calibrated: Calibrated, slot: int) -> str:
    triangle = calibrated.layout.triangles[slot // N_TAXELS]
    return f"{triangle.board}.{triangle.triangle}.{slot % N_TAXELS}"
