"""For a reviewer: loops at slow and fast speed, and what is left against level, speed, hold time, warmth and time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ...report import page
from ...report.plot import Plot, axis
from ..observed import Observed, stretches
from .untouched import HOLD, Untouched

LEAST_CYCLE = 0.6  # of the span: a smaller one is a minor loop
BACK = 0.1  # of the span: the load is back
BINS = 18
LEAST_IN_BIN = 6


def loops(seen: Untouched) -> str:
    """The slowest and the fastest whole cycle: what the static curve leaves of it, against the load."""
    cycles = _cycles(seen)
    if not cycles:
        return page.paragraph("The load makes no whole cycle from rest to rest: there is no loop to be drawn.")
    chosen = [("the slowest cycle", cycles[0])]
    if len(cycles) > 1:
        chosen.append(("the fastest cycle", cycles[-1]))
    load = axis("load, kPa", seen.load_pa / 1e3)
    left = axis("counts beyond the static curve", *(seen.before[rows] for _, rows in chosen))
    whole = axis("counts below rest", seen.count)
    figures = []
    for name, rows in chosen:
        x = seen.load_pa[rows] / 1e3
        top = Plot(load, whole, 480, 200)
        top.line(x, seen.count[rows], 2)
        plot = Plot(load, left, 480, 240)
        plot.line(x, seen.before[rows], 1, "measured")
        if seen.explained:
            plot.line(x, seen.before[rows] - seen.after[rows], 0, "model")
        figures.append(
            page.figure(
                top.svg(f"counts over load in {name}") + plot.svg(f"loop over load in {name}"),
                f"{name[:1].upper()}{name[1:]}, {_speed(seen, rows) / 1e3:.0f} kPa/s: mean reading of the taxels "
                "concerned, and below it what the static curve leaves, with what the effects say of it.",
            )
        )
    return page.row(*figures)


def regimes(seen: Untouched, observed: tuple[Observed, ...]) -> str:
    """What both models leave against everything an effect may depend on."""
    moving = np.abs(seen.rate_pa_s) >= HOLD * seen.span_pa
    level = seen.load_pa / 1e3
    high = level > level.min() + 0.2 * seen.span_pa / 1e3
    held = seen.held_s
    panels = [
        _panel(seen, level, "load, kPa", moving & (seen.rate_pa_s > 0), "while the load rises"),
        _panel(seen, level, "load, kPa", moving & (seen.rate_pa_s < 0), "while the load falls"),
        _panel(seen, seen.rate_pa_s / 1e3, "speed, kPa/s", moving, "against the speed of the load"),
        _panel(seen, held, "time since the load stopped, s", high & (held > 0), "while a load is held"),
        _panel(seen, held, "time since the load was gone, s", ~high & (held > 0), "at rest, after the load is gone"),
        _panel(seen, seen.t_s, "time, s", np.ones(len(level), bool), "in the course of the recording"),
    ]
    if all(each.temperature_c is not None for each in observed):
        warm = np.concatenate([each.temperature_c for each in observed if each.temperature_c is not None])
        if np.ptp(warm) > 0.5:
            panels.append(_panel(seen, warm, "temperature, °C", np.ones(len(level), bool), "against the temperature"))
    return page.row(*(each for each in panels if each))


def _panel(seen: Untouched, x: Array, label: str, rows: NDArray[np.bool_], caption: str) -> str:
    rows = rows & np.isfinite(x)
    if rows.sum() < 3 * LEAST_IN_BIN:
        return ""
    edges = np.linspace(x[rows].min(), x[rows].max(), BINS + 1)
    which = np.clip(np.searchsorted(edges, x[rows], side="right") - 1, 0, len(edges) - 2)
    kept = [b for b in range(len(edges) - 1) if np.count_nonzero(which == b) >= LEAST_IN_BIN]
    if len(kept) < 2:
        return ""
    middle = np.array([x[rows][which == b].mean() for b in kept])
    drawn = []
    for left in (seen.before[rows], seen.after[rows])[: 1 + seen.explained]:
        mean = np.array([left[which == b].mean() for b in kept])
        std = np.array([left[which == b].std() / np.sqrt(np.count_nonzero(which == b)) for b in kept])
        drawn.append((mean, 2 * std))
    limits = [value for mean, std in drawn for value in (mean - std, mean + std)]
    plot = Plot(axis(label, middle), axis("error, counts", *limits, np.array([-0.1, 0.1])), 360, 210)
    styles = ((1, "without the effects"), (0, "with them"))
    for (colour, name), (mean, std) in zip(styles, drawn, strict=False):
        plot.band(middle, mean - std, mean + std, colour)
        plot.line(middle, mean, colour, name)
    return page.figure(plot.svg(f"error {caption}"), f"{caption[:1].upper()}{caption[1:]} (mean ± 2 σ of the mean).")


def _cycles(seen: Untouched) -> list[NDArray[np.intp]]:
    """Rows of every stretch from rest to rest that goes high, the slowest first."""
    low = float(seen.load_pa.min())
    found = []
    for a, b in stretches(seen.load_pa > low + BACK * seen.span_pa):
        rows = np.arange(max(a - 2, 0), min(b + 3, len(seen.load_pa)))
        same = len(np.unique(seen.recording[rows])) == 1
        turns = np.count_nonzero(np.diff(np.sign(seen.rate_pa_s[rows])) != 0)
        if same and seen.load_pa[rows].max() > low + LEAST_CYCLE * seen.span_pa and len(rows) > 8 and turns <= 9:
            found.append(rows)
    return sorted(found, key=lambda rows: _speed(seen, rows))


def _speed(seen: Untouched, rows: NDArray[np.intp]) -> float:
    rate = np.abs(seen.rate_pa_s[rows])
    return float(np.median(rate[rate >= HOLD * seen.span_pa])) if np.any(rate >= HOLD * seen.span_pa) else 0.0
