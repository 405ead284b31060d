"""The stages of `insole diagnose` for one recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..physics.effect import Effect, Where
from ..physics.effects import laws
from ..recording.loading import FootRecording
from . import sentences
from .export.as_effect import effect_of, preloads
from .finding import Finding, Quantity, heldout_of
from .gathering import join_places
from .model.blocks import RECALIBRATIONS, BlockDesign
from .model.design import Design
from .model.nuisance import Priors
from .model.refine import refine
from .observations.reading_faults import ReadingFaults, reading_faults
from .observations.wrench import WrenchObservation
from .observing import refuse_unloaded
from .parameters import parameters_of
from .result import RecordingResult
from .searching import Searched
from .searching import search as search_terms
from .select import confidence
from .select.count_figures import count_figures
from .select.search import FittedSet, SubsetSearch
from .select.wrench_figures import Figures
from .static_findings import static_findings
from .terms import TERMS
from .timings import LEAST_DELAY_S, is_nuisance, off_by_clock, own_clock, timing_effects, timing_findings
from .trimming import LEAST_GAINED, figures_of, stronger, trimmed
from .unexplained import (
    STRONGER,
    explains_little,
    is_unexplained,
    least_beside,
    most_null,
    squared_rest,
    timing_energy,
    unknown,
)


def diagnose_one(seen: WrenchObservation, foot: FootRecording, progress: Callable[[str], None]) -> RecordingResult:
    """Faults of readings, regression, search, refinement, figures, findings."""
    refuse_unloaded(seen)
    faults = reading_faults(foot, seen)
    seen = faults.observation
    progress("comparing with every term of the library")
    searched = search_terms(seen, faults, foot)
    first = searched.first
    whole, search, timing = first.search.design, first.search, first.timing
    progress("measuring the error on blocks that were held out")
    kept = trimmed(search, search.simplified(first.best, confidence.CLOSE), timing)
    is_unknown = is_unexplained(kept.figures, whole, kept.refined, timing)
    if is_unknown:
        kept = stronger(search, kept, least_beside(kept.figures, whole, kept.refined), timing)
    refined, order, found = kept.refined, kept.order, kept.figures
    parameters = [parameters_of(refined, i, foot) for i in range(len(order))]
    words = [each.word for each in refined.design.candidates]
    nuisances = [i for i in order if is_nuisance(words[i], parameters[i])]
    is_late = abs(timing.delay_s) >= LEAST_DELAY_S + seen.latest_s
    if nuisances or not is_late:
        found = figures_of(refined, order, timing, nuisances, 0.0 if is_late else timing.delay_s)
    found, findings, effects = _placed(searched, seen, found)
    found = _with_faults(found, faults)
    found = replace(found, before=np.sqrt(found.before**2 + off_by_clock(seen)))
    put_right = [each for each in faults.findings if each.effect == "bit_shift"]
    effects += [e for e in (effect_of(f.effect, f.where, f.parameters, seen) for f in put_right) if e is not None]
    if findings and not found.after[0] < found.before[0]:
        findings, effects, is_unknown = [], [], True  # what makes held-out rows worse explains nothing
    if not (findings or order or first.words or _explain(faults, found, whole)):
        is_unknown |= float(min(found.before[0], found.after[0])) > most_null([(found, whole)]) * float(found.floor[0])
    if is_unknown:
        findings.append(unknown(seen, found, whole))
    # Beside a wrong clock a delay is a part of that clock's offset.
    has_clock = any(word == "clock" for i, word in enumerate(words) if i not in nuisances)
    named = tuple(word for word in first.words if word == "lag" or (is_late and not has_clock))
    if not is_unknown or timing_energy(whole, timing) > STRONGER * squared_rest(found, whole):
        findings += timing_findings(seen, first, searched.others, named, found, float(whole.least.max()))
    effects += timing_effects(first, named)
    for i, gain in zip(order, found.gains, strict=True):
        if i in nuisances:
            continue
        if words[i] == "clock":
            offset = parameters[i]["offset_s"]
            parameters[i]["offset_s"] = replace(offset, value=offset.value - timing.delay_s)
        where = refined.design.candidates[i].where
        if words[i] == "preload" and seen.load_is_known:
            effects += preloads(where, refined.of_laws.shares[i], seen)
        elif (effect := effect_of(words[i], where, parameters[i], seen)) is not None:
            effects.append(effect)
        findings.append(_finding(words[i], where, parameters[i], gain, seen, found, search, kept.best, i))
    if isinstance(whole, BlockDesign) and whole.priors.has_loose_curves and not is_unknown and order:
        findings += static_findings(refined, found)
    findings = list(join_places(findings, seen))
    effects.sort(key=lambda each: np.inf if each.law.order is None else each.law.order)  # the order of the signal path
    findings += [each for each in faults.findings if not _is_next_to_nothing(each, found)]
    result = RecordingResult(
        faults, whole, refined, found, (), tuple(effects), _singles(search),
        tuple(not_identifiable(whole, {each.effect for each in findings}, searched.priors)), is_unknown, timing,
    )  # fmt: skip
    return replace(result, findings=(*findings, *own_clock(result)))


def _finding(
    word: str,
    where: Where,
    parameters: dict[str, Quantity],
    gain: float,
    seen: WrenchObservation,
    found: Figures,
    search: SubsetSearch[Any],
    best: FittedSet,
    i: int,
) -> Finding:
    """What is said of candidate `i` of a set, which takes away `gain` of the mean square."""
    alternatives, margin = search.alternatives(best, i, confidence.SAME), search.margin(best, i)
    said = (
        sentences.of_constant(parameters["offset"].value)
        if "offset" in parameters
        else sentences.of_effect(word, where, parameters)
    )
    return Finding(
        effect=word, alternatives=tuple(other for other, _ in alternatives[:1]), foot=seen.layout.foot, where=where,
        equation=laws()[word].equation if word in laws() else "", recordings=(seen.name,), parameters=parameters,
        explains=gain, confidence=confidence.confidence(margin, found.left_share), margin=margin, sentence=said,
        **heldout_of(seen.load_is_known, float(np.sqrt(found.after[0] ** 2 + gain)), float(found.after[0])),
    )  # fmt: skip


def _placed(searched: Searched, seen: WrenchObservation, found: Figures) -> tuple[Figures, list[Finding], list[Effect]]:
    """What is said of where the taxels are, as findings and effects; figures with the model as handed in before it."""
    unplaced = searched.unplaced
    if not searched.placed or unplaced is None:
        return found, [], []
    before = count_figures(refine(unplaced.search.design, ()), ()).before
    gained = max(float(before[0] ** 2 - found.before[0] ** 2), 0.0) / len(searched.placed)
    findings, effects = [], []
    found = replace(found, before=before)
    for each in searched.placed:
        effect = effect_of(each.word, each.where, each.parameters, seen)
        if effect is not None:
            effects.append(effect)
        findings.append(
            Finding(
                effect=each.word, foot=seen.layout.foot, where=each.where, equation=laws()[each.word].equation,
                recordings=(seen.name,), parameters=each.parameters, explains=gained, margin=each.margin,
                confidence=confidence.confidence(each.margin, found.left_share),
                sentence=sentences.of_effect(each.word, each.where, each.parameters),
                **heldout_of(seen.load_is_known, float(np.sqrt(found.after[0] ** 2 + gained)), float(found.after[0])),
            )
        )  # fmt: skip
    return found, findings, effects


def _with_faults(found: Figures, faults: ReadingFaults) -> Figures:
    """With what was put right before the regression: the model as handed in knows nothing of it."""
    return replace(found, before=np.sqrt(found.before**2 + faults.explained))


def _explain(faults: ReadingFaults, found: Figures, whole: Design | BlockDesign) -> bool:
    """Whether faults of the readings stand for the mismatch: they are there, and not beside a larger one."""
    is_unknown = any(each.effect == "unknown" for each in faults.findings)
    return is_unknown or (bool(faults.findings) and not explains_little(found, whole))


def _is_next_to_nothing(each: Finding, found: Figures) -> bool:
    """Whether single taxels take away so little that a material which differs from taxel to taxel does as much."""
    whole = float(found.before[0] ** 2 - found.after[0] ** 2)
    return each.where.scope == "taxel" and bool(each.parameters) and each.explains < LEAST_GAINED * whole


def _singles(search: SubsetSearch[Any]) -> tuple[tuple[str, float, float], ...]:
    n = search.design.n_rows
    found: dict[str, tuple[float, float]] = {}
    for each in search.singles():
        word = search.design.candidates[each.chosen[0]].word
        if np.isfinite(each.score) and (word not in found or each.score / n > found[word][1]):
            found[word] = (each.gain / n, each.score / n)
    ordered = sorted(found.items(), key=lambda item: -item[1][1])[:8]
    return tuple((word, gain, score) for word, (gain, score) in ordered)


def not_identifiable(whole: Design | BlockDesign, found: set[str], priors: Priors) -> list[dict[str, str]]:
    """Terms whose share this recording does not determine: its standard deviation is over a third of the prior's."""
    rows = []
    for term in TERMS:
        if term.word in found or term.is_internal or term.is_of_load:
            continue
        why = term.needs(whole.load)
        if why is None and priors.share and term.word in ("gain", "stiffening"):
            why = f"the simulated load itself is off by about {priors.share:.0%} and {1e3 * priors.timing_s:.0f} ms"
        if why is None and priors.has_loose_curves and term.word in RECALIBRATIONS:
            why = "the calibration was made with the memory at work, and its curves contain a part of it"
        if why is None:
            own = [c for c in whole.candidates if c.word == term.word]
            if term.word == "delay" and whole.load.observation.offset_is_free:
                why = "the clock's offset is free, and a delay of all boards looks the same"
            elif term.plausible and own:
                k = own[0].columns[0]
                std = 1.0 / np.sqrt(max(float(whole.gram[k, k]), 1e-300))
                if std > term.plausible / 3.0:
                    what = "readings depend" if whole.load.is_known else "the wrench depends"
                    why = f"{what} little on it here, or on other terms in the same way"
            elif not own:
                why = "the recording is too short, or has nothing to show it by"
        if why is not None:
            rows.append({"effect": term.word, "why": why, "record_instead": term.shown_by(whole.load)})
    return rows
