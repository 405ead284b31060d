"""The study as one HTML page: every recording, what is missing and why, and sessions and conditions compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from ..mechanics.gait.comparison import (
    CurveTest,
    compare_curves,
    compare_paired_curves,
    difference_of_sessions,
    paired_difference,
)
from ..mechanics.gait.figures import PERCENT
from ..mechanics.gait.intervals import FEWEST, Interval
from ..mechanics.gait.steps import Steps, mean_curve
from ..report.page import facts, figure, page, paragraph, row, section, table
from ..report.plot import Axis, Plot, axis
from .document import Study

Setting = tuple[str, str]  # session and condition

_FIGURES = {
    "stance_s": ("stance, s", 1.0, 3),
    "double_support_s": ("double support, s", 1.0, 3),
    "cadence_per_min": ("cadence, steps/min", 1.0, 1),
    "peak_force_n": ("peak force, N", 1.0, 0),
    "impulse_n_s": ("impulse, N·s", 1.0, 1),
    "cop_path_m": ("path of the CoP, mm", 1e3, 1),
}


def study_page(
    name: str, study: Study, rows: Sequence[Mapping[str, Any]], steps_of_recordings: Sequence[Steps | None]
) -> str:
    """Return one HTML file, which loads nothing from anywhere.

    `rows` and `steps_of_recordings` are in the order of study.yaml; None: a recording without steps.
    """
    missing = [line for line in rows if line["missing"]]
    persons = {recording.person for recording in study.recordings}
    steady = sum(len(steps.steady) for steps in steps_of_recordings if steps is not None)
    parts = [
        facts((str(len(rows)), "recordings"), (str(len(persons)), "persons"), (str(steady), "steady steps"),
              (str(len(missing)), "recordings with something missing")),
        _recordings(rows, steps_of_recordings),
    ]  # fmt: skip
    if missing:
        parts.append(
            section(
                "Missing",
                table(
                    ("recording", "what and why"), [(line["recording"], line["missing"]) for line in missing], (0, 1)
                ),
            )
        )
    remarks = [(line["recording"], line["remarks"]) for line in rows if line.get("remarks")]
    if remarks:
        parts.append(section("Remarks", table(("recording", "its steps"), remarks, (0, 1))))
    parts += [_comparison(study, steps_of_recordings, *pair) for pair in _compared_settings(study)]
    about = [f"calibrations {', '.join(map(str, study.calibrations))}"] if study.calibrations else []
    return page(f"Study {name}", "Means are of steady steps, ± is a standard deviation over steps", parts, about)


def _recordings(rows: Sequence[Mapping[str, Any]], steps_of_recordings: Sequence[Steps | None]) -> str:
    table_rows = []
    for line, steps in zip(rows, steps_of_recordings, strict=True):
        cells = [line["person"], line["session"], line["condition"], line["recording"]]
        for foot in ("left", "right"):
            steady = steps.of(foot).steady if steps is not None else None
            cells.append(str(len(steady)) if steady is not None else "–")
            for name in ("stance_s", "peak_force_n"):
                _, factor, digits = _FIGURES[name]
                known = steady[name][np.isfinite(steady[name])] * factor if steady is not None else np.empty(0)
                spread = f" ± {known.std(ddof=1):.{digits}f}" if len(known) > 1 else ""
                cells.append(f"{known.mean():.{digits}f}{spread}" if len(known) else "–")
        table_rows.append(cells)
    figures = [f"{foot}: {what}" for foot in ("left", "right") for what in ("steady", "stance, s", "peak, N")]
    return section(
        "Recordings", table(("person", "session", "condition", "recording", *figures), table_rows, (0, 1, 2, 3))
    )


def _compared_settings(study: Study) -> list[tuple[Setting, Setting]]:
    """Return the settings that somebody has both of: differing in session or condition alone; where none do, all."""
    persons: dict[Setting, set[str]] = {}
    for recording in study.recordings:
        persons.setdefault((recording.session, recording.condition), set()).add(recording.person)
    pairs = [pair for pair in combinations(persons, 2) if persons[pair[0]] & persons[pair[1]]]
    return [pair for pair in pairs if pair[0][0] == pair[1][0] or pair[0][1] == pair[1][1]] or pairs


def _comparison(study: Study, steps_of_recordings: Sequence[Steps | None], first: Setting, second: Setting) -> str:
    """Return the section that compares two settings: over persons where FEWEST have both, else of each person alone."""
    sessions: dict[tuple[str, Setting], Steps] = {}
    repeated = []
    for recording, steps in zip(study.recordings, steps_of_recordings, strict=True):
        setting = (recording.session, recording.condition)
        if steps is None or setting not in (first, second):
            continue
        if (recording.person, setting) in sessions:
            repeated.append(str(recording.folder))
        else:
            sessions[recording.person, setting] = steps
    persons = [
        p for p in dict.fromkeys(r.person for r in study.recordings) if {(p, first), (p, second)} <= sessions.keys()
    ]
    names = [", ".join(filter(None, setting)) for setting in (first, second)]
    parts = []
    if repeated:
        parts.append(
            paragraph(f"Not compared, since the person has an earlier recording of the same: {', '.join(repeated)}")
        )
    mixed = [p for p in persons if sessions[p, first].calibrations != sessions[p, second].calibrations]
    if mixed:
        parts.append(
            paragraph(
                f"{', '.join(mixed)}: the sessions have different calibrations. Of a person alone, the uncertainty of "
                "both is in the intervals; of several persons, their scatter has it"
            )
        )
    for foot in ("left", "right"):
        pair_of_person = {p: (sessions[p, first].of(foot), sessions[p, second].of(foot)) for p in persons}
        pair_of_person = {
            person: pair
            for person, pair in pair_of_person.items()
            if min(len(steps.steady) for steps in pair) >= FEWEST
        }
        pairs = list(pair_of_person.values())
        if not pairs:
            parts.append(paragraph(f"{foot}: nobody has {FEWEST} steady steps in both"))
        elif len(pairs) >= FEWEST:
            differences = {name: paired_difference(pairs, name) for name in _FIGURES}
            parts.append(
                _compared(f"{foot}, {len(pairs)} persons", names, differences, compare_paired_curves(pairs), pairs)
            )
        else:
            for person, pair in pair_of_person.items():
                differences = {name: difference_of_sessions(*pair, name) for name in _FIGURES}
                parts.append(_compared(f"{foot}, {person}", names, differences, compare_curves(*pair), [pair]))
    return section(f"{names[1]} less {names[0]}", *parts)


def _compared(
    title: str,
    names: Sequence[str],
    differences: Mapping[str, Interval],
    test: CurveTest,
    pairs: Sequence[tuple[Steps, Steps]],
) -> str:
    lines = []
    for name, interval in differences.items():
        words, factor, digits = _FIGURES[name]
        value, low, high = (f"{bound * factor:+.{digits}f}" for bound in (interval.value, interval.low, interval.high))
        lines.append((words, value, f"{low} to {high}"))
    spans = ", ".join(f"{low:.0f} to {high:.0f} %" for low, high in test.spans_percent) or "nowhere"
    means = [np.mean([mean_curve(pair[at].steady.curves["f_z_n"])[0] for pair in pairs], axis=0) for at in (0, 1)]
    plot = Plot(Axis("% of stance", 0.0, 100.0), axis("f_z, N", *means), height=260)
    for at, (curve, words) in enumerate(zip(means, names, strict=True)):
        plot.line(PERCENT, np.asarray(curve, np.float64), at, words)
    caption = f"f_z over stance, {title}: differs {spans} (p = {test.p_whole:.4f}, {test.n_permutations} permutations)"
    return row(figure(plot.svg(caption), caption)) + table(("figure", "difference", "95 % interval"), lines)
