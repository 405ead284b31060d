"""The pictures of a recording as one self-contained page: what the live page shows, of all of a trial at once."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean, pstdev

import numpy as np
from numpy.typing import NDArray

from ..mechanics.gait import GaitEvent
from ..recording.derived import events
from ..recording.loading import FootRecording, Recording
from ..recording.steps import steps
from ..report.insole_map import value_map
from ..report.page import facts, figure, page, paragraph, row, section, table
from ..report.plot import Axis, Plot, axis

_Array = NDArray[np.float64]
_COLOURS = {"left": 0, "right": 1}  # of the live page, too
_REFERENCE = 2
_CLOSE_S = 5.0
_MOST_EVENTS = 100
_KPA = 1e-3
_FIGURES: dict[str, tuple[str, float, int]] = {  # of a step: what it is called, its factor and digits
    "stance_s": ("stance, s", 1.0, 2),
    "swing_s": ("swing, s", 1.0, 2),
    "stride_s": ("stride, s", 1.0, 2),
    "cadence_per_min": ("cadence, steps/min", 1.0, 0),
    "double_support_s": ("double support, s", 1.0, 2),
    "stance_symmetry_percent": ("symmetry of stance, %", 1.0, 1),
    "peak_force_n": ("peak force, N", 1.0, 0),
    **{
        f"{region}_{what}": (f"{region}, {words}", _KPA, 0)
        for region in ("heel", "midfoot", "forefoot", "toes")
        for what, words in (("peak_pa", "peak kPa"), ("integral_pa_s", "integral kPa s"))
    },
}


def recorded_page(recording: Recording) -> str:
    """HTML of one file, which loads nothing from anywhere."""
    told = steps(recording.feet)
    feet = [foot for foot in recording.feet if len(foot)]
    known = [foot for foot in feet if foot.wrench is not None]
    start_ns = min((int(foot.t_ns[0]) for foot in feet), default=0)
    parts = [_facts(feet, told)]
    said = [*recording.warnings, *(f"Not measured: {each}" for each in recording.invented)]
    if said:
        parts.append(section("Before you believe a number", *map(paragraph, said)))
    if known:
        parts += [_maps(known), _courses(known, told, start_ns), _centres(known)]
    else:
        parts.append(section("Pressure", paragraph("No foot has a calibration: there are counts and no pressure.")))
    if told:
        parts.append(_gait(told))
    if feet:
        parts.append(_health(feet, start_ns))
    lead = f"{recording.kind}, {recording.can_origin}"
    return page(f"Recording {recording.folder.resolve().name}", lead, parts)


def _seconds(foot: FootRecording, start_ns: int) -> _Array:
    """(n,) of every cycle, since the start."""
    return np.asarray((foot.t_ns - start_ns) * 1e-9, np.float64)


def _facts(feet: Sequence[FootRecording], told: Sequence[GaitEvent]) -> str:
    seconds = max((float(foot.t_ns[-1] - foot.t_ns[0]) * 1e-9 for foot in feet), default=0.0)
    said = [(f"{seconds:.1f} s", "recorded")]
    for foot in feet:
        said.append((f"{len(foot)}", f"cycles of the {foot.foot} foot"))
        said.append((f"{int(foot.late.sum())}", f"late, {foot.foot}"))
        if foot.wrench is not None and np.isfinite(foot.wrench.f_z_n).any():
            said.append((f"{np.nanmax(foot.wrench.f_z_n):.0f} N", f"most on the {foot.foot} foot"))
    said.append((f"{sum(event.kind == 'initial_contact' for event in told)}", "steps"))
    return facts(*said)


def _maps(feet: Sequence[FootRecording]) -> str:
    """The highest pressure of every taxel, and its mean."""
    return section("Pressure", *(row(*(_map(foot, words) for foot in feet)) for words in ("highest", "mean")))


def _map(foot: FootRecording, words: str) -> str:
    assert foot.pressure_pa is not None
    seen = foot.valid.any(axis=0)
    pressed = np.where(foot.valid, foot.pressure_pa, np.nan)[:, seen]
    values = np.full(seen.shape, np.nan)
    values[seen] = (np.nanmax if words == "highest" else np.nanmean)(pressed, axis=0) * _KPA
    title = f"{words} pressure of every taxel, {foot.foot} foot"
    return figure(value_map(foot.layout, values.ravel(), "kPa", title), f"{title}; empty: never valid")


def _courses(feet: Sequence[FootRecording], told: Sequence[GaitEvent], start_ns: int) -> str:
    """f_z and the moments, of all of it and of a few seconds that have steps in them."""
    last_s = max(float(foot.t_ns[-1] - start_ns) * 1e-9 for foot in feet)
    drawn = [_course(feet, "f_z_n", "f_z, N", start_ns, 0.0, last_s)]
    begin_s, end_s = 0.0, last_s
    if last_s > 2 * _CLOSE_S:
        contacts_s = [(event.t_ns - start_ns) * 1e-9 for event in told if event.kind == "initial_contact"]
        middle_s = contacts_s[len(contacts_s) // 2] if contacts_s else last_s / 2
        begin_s = max(0.0, min(middle_s - _CLOSE_S / 2, last_s - _CLOSE_S))
        end_s = begin_s + _CLOSE_S
        drawn.append(_course(feet, "f_z_n", "f_z, N", start_ns, begin_s, end_s))
    moments = [("m_x_nm", "m_x, N·m"), ("m_y_nm", "m_y, N·m")]
    drawn.append(row(*(_course(feet, *each, start_ns, begin_s, end_s) for each in moments)))
    unmatched = any(foot.reference is not None and _reference(foot, "f_z_n") is None for foot in feet)
    note = "There is a reference, on a clock of its own: it is not drawn, since nobody knows yet what it was when."
    return section("Forces and moments", *drawn, paragraph(note) if unmatched else "")


def _course(feet: Sequence[FootRecording], name: str, label: str, start_ns: int, begin_s: float, end_s: float) -> str:
    """One quantity of every foot, and its reference, if that is on the same clock."""
    lines: list[tuple[_Array, _Array, int, str]] = []
    for foot in feet:
        reference = _reference(foot, name)
        if reference is not None:
            time_s = reference[0] - start_ns * 1e-9
            lines.append((time_s, reference[1], _REFERENCE, f"reference, {foot.foot}"))
        lines.append((_seconds(foot, start_ns), getattr(foot.wrench, name), _COLOURS[foot.foot], foot.foot))
    inside = [(x >= begin_s) & (x <= end_s) for x, _, _, _ in lines]
    plot = Plot(
        Axis("s", begin_s, end_s), axis(label, *(y[keep] for (_, y, _, _), keep in zip(lines, inside, strict=True)))
    )
    for (x, y, colour, words), keep in zip(lines, inside, strict=True):
        plot.line(x[keep], y[keep], colour, words)
    title = f"{label.partition(',')[0]} from {begin_s:.0f} to {end_s:.0f} s"
    return figure(plot.svg(title), title)


def _reference(foot: FootRecording, name: str) -> tuple[_Array, _Array] | None:
    """(n,) epoch seconds and values of the reference's column of that name, if both clocks are one."""
    column = {"f_z_n": "fz_n", "m_x_nm": "mx_nm", "m_y_nm": "my_nm"}[name]
    reference = foot.reference
    if reference is None or reference.clock != "can" or reference.time_s is None or column not in reference.columns:
        return None
    return reference.time_s, reference[column]


