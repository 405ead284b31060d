"""For a reviewer: what was tried and lost, parameters and what hangs together in them, clocks, faults, limits."""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from ...report import page
from ..agreement import foretold
from ..diagnosing import Diagnosis
from ..explained import LOOPS
from ..finding import Finding, Quantity
from ..fit import Hypothesis
from ..groups import Named
from ..naming import N_FOLDS, PRICES
from ..outcome import Outcome
from ..places import said, where
from .meanings import FAULTS

CORRELATED = 0.9
MOST_ROWS = 14


def tried(diagnosis: Diagnosis, named: Named) -> str:
    """All subsets that were judged on held-out blocks, the best first, and how much worse than the best each is."""
    best = named.naming.best
    ranked = sorted(named.naming.tried, key=lambda each: each.left_heldout)
    rows = [
        (
            " + ".join(each.words) or "static curves alone",
            f"{each.left:.1%}",
            f"{each.left_heldout:.1%}",
            "chosen" if each is best else f"{each.left_heldout - best.left_heldout:+.1%}",
        )
        for each in ranked[:MOST_ROWS]
    ]
    place = said(where(named.group.slots, diagnosis.insole.slots, diagnosis.insole.layout))
    more = f" {len(ranked) - MOST_ROWS} others leave more." if len(ranked) > MOST_ROWS else ""
    text = (
        f"{place[:1].upper()}{place[1:]}: {len(ranked)} sets of effects were judged on held-out blocks ({N_FOLDS} "
        f"folds), each with its own curves and clocks. What is left is a share of what the static model leaves above "
        f"the noise.{more}"
    )
    columns = ("effects", "left where fitted", "left where held out", "against the chosen")
    return page.paragraph(text) + page.table(columns, rows)


def price() -> str:
    """What one more effect has to be worth."""
    return page.paragraph(
        "One more effect is admitted where it takes away more than "
        + ", or ".join(
            f"{whole:.2g} of what the static model leaves above the noise and {rest:.0%} of what the smaller set leaves"
            for whole, rest in PRICES
        )
        + ", on blocks that were held out."
    )


def decoys(diagnosis: Diagnosis) -> str:
    """The copies that are no physics, in the place of each effect."""
    rows = [
        (
            each.word,
            each.kind,
            said(where(named.group.slots, diagnosis.insole.slots, diagnosis.insole.layout)),
            f"{each.effect_left_heldout:.1%}",
            f"{each.left:.1%}" if each.as_good else f"≥ {each.left:.1%}",
            "as good: not named" if each.as_good else "worse",
        )
        for named in diagnosis.located.named
        for each in named.naming.decoys
    ]
    if not rows:
        return page.paragraph("No effect was about to be named that has a decoy.")
    text = (
        "Each effect that was about to be named was replaced by copies of itself that no material can do, with as "
        "many parameters, the same bounds, starts and folds. What does not leave clearly less than these is not named."
    )
    columns = ("effect", "its decoy", "where", "left with the effect", "left with the decoy", "the decoy is")
    return page.paragraph(text) + page.table(columns, rows, (0, 1, 2, 5))


def recordings(diagnosis: Diagnosis) -> str:
    """Every recording, foretold by what the others know of the physics."""
    insole = diagnosis.insole
    rows = [
        (
            said(where(named.group.slots, insole.slots, insole.layout)),
            each.recording,
            f"{each.before:.3f}",
            f"{each.after:.3f}",
        )
        for named in diagnosis.located.named
        if named.naming.best.words
        for each in foretold(named)
    ]
    text = (
        "Every recording held out as a whole: its curves and its clock are its own, fitted on other blocks of it, the "
        "parameters of the physics those of the other recordings. RMS of what is left, in units of a reading's noise."
    )
    columns = ("where", "recording", "static curves alone", "with the effects as the others have them")
    return page.paragraph(text) + page.table(columns, rows, (0, 1))


