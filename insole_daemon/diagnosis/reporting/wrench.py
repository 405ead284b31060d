"""The report of a diagnosis: findings and remedies first, then figures for a reviewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...report import page
from ...report.insole_map import word_map
from ...report.plot import Plot, axis
from ...skin.geometry import PRESSURE_TAXELS
from ..model.placement import place_of
from ..places import place_in_words
from ..result import Diagnosis, RecordingResult
from . import first_page, numbers
from .physical_units import course_pa, rms_force_n, rms_kpa
from .what_now import what_now

CHANNELS = ["f_z", "m_x", "m_y"]
NO_PLACE_OF_PHYSICS = ("frame_loss", "noise_burst", "reference_fault", "clock")  # reported in the text only
SHOWN_S = 6.0  # length of the trace; a heel strike is visible


def html(diagnosis: Diagnosis) -> str:
    """Return the report as one self-contained HTML file."""
    foot = diagnosis.results[0].seen.layout.foot
    lead = f"{first_page.verdict_sentence(diagnosis)} Recorded in {', '.join(diagnosis.recordings)}."
    known = {result.seen.load_is_known for result in diagnosis.results}
    against = (
        "a simulation" if diagnosis.against == "simulation" else "a known pressure" if known == {True} else "a force"
    )
    return page.page(f"Diagnosis of the {foot} insole against {against}", lead, _sections(diagnosis), _about(diagnosis))


def _about(diagnosis: Diagnosis) -> list[str]:
    """Return the insole and the calibration in words."""
    seen = diagnosis.results[0].seen
    insole = page.insole_label(seen.layout.foot, seen.layout.identities[:, 0].tolist())
    if seen.has_own_curves:
        return [insole, "no calibration: the curves that fit these recordings best"]
    recordings = ", ".join(map(str, seen.calibration.provenance.get("recordings", ())))
    calibration = f"calibration made of {recordings}" if recordings else "calibration of unknown recordings"
    if seen.is_estimated is not None:
        place = place_in_words(place_of(seen.is_estimated, seen))
        calibration += f"; it does not list {place}, whose load is estimated from the readings there"
    return [insole, calibration]


def _sections(diagnosis: Diagnosis) -> list[str]:
    """Return the sections of the report."""
    return [
        _facts(diagnosis),
        page.section("What was found", first_page.findings(diagnosis)),
        *([page.section("What to do now", page.items(now))] if (now := what_now(diagnosis)) else []),
        *([page.section("Where", _places(diagnosis))] if diagnosis.findings else []),
        *(
            page.section(f"Before and after, on rows that were held out: {result.seen.name}", _trace(result))
            for result in diagnosis.results
        ),
        page.section("What these recordings cannot tell", numbers.limits(diagnosis)),
        page.section("What each term explains alone", _singles(diagnosis.results[0])),
        page.section("Parameters", numbers.parameters(diagnosis)),
        page.section("Noise and residual", _noise(diagnosis)),
    ]


def _places(diagnosis: Diagnosis) -> str:
    """Return the map of the findings by taxel, toes up."""
    layout = diagnosis.results[0].seen.layout
    words: dict[int, list[str]] = {}
    everywhere = []
    for finding in diagnosis.findings:
        if finding.effect in NO_PLACE_OF_PHYSICS:
            continue
        if finding.where.scope == "insole":
            everywhere.append(finding.effect.replace("_", " "))
            continue
        for slot in finding.where.slots(layout).tolist():
            words.setdefault(slot, []).append(finding.effect.replace("_", " "))
    text = "What explains most at single places. Toes are up, the wearer's left is left."
    if everywhere:
        text += f" Everywhere: {', '.join(dict.fromkeys(everywhere))}."
    if not words:
        return page.paragraph(f"Everywhere: {', '.join(dict.fromkeys(everywhere))}.")
    taxels = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout))).tolist()
    shown = {slot: words.get(slot, ["nothing"])[0] for slot in taxels}
    return page.figure(word_map(layout, shown, "nothing", "what was found where"), text)


def _facts(diagnosis: Diagnosis) -> str:
    heldout = diagnosis.heldout
    known = [result for result in diagnosis.results if result.seen.load_is_known]
    facts = []
    for errors in (heldout, heldout["f_z"]) if "f_z" in heldout else (heldout,):
        before, after, floor = (_error(errors, name, known) for name in ("before", "after", "floor"))
        quantity = "a reading" if errors["unit"] == "count" else "the force"
        facts += [
            (before, f"error of {quantity} before"),
            (after, "error after"),
            (floor, "noise: no model gets below"),
        ]
    if known:
        before_n, after_n = rms_force_n(known)
        facts.append((f"{before_n:.1f} → {after_n:.1f} N", "of the force of all taxels under the known pressure"))
    facts += [
        (f"{heldout[name]['before']:.2f} → {heldout[name]['after']:.2f} N·m", f"of the moment {name}")
        for name in ("m_x", "m_y")
        if name in heldout
    ]
    return page.facts(*facts)


def _error(errors: Mapping[str, Any], name: str, known: Sequence[RecordingResult]) -> str:
    """Return an error in its unit; counts also in kPa, by the curves in use."""
    if errors["unit"] != "count":
        return f"{errors[name]:.1f} {errors['unit']}"
    return f"{errors[name]:.1f} counts, {rms_kpa(known, errors[name]):.2f} kPa"


def _trace(result: RecordingResult) -> str:
    """Return the plots of the load and the error over the SHOWN_S in which the findings change most."""
    seen, figures = result.seen, result.figures
    size = max(round(SHOWN_S / seen.step_s), 10)
    cumulative_gain = np.cumsum(
        np.where(figures.known, figures.course_before[:, 0] ** 2 - figures.course_after[:, 0] ** 2, 0.0)
    )
    start = int(np.argmax(cumulative_gain[size:] - cumulative_gain[:-size])) if len(cumulative_gain) > size else 0
    rows = slice(start, start + size)
    t_s, force = seen.t_s[rows], seen.reference.at(seen.reference_s)[rows, 0]
    before, after = figures.course_before[rows, 0], figures.course_after[rows, 0]
    time = axis("time, s", t_s)
    errors = [("N", before, after)]
    load_name = "force, N"
    if seen.load_is_known:
        force, load_name = force * 1e-3, "pressure, kPa"
        before_pa, after_pa = (
            course_pa(result, course)[rows] for course in (figures.course_before, figures.course_after)
        )
        errors = [("counts", before, after), ("kPa", before_pa * 1e-3, after_pa * 1e-3)]
    load = Plot(time, axis(load_name, force), height=150)
    load.line(t_s, force, 2)
    plots = [load.svg("load over time")]
    for unit, before_values, after_values in errors:
        plot = Plot(time, axis(f"error, {unit}", before_values, after_values), height=220)
        plot.line(t_s, before_values, 1, "the model as handed in")
        if result.refined.shares:
            plot.line(t_s, after_values, 0, "with what was found")
        plots.append(plot.svg(f"error before and after in {unit}"))
    of_curves = " Counts are converted by the slope of the curves in use at each reading." if seen.load_is_known else ""
    return page.figure(
        "".join(plots),
        f"The load by the reference and the model's error on held-out rows: the {t_s[-1] - t_s[0]:.0f} s in which the "
        f"findings change most.{of_curves}",
    )


def _singles(result: RecordingResult) -> str:
    if not result.candidates:
        return page.paragraph("No term explains more than noise does.")
    rows = [(word.replace("_", " "), f"{gain:.2f}", f"{score:.2f}") for word, gain, score in result.candidates]
    text = "Mean squared error that a term removes by itself, in variances of the noise, and the same less its penalty."
    return page.paragraph(text) + page.table(("term", "removes", "less its penalty"), rows)


def _noise(diagnosis: Diagnosis) -> str:
    rows = []
    for result in diagnosis.results:
        names = (
            [f"{board}.{triangle}" for board, triangle in result.seen.layout.identities.tolist()]
            if result.seen.load_is_known
            else CHANNELS
        )
        noise, excess = result.figures.lack_of_fit.noise, result.figures.lack_of_fit.excess
        for name, level, slow in zip(names, noise.tolist(), excess.tolist(), strict=True):
            rows.append((result.seen.name, name, f"{np.sqrt(level):.2f}", f"{np.sqrt(slow):.2f}"))
    text = (
        "The residual, in units of the noise expected from counts, time stamps and the reference: its fast part, which "
        "is noise, and its slow part, which is not."
    )
    return page.paragraph(text) + page.table(("recording", "channel", "fast", "slow"), rows)