def _centres(feet: Sequence[FootRecording]) -> str:
    """Where the centre of pressure went, toes up."""
    drawn = []
    for foot in feet:
        assert foot.wrench is not None
        x_mm, y_mm = 1e3 * foot.wrench.cop_x_m, 1e3 * foot.wrench.cop_y_m
        if not np.isfinite(x_mm).any():
            continue
        plot = Plot(axis("to the wearer's right, mm", -y_mm), axis("forward, mm", x_mm), height=560)
        plot.line(-y_mm, x_mm, _COLOURS[foot.foot], faint=True)
        title = f"centre of pressure, {foot.foot} foot"
        drawn.append(figure(plot.svg(title), title))
    return section("Centre of pressure", row(*drawn)) if drawn else ""


def _gait(told: Sequence[GaitEvent]) -> str:
    """Mean and standard deviation of every figure over the steps in which it is known."""
    rows = []
    for name, (words, factor, digits) in _FIGURES.items():
        cells = [words]
        for foot in _COLOURS:
            known = [
                value * factor
                for event in told
                if event.foot == foot and (value := event.figures.get(name)) is not None
            ]
            cells.append(f"{fmean(known):.{digits}f} ± {pstdev(known):.{digits}f} ({len(known)})" if known else "–")
        rows.append(cells)
    heading = ("mean ± standard deviation (steps)", *_COLOURS)
    about = "Steps are told from f_z alone; a region is a part of the length of the sensed area."
    return section("Gait", paragraph(about), table(heading, rows))


def _health(feet: Sequence[FootRecording], start_ns: int) -> str:
    """How much of the insole was valid, and what happened to the boards."""
    shares = [foot.valid.sum(axis=(1, 2)) / (10 * len(foot.layout)) * 100.0 for foot in feet]
    last_s = max(float(foot.t_ns[-1] - start_ns) * 1e-9 for foot in feet)
    plot = Plot(Axis("s", 0.0, last_s), Axis("valid taxels, %", 0.0, 104.0), height=180)
    for foot, share in zip(feet, shares, strict=True):
        plot.line(_seconds(foot, start_ns), share, _COLOURS[foot.foot], foot.foot)
    happened = sorted((t_ns, foot.foot, event["text"]) for foot in feet for t_ns, event in events(foot))
    rows = [(f"{(t_ns - start_ns) * 1e-9:.2f}", foot, text) for t_ns, foot, text in happened[:_MOST_EVENTS]]
    more = len(happened) - len(rows)
    return section(
        "Health",
        figure(plot.svg("share of valid taxels"), "share of the pressure taxels that may be read as pressure"),
        table(("s", "foot", "what happened"), rows, (1, 2)),
        paragraph(f"and {more} more") if more > 0 else "",
    )
