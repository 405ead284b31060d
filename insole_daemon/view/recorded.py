"""The report of a recording as one self-contained page: the figures of the live page for a whole trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..mechanics.gait import GaitEvent
from ..mechanics.gait.steps import Steps
from ..mechanics.gait.symmetry import symmetry
from ..recording.derived_messages import derive_events
from ..recording.loading import FootRecording, Recording
from ..recording.quality import quality
from ..recording.steps import replay_gait_events
from ..report.foot_outline import foot_outline_mm
from ..report.insole_map import outlines_mm, value_map
from ..report.page import facts, figure, insole_label, page, paragraph, row, section, table
from ..report.plot import WHOLE_WIDTH, WIDTH, Axis, Plot, axis
from ..skin.quality import Quality

_Array = NDArray[np.float64]
_COLOURS = {"left": 0, "right": 1}  # of the live page, too
_REFERENCE = 2
_CLOSE_S = 5.0
_MOST_EVENTS = 100
_KPA = 1e-3
_FIGURES: dict[str, tuple[str, float, int]] = {  # of a step: label, factor and digits
    "stance_s": ("stance, s", 1.0, 3),
    "swing_s": ("swing, s", 1.0, 3),
    "stride_s": ("stride, s", 1.0, 3),
    "cadence_per_min": ("cadence, steps/min", 1.0, 1),
    "double_support_s": ("double support, s", 1.0, 3),
    "peak_force_n": ("peak force, N", 1.0, 0),
    "impulse_n_s": ("impulse, N·s", 1.0, 1),
    "loading_rate_n_s": ("loading rate, N/s", 1.0, 0),
    "cop_path_m": ("path of the CoP, mm", 1e3, 1),
    "cop_width_m": ("width of the CoP, mm", 1e3, 1),
    "contact_area_m2": ("contact area, cm²", 1e4, 1),
}
_OF_REGIONS = {
    "peak_pa": ("peak, kPa", _KPA, 0),
    "integral_pa_s": ("pressure–time integral, kPa·s", _KPA, 1),
    "area_m2": ("area, cm²", 1e4, 1),
}
_SYMMETRIES = ("stance_s", "peak_force_n", "impulse_n_s")


def recorded_page(recording: Recording) -> str:
    """Return the report as self-contained HTML."""
    step_events = replay_gait_events(recording.feet)
    feet = [foot for foot in recording.feet if len(foot)]
    with_wrench = [foot for foot in feet if foot.wrench is not None]
    start_ns = min((int(foot.t_ns[0]) for foot in feet), default=0)
    data_quality = quality(recording)
    sections = [
        _facts(feet, step_events, data_quality),
        *(paragraph(f"{foot}: {foot_quality.sentence}") for foot, foot_quality in data_quality.items()),
    ]
    warnings = [*recording.warnings, *(f"Not measured: {value}" for value in recording.invented)]
    if warnings:
        sections.append(section("Before you believe a number", *map(paragraph, warnings)))
    if with_wrench:
        sections += [_maps(with_wrench), _time_plots(with_wrench, step_events, start_ns), _centres(with_wrench)]
    else:
        sections.append(section("Pressure", paragraph("No foot has a calibration: there are counts and no pressure.")))
    if step_events and len(recording.steps):
        sections.append(_gait(recording.steps))
    if feet:
        sections.append(_health(feet, start_ns))
    lead = f"{recording.kind}, {recording.can_origin}"
    return page(f"Recording {recording.folder.resolve().name}", lead, sections, _about(feet))


def _about(feet: Sequence[FootRecording]) -> list[str]:
    """Return the time of the recording and its insoles."""
    words = []
    if feet:
        began = datetime.fromtimestamp(min(int(foot.t_ns[0]) for foot in feet) * 1e-9).astimezone()
        words.append(began.strftime("recorded %Y-%m-%d %H:%M:%S %z"))
    for foot in feet:
        insole = insole_label(foot.foot, (board.address for board in foot.boards))
        calibration = "no calibration" if foot.calibration is None else "a calibration of this insole"
        if foot.calibration is not None and foot.calibration.builtin:
            calibration = "the built-in calibration"
        zero = "" if foot.zero is None else " with a zero"
        words.append(f"{insole}, {calibration}{zero}")
    return words


def _seconds(foot: FootRecording, start_ns: int) -> _Array:
    """Return the times of the cycles since `start_ns` in s, (n,)."""
    return np.asarray((foot.t_ns - start_ns) * 1e-9, np.float64)


def _facts(
    feet: Sequence[FootRecording], step_events: Sequence[GaitEvent], data_quality: Mapping[Foot, Quality]
) -> str:
    seconds = max((float(foot.t_ns[-1] - foot.t_ns[0]) * 1e-9 for foot in feet), default=0.0)
    items = [(f"{seconds:.1f} s", "recorded")]
    for foot in feet:
        items.append(
            (data_quality[foot.foot].verdict, f"{data_quality[foot.foot].percent} % of the cycles, {foot.foot} foot")
        )
        if foot.wrench is not None and np.isfinite(foot.wrench.f_z_n).any():
            items.append((f"{np.nanmax(foot.wrench.f_z_n):.0f} N", f"most on the {foot.foot} foot"))
    items.append((f"{sum(event.kind == 'initial_contact' for event in step_events)}", "steps"))
    return facts(*items)


def _maps(feet: Sequence[FootRecording]) -> str:
    """Draw the highest and the mean pressure of every taxel, both feet on one scale from 0."""
    rows = []
    for words in ("highest", "mean"):
        values = [_values_kpa(foot, words) for foot in feet]
        finite = np.concatenate([foot_values[np.isfinite(foot_values)] for foot_values in values])
        highest = float(np.percentile(finite, 98)) if len(finite) else 1.0
        rows.append(
            row(*(_map(foot, foot_values, words, highest) for foot, foot_values in zip(feet, values, strict=True)))
        )
    return section("Pressure", *rows)


def _values_kpa(foot: FootRecording, words: str) -> _Array:
    """Return the highest or the mean pressure of every taxel in kPa, (n_triangles, 12); NaN: never valid."""
    assert foot.pressure_pa is not None
    ever_valid = foot.valid.any(axis=0)
    pressed = np.where(foot.valid, foot.pressure_pa, np.nan)[:, ever_valid]
    values = np.full(ever_valid.shape, np.nan)
    values[ever_valid] = (np.nanmax if words == "highest" else np.nanmean)(pressed, axis=0) * _KPA
    return values


def _map(foot: FootRecording, values: _Array, words: str, highest: float) -> str:
    title = f"{words} pressure of every taxel, {foot.foot} foot"
    drawn = value_map(foot.layout, values.ravel(), "kPa", title, highest)
    return figure(drawn, f"{title}; empty: never valid")


def _time_plots(feet: Sequence[FootRecording], step_events: Sequence[GaitEvent], start_ns: int) -> str:
    """Draw f_z and the moments, of the whole recording and of a few seconds with steps."""
    last_s = max(float(foot.t_ns[-1] - start_ns) * 1e-9 for foot in feet)
    drawn = [_time_plot(feet, "f_z_n", "f_z, N", start_ns, 0.0, last_s, WHOLE_WIDTH)]
    begin_s, end_s = 0.0, last_s
    if last_s > 2 * _CLOSE_S:
        contacts_s = [(event.t_ns - start_ns) * 1e-9 for event in step_events if event.kind == "initial_contact"]
        middle_s = contacts_s[len(contacts_s) // 2] if contacts_s else last_s / 2
        begin_s = max(0.0, min(middle_s - _CLOSE_S / 2, last_s - _CLOSE_S))
        end_s = begin_s + _CLOSE_S
        drawn.append(_time_plot(feet, "f_z_n", "f_z, N", start_ns, begin_s, end_s, WHOLE_WIDTH))
    moments = [("m_x_nm", "m_x, N·m"), ("m_y_nm", "m_y, N·m")]
    drawn.append(row(*(_time_plot(feet, *moment, start_ns, begin_s, end_s) for moment in moments)))
    unmatched = any(foot.reference is not None and _reference(foot, "f_z_n") is None for foot in feet)
    note = "There is a reference with its own clock. It is not drawn, because the clocks have not been aligned yet."
    return section("Forces and moments", *drawn, paragraph(note) if unmatched else "")


def _time_plot(
    feet: Sequence[FootRecording],
    name: str,
    label: str,
    start_ns: int,
    begin_s: float,
    end_s: float,
    width: float = WIDTH,
) -> str:
    """Draw one quantity of every foot, and its reference if that is on the same clock."""
    lines: list[tuple[_Array, _Array, int, str]] = []
    for foot in feet:
        reference = _reference(foot, name)
        if reference is not None:
            time_s = reference[0] - start_ns * 1e-9
            lines.append((time_s, reference[1], _REFERENCE, f"reference, {foot.foot}"))
        lines.append((_seconds(foot, start_ns), getattr(foot.wrench, name), _COLOURS[foot.foot], foot.foot))
    inside = [(x >= begin_s) & (x <= end_s) for x, _, _, _ in lines]
    plot = Plot(
        Axis("time, s", begin_s, end_s),
        axis(label, *(y[keep] for (_, y, _, _), keep in zip(lines, inside, strict=True))),
        width,
    )
    for (x, y, colour, words), keep in zip(lines, inside, strict=True):
        plot.line(x[keep], y[keep], colour, words)
    title = f"{label.partition(',')[0]} from {begin_s:.0f} to {end_s:.0f} s"
    return figure(plot.svg(title), title)


def _reference(foot: FootRecording, name: str) -> tuple[_Array, _Array] | None:
    """Return epoch seconds and values of a reference column, (n,) each, or None if its clock is another one."""
    column = {"f_z_n": "fz_n", "m_x_nm": "mx_nm", "m_y_nm": "my_nm"}[name]
    reference = foot.reference
    if reference is None or reference.clock != "can" or reference.time_s is None or column not in reference.columns:
        return None
    return reference.time_s, reference[column]


def _centres(feet: Sequence[FootRecording]) -> str:
    """Draw the path of the centre of pressure on the foot and its triangles, toes up."""
    drawn = []
    for foot in feet:
        assert foot.wrench is not None
        x_mm, y_mm = 1e3 * foot.wrench.cop_x_m, 1e3 * foot.wrench.cop_y_m
        if not np.isfinite(x_mm).any():
            continue
        outline = foot_outline_mm(foot.layout.xy_m.reshape(-1, 2) * 1e3)
        plot = Plot.to_scale(
            axis("to the wearer's right, mm", -outline[:, 1]), axis("forward, mm", outline[:, 0]), height=620
        )
        for shape in (outline, *outlines_mm(foot.layout)):
            plot.outline(-shape[:, 1], shape[:, 0])
        plot.line(-y_mm, x_mm, _COLOURS[foot.foot], faint=True)
        title = f"centre of pressure, {foot.foot} foot"
        drawn.append(figure(plot.svg(title), title))
    return section("Centre of pressure", row(*drawn)) if drawn else ""


def _gait(steps: Steps) -> str:
    """Tabulate mean and standard deviation of every figure over the steady steps, and the symmetry of some."""
    figures = dict(_FIGURES)
    for name in steps.columns:
        for ending, (words, factor, digits) in _OF_REGIONS.items():
            if name.endswith(f"_{ending}") and name not in _FIGURES:
                region = name.removesuffix(f"_{ending}").replace("_", " ")
                figures[name] = (f"{region}: {words}", factor, digits)
    rows = []
    for name, (words, factor, digits) in figures.items():
        cells = [words]
        for foot in _COLOURS:
            values = steps.of(foot).steady[name]
            finite = values[np.isfinite(values)] * factor
            spread = f" ± {finite.std(ddof=1):.{digits}f}" if len(finite) > 1 else ""
            cells.append(f"{finite.mean():.{digits}f}{spread} ({len(finite)})" if len(finite) else "–")
        rows.append(cells)
    labels, counts = np.unique(steps["label"], return_counts=True)
    kinds = ", ".join(f"{count} {label}" for label, count in zip(labels, counts, strict=True))
    remarks = [
        f"The table has the steady steps only; all stances: {kinds}.",
        *(f"{remark[0].upper()}{remark[1:]}." for remark in steps.remarks),
    ]
    indices = []
    for name in _SYMMETRIES:
        index = symmetry(steps, name)
        if np.isfinite(index.low):
            words = _FIGURES[name][0].partition(",")[0]
            indices.append((words, _percent(index.value), f"{_percent(index.low)} to {_percent(index.high)}"))
    content = [*map(paragraph, remarks), table(("mean ± standard deviation (steps)", *_COLOURS), rows)]
    if indices:
        content.append(table(("symmetry, left less right of their mean", "index", "95 % interval"), indices))
    return section("Gait", *content)


def _percent(value: float) -> str:
    return f"{value:+.1f} %".replace("-", "−")


def _health(feet: Sequence[FootRecording], start_ns: int) -> str:
    """Draw the share of valid taxels, and list the events of the boards."""
    shares = [foot.valid.sum(axis=(1, 2)) / (10 * len(foot.layout)) * 100.0 for foot in feet]
    last_s = max(float(foot.t_ns[-1] - start_ns) * 1e-9 for foot in feet)
    plot = Plot(Axis("time, s", 0.0, last_s), Axis("valid taxels, %", 0.0, 104.0), WHOLE_WIDTH, 180)
    for foot, share in zip(feet, shares, strict=True):
        plot.line(_seconds(foot, start_ns), share, _COLOURS[foot.foot], foot.foot)
    happened = sorted((t_ns, foot.foot, event["text"]) for foot in feet for t_ns, event in derive_events(foot))
    rows = [(f"{(t_ns - start_ns) * 1e-9:.2f}", foot, text) for t_ns, foot, text in happened[:_MOST_EVENTS]]
    more = len(happened) - len(rows)
    return section(
        "Health",
        figure(plot.svg("share of valid taxels"), "share of the pressure taxels that may be read as pressure"),
        table(("s", "foot", "what happened"), rows, (1, 2)),
        paragraph(f"and {more} more") if more > 0 else "",
    )