def parameters(diagnosis: Outcome) -> str:
    """Of every finding, with standard deviations."""
    rows = [
        (each.effect, name, _values(quantity), quantity.unit)
        for each in diagnosis.findings
        for name, quantity in each.parameters.items()
    ]
    if not rows:
        return page.paragraph("There are no parameters to tell.")
    note = "± is one standard deviation (jackknife over the folds: it sees what the family misses, too)."
    if any(each.effect in LOOPS for each in diagnosis.findings):
        note += " amplitude_fraction: half the peak-to-peak of what the effect adds, over the span of the load."
    return page.table(("effect", "parameter", "value ± σ", "unit"), rows, (0, 1, 2, 3)) + page.paragraph(note)


def correlations(named: Named) -> str:
    """Pairs of parameters that can hardly be told apart."""
    names, matrix = _correlation(named)
    close = [
        (names[i], names[j], f"{matrix[i, j]:+.3f}")
        for i in range(len(names))
        for j in range(i)
        if abs(matrix[i, j]) > CORRELATED
    ]
    if not close:
        return page.paragraph(f"No two parameters of this explanation are correlated by more than {CORRELATED:g}.")
    text = f"Correlated by more than {CORRELATED:g}: only together are these known as well as their σ says."
    return page.paragraph(text) + page.table(("parameter", "and", "ρ"), close, (0, 1))


def clocks(diagnosis: Diagnosis) -> str:
    """Of each recording's reference."""
    rows = [
        (each.name, each.load.clock, f"{offset:+.4f}", f"{rate * 1e6:+.0f}", f"{each.t_s[-1]:.0f}", f"{len(each.t_s)}")
        for each, (offset, rate) in zip(diagnosis.observed, diagnosis.clocks.tolist(), strict=True)
    ]
    columns = ("recording", "reference's clock", "offset, s", "rate, ppm", "length, s", "blocks")
    return page.table(columns, rows, (0, 1))


def audit(diagnosis: Diagnosis) -> str:
    """Faults of readings and reference, and the noise."""
    noise = diagnosis.insole.noise_count
    parts = [
        page.paragraph(
            f"Noise of one reading: median {np.median(noise):.2f} counts, {np.min(noise):.2f} to {np.max(noise):.2f}, "
            f"of {len(noise)} taxels that were asked of "
            f"{len(diagnosis.insole.layout) * 10} in the layout; no model can be better than that."
        )
    ]
    faults = [each for each in diagnosis.findings if each.effect in FAULTS]
    if not faults:
        return parts[0] + page.paragraph("No fault of readings, frames or reference was found.")
    rows = [(each.effect, said(each.where), each.recordings[0], _when(each), each.sentence) for each in faults]
    return parts[0] + page.table(("fault", "where", "recording", "when", "what"), rows, range(5))


def limits(diagnosis: Outcome) -> str:
    """What these recordings cannot tell, and what to record instead."""
    rows = [(each["effect"], each["why"], each["record_instead"]) for each in diagnosis.not_identifiable]
    return page.table(("effect", "why it cannot be told", "record instead"), rows, range(3))


def _correlation(named: Named) -> tuple[list[str], Array]:
    """Names of θ, and (p, p) how they hang together by the slopes at the best fit."""
    fitted = named.naming.best.fitted
    jacobian = Hypothesis(named.group.evidence, fitted.candidates).jacobian(fitted)
    norm = np.linalg.norm(jacobian, axis=0)
    covariance = np.linalg.pinv(
        (jacobian / np.where(norm > 0, norm, 1.0)).T @ (jacobian / np.where(norm > 0, norm, 1.0))
    )
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    clock = [f"{what} of {each.name}" for each in named.group.evidence.observed for what in ("offset", "rate")]
    own = [f"{candidate.word} {name}" for candidate in fitted.candidates for name in candidate.names]
    return clock[: len(fitted.theta) - len(own)] + own, covariance / np.outer(size, size)


def _values(quantity: Quantity) -> str:
    pairs = zip(np.ravel(quantity.value), np.ravel(quantity.std), strict=True)
    return ", ".join(f"{value:.4g} ± {std:.2g}" for value, std in pairs)


def _when(finding: Finding) -> str:
    spans = [f"{a:.1f}–{b:.1f} s" for a, b in finding.when_s[:6]]
    more = f" and {len(finding.when_s) - 6} more" if len(finding.when_s) > 6 else ""
    return ", ".join(spans) + more or "always"
