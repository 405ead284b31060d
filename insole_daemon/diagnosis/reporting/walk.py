"""The page of a diagnosis from walks: page one for who knows gait, then the reviewer's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ...report import page
from ...report.bars import bars
from ...report.plot import Plot, axis
from ..foot import figures
from ..foot.diagnosing import WalkDiagnosis
from ..foot.hypothesis import Hypothesis
from ..foot.naming import PRICES, Naming, Tried
from . import first_page, numbers

SHOWN_S = 6.0  # so that a heel strike can be seen
MOST_ROWS = 14


def html(diagnosis: WalkDiagnosis) -> str:
    """One file, complete in itself."""
    foot = diagnosis.explained.evidence.parts[0].walk.layout.foot
    lead = f"{first_page.verdict(diagnosis)} Recorded in {', '.join(diagnosis.recordings)}."
    return page.page(f"Diagnosis of the {foot} insole, walking", lead, parts(diagnosis))


def parts(diagnosis: WalkDiagnosis) -> list[str]:
    """Its sections."""
    return [
        _facts(diagnosis),
        page.section("What was found", first_page.findings(diagnosis)),
        page.section("Before and after, on steps it had not seen", page.row(_trace(diagnosis), _stairs(diagnosis))),
        page.section("What these recordings cannot tell", numbers.limits(diagnosis)),
        page.section("Could it be chance, or denoising?", _chance(diagnosis)),
        page.section("What was tried, and lost by how much", _tried(diagnosis)),
        page.section("Parameters", numbers.parameters(diagnosis)),
        page.section("Clocks and noise", _clocks(diagnosis)),
    ]


def _facts(diagnosis: WalkDiagnosis) -> str:
    heldout = diagnosis.heldout
    steps = sum(len(part.contacts) for camp in diagnosis.camps for part in camp.evidence.parts)
    return page.facts(
        (f"{heldout['before']:.1f} N", "error of the force before"),
        (f"{heldout['after']:.1f} N", "error after"),
        (f"{heldout['floor']:.1f} N", "noise: no model gets below"),
        (f"{heldout['m_y']['before']:.1f} → {heldout['m_y']['after']:.1f} N·m", "of the moment m_y"),
        (f"{steps}", "steps were looked at"),
    )


def _trace(diagnosis: WalkDiagnosis) -> str:
    """The force and its error where the explanation changes most, over a few steps."""
    explained = diagnosis.explained
    evidence, best, static = explained.evidence, explained.decided.best, explained.naming.static
    assert best.heldout is not None
    handed_in = Hypothesis(evidence, ()).unexplained(static.fitted)[:, 0]
    part = evidence.parts[0]
    rows = np.flatnonzero(evidence.of_part == 0)
    at = rows[_window(part.rows_s, (handed_in[rows] - best.heldout[rows, 0]) ** 2 * evidence.asked[rows])]
    t = part.rows_s[at]
    time = axis("time, s", t)
    force = Plot(time, axis("force, N", part.force_n[at]), height=150)
    force.line(t, part.force_n[at], 2)
    before, after = handed_in[at] * part.noise[0], best.heldout[at, 0] * part.noise[0]
    left = Plot(time, axis("error, N", before, after), height=220)
    left.line(t, before, 1, "the model as handed in")
    if diagnosis.decided.best.words:
        left.line(t, after, 0, "with what was found")
    return page.figure(
        force.svg("force over time") + left.svg("error of the force, before and after"),
        f"Force of the shoe and what the model makes of it amiss, on steps that were held out: the {t[-1] - t[0]:.0f} "
        "s in which it matters most. A lag stands on the shoe's side here, a delay is taken out of the times.",
    )


def _stairs(diagnosis: WalkDiagnosis) -> str:
    """Held-out error as one effect after another is admitted."""
    explained = diagnosis.explained
    steps = _steps(explained.naming, explained.decided.best)
    names = ["static curves, recalibrated", *(f"with {_named(each)}" for each in steps[1:])]
    rms = [explained.rms(each) for each in steps]
    floor = figures.floor(explained.evidence)
    rows = [
        (name, value, f"{value:.1f}", 1 if i == 0 else 0)
        for i, (name, value) in enumerate(zip(names, rms, strict=True))
    ]
    return page.figure(
        bars(rows, "held-out error as effects are admitted", (floor, f"noise {floor:.1f}")),
        "Error of the force in N (RMS) on held-out steps, as one effect after the other is admitted.",
    )


def _steps(naming: Naming, best: Tried) -> list[Tried]:
    found = [naming.static]
    for size in range(1, len(best.terms)):
        parts = [each for each in naming.tried if len(each.terms) == size and each.terms < best.terms]
        if parts:
            found.append(min(parts, key=lambda each: each.left))
    return [*found, best] if best.terms else found


def _chance(diagnosis: WalkDiagnosis) -> str:
    gains, naming, decided = diagnosis.explained.gains_of_nulls, diagnosis.naming, diagnosis.decided
    text = (
        f"In {len(gains)} nulls made of these walks, with noise and nothing else, the best single effect takes away "
        f"{np.median(gains):.4f} of the noise's mean square, {gains.max():.4f} at the most. One more effect has to "
        f"take away {naming.price:.3f}, and "
        + ", or ".join(
            f"{whole:.2g} of what the static model leaves above the noise and {rest:.0%} of what the smaller set leaves"
            for whole, rest in PRICES
        )
        + ". An effect whose decoy, the same filter run backwards, takes away more than half as much is denoising; of "
        "a lag, as much."
    )
    rows = [
        (
            word,
            f"{decided.alone[word].left:.3f}" if word in decided.alone else "–",
            f"{left:.3f}",
            f"{decided.best.left:.3f}",
        )
        for word, left in decided.decoys.items()
    ]
    columns = ("effect", "left without it", "with its decoy", "with the chosen set")
    return page.paragraph(text) + (page.table(columns, rows) if rows else "")


def _tried(diagnosis: WalkDiagnosis) -> str:
    explained, best = diagnosis.explained, diagnosis.decided.best
    ranked = sorted(diagnosis.naming.tried, key=lambda each: each.left)
    rows = [
        (_named(each), f"{explained.rms(each):.2f}", f"{explained.rms(each, 2):.3f}", f"{each.left:.3f}",
         "chosen" if each is best else f"{each.left - best.left:+.3f}")
        for each in ranked[:MOST_ROWS]
    ]  # fmt: skip
    text = (
        f"{len(ranked)} sets were judged on held-out steps, each with its own recalibration and timing. The last "
        "columns are mean squares of all three sums after smoothing, in units of the noise."
    )
    return page.paragraph(text) + page.table(("effects", "f_z, N", "m_y, N·m", "left", "against the chosen"), rows)


def _clocks(diagnosis: WalkDiagnosis) -> str:
    parts = {part.walk.name: part for camp in diagnosis.camps for part in camp.evidence.parts}
    rows = [
        (name, part.walk.shoe.clock, f"{offset:+.4f}", f"{rate * 1e6:+.0f}", f"{len(part.contacts)}",
         f"{part.walk.noise[0]:.1f}", f"{part.walk.shoe.noise[0]:.1f}")
        for name, (offset, rate) in zip(diagnosis.recordings, diagnosis.clocks.tolist(), strict=True)
        for part in [parts[name]]
    ]  # fmt: skip
    columns = (
        "recording",
        "shoe's clock",
        "offset, s",
        "rate, ppm",
        "steps",
        "noise of the insole, N",
        "of the shoe, N",
    )
    return page.table(columns, rows, (0, 1))


def _named(tried: Tried) -> str:
    names = [
        f"{'backwards ' * t.backwards}{t.word}{f' on board {t.boards[0]}' if t.boards else ''}" for t in tried.terms
    ]
    return " + ".join(sorted(names)) or "static curves alone"


def _window(t_s: Array, change: Array) -> NDArray[np.intp]:
    """Rows of the SHOWN_S in which `change` (n,) is greatest."""
    n = min(max(round(SHOWN_S / float(t_s[1] - t_s[0])), 2), len(t_s))
    total = np.concatenate([[0.0], np.cumsum(change)])
    first = int(np.argmax(total[n:] - total[:-n]))
    return np.arange(first, first + n)
