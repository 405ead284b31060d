"""Diagnose one recording: the stages of `insole diagnose` up to its findings and effects."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..physics.effect import Effect, Where
from ..physics.effects import laws
from ..recording.loading import FootRecording
from . import sentences
from .backward_elimination import LEAST_GAINED, ValidatedSet, eliminate_backward, is_believed, keep_strong
from .caches import forget_cached, return_freed_memory
from .excitation import has_one_speed
from .export.as_effect import effect_of, preloads
from .finding import Finding, Quantity, heldout_of
from .gathering import join_places
from .model.blocks import BlockDesign
from .model.design import Design
from .model.nuisance import Priors
from .model.refine import Refined
from .model.regression import Timing
from .model.signal_path import model_pressure
from .observations.pad_temperature import with_pad_temperature
from .observations.reading_faults import ReadingFaults
from .observations.wrench import LEAST_TIMING_S, WrenchObservation
from .observing import refuse_unloaded
from .parameters import parameters_of
from .placements import faults_and_displacement
from .result import RecordingResult
from .search_result import SearchResult
from .searching import search as search_terms
from .select import confidence
from .select.search import FittedSet, SubsetSearch
from .select.wrench_errors import HeldoutErrors, wrench_errors
from .static_findings import static_findings
from .terms import TERMS
from .terms.term import SPEEDS
from .timings import clock_findings, is_nuisance, of_wrong_clock, off_by_clock, timing_effects, timing_findings
from .unexplained import (
    excess_square,
    explains_little,
    is_unexplained,
    lack_of_fit_without_companions,
    least_gain_beside_unknown,
    null_bound,
    relies_on_companions,
    timing_energy,
    unknown_finding,
)


def diagnose_one(seen: WrenchObservation, foot: FootRecording, progress: Callable[[str], None]) -> RecordingResult:
    """Return the result of one recording: faults of readings, search of effects, refinement, figures and findings."""
    refuse_unloaded(seen)
    faults, placements = faults_and_displacement(foot, seen)
    rezeros = [finding for finding in faults.findings if finding.effect == "rezero"]
    corrected = with_pad_temperature(faults.observation, seen, rezeros)
    before = (seen, faults.observation, faults.odd_taxels.seen)
    forget_cached(*(each for each in before if each is not corrected))
    return_freed_memory()
    seen, faults = corrected, replace(faults, observation=corrected)
    progress("comparing with every term of the library")
    searched = search_terms(seen, faults, placements, foot)
    first = searched.first
    whole, search, timing = first.search.design, first.search, first.timing
    progress("measuring the error on blocks that were held out")
    kept, is_unknown = _validated_terms(search, first.best, timing)
    selection = _selection(kept, timing, seen, foot)
    figures, findings, effects = _placement_findings(searched, seen, selection.figures)
    figures = _with_corrections(figures, faults, seen)
    effects += _bit_shift_effects(faults, seen)
    if findings and not figures.after[0] < figures.before[0]:
        findings, effects, is_unknown = [], [], True  # a placement that raises the held-out error explains nothing
    reported_timings = selection.reported_timings(first.words)
    if not (findings or selection.reported or reported_timings or whole.undone or _explain(faults, figures, whole)):
        is_unknown |= float(min(figures.before[0], figures.after[0])) > null_bound([(figures, whole)]) * float(
            figures.floor[0]
        )
    if is_unknown:
        findings.append(unknown_finding(seen, figures, whole))
        least_gain = least_gain_beside_unknown(figures, whole, excess_square(figures, whole))
        reported_timings = reported_timings if timing_energy(whole, timing) > least_gain else ()
    findings += timing_findings(seen, first, searched.others, reported_timings, figures, float(whole.least.max()))
    effects += timing_effects(first, reported_timings)
    effects += _term_effects(selection, seen)
    findings += _term_findings(selection, seen, figures, search)
    static, taken_up = static_findings(kept.refined, figures)
    findings += static if not is_unknown else []
    findings = list(join_places(findings, seen))
    effects.sort(key=lambda effect: np.inf if effect.law.order is None else effect.law.order)  # signal path
    without_terms, singles = whole.subset(()), _single_terms(search)
    undetermined = not_identifiable(whole, searched.priors, taken_up)
    del searched, first, whole, search  # their designs are large
    findings += _fault_findings(faults, kept.refined, findings, figures)
    reported = {finding.effect for finding in findings}
    result = RecordingResult(
        faults, without_terms, kept.refined, figures, tuple(findings), tuple(effects), singles,
        tuple(row for row in undetermined if row["effect"] not in reported), is_unknown, timing,
    )  # fmt: skip
    return replace(result, findings=_with_confidence([*findings, *clock_findings(result)], figures))


def _with_confidence(findings: Sequence[Finding], figures: HeldoutErrors) -> tuple[Finding, ...]:
    """Return the findings with the confidence of those that the search selected, and of what it left unexplained."""

    def stated(finding: Finding) -> float:
        if finding.margin is not None:
            return confidence.confidence(
                finding.margin, figures.residual_fraction, len(findings),
                confidence.is_of_triangles(finding.effect, finding.where),
            )  # fmt: skip
        is_unexplained_beside = finding.left > 0.0 and len(findings) > 1
        return confidence.UNKNOWN_BESIDE_OTHERS if is_unexplained_beside else finding.confidence

    return tuple(replace(finding, confidence=stated(finding)) for finding in findings)


def _validated_terms(search: SubsetSearch[Any], best: FittedSet, timing: Timing) -> tuple[ValidatedSet, bool]:
    """Return the terms that lower the held-out error, and whether the residual is an unknown effect.

    Beside an unknown effect, weak terms are removed, because they may describe a part of it. A walk is an unknown
    effect as a whole if most terms of its set are probably not there.
    """
    kept = eliminate_backward(search, search.simplify(best, confidence.CLOSE_SCORE), timing)
    design = search.design
    figures, refined = kept.figures, kept.refined
    is_full = len(kept.order) >= search.penalties.most_terms  # the search ended there, and not because nothing was left
    if is_full or not (design.load.is_known or is_believed(search, kept)):
        return keep_strong(search, kept, refined, np.inf, timing), True
    if is_unexplained(figures, design, refined, timing):
        measured, unexplained = refined, excess_square(figures, design)
    elif relies_on_companions(design, refined):
        measured = refined.without_internal_companions
        unexplained = lack_of_fit_without_companions(refined, design)
    else:
        return kept, False
    strong = keep_strong(search, kept, measured, least_gain_beside_unknown(figures, design, unexplained), timing)
    if strong.order and explains_little(strong.figures, design):  # only together with weaker ones
        strong = keep_strong(search, kept, refined, np.inf, timing)
    return strong, True


@dataclass(frozen=True, slots=True, eq=False)
class _Selection:
    """The selected terms of a recording with their parameters, by number of the candidate in the refined design."""

    kept: ValidatedSet
    parameters: tuple[dict[str, Quantity], ...]
    nuisances: tuple[int, ...]  # terms within the tolerance of a declared clock: not reported
    is_late: bool  # delay of the whole insole above the tolerance of the times
    figures: HeldoutErrors  # with nuisances in the model as handed in

    @property
    def words(self) -> tuple[str, ...]:
        """The effect word of each candidate."""
        return tuple(candidate.word for candidate in self.kept.refined.design.candidates)

    @property
    def reported(self) -> list[tuple[int, float]]:
        """Numbers and gains of the terms that are reported, the largest gain first."""
        gains = zip(self.kept.order, self.figures.gains, strict=True)
        return [(i, gain) for i, gain in gains if i not in self.nuisances]

    def reported_timings(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return which of the timings `words` are reported: beside a wrong clock, a delay is a part of its offset."""
        has_clock = any(word == "clock" for i, word in enumerate(self.words) if i not in self.nuisances)
        return tuple(word for word in words if word == "lag" or (self.is_late and not has_clock))


def _selection(kept: ValidatedSet, timing: Timing, seen: WrenchObservation, foot: FootRecording) -> _Selection:
    refined, figures = kept.refined, kept.figures
    parameters = [parameters_of(refined, i, foot) for i in range(len(kept.order))]
    words = [candidate.word for candidate in refined.design.candidates]
    nuisances = tuple(i for i in kept.order if is_nuisance(words[i], parameters[i], seen.latest_s))
    is_late = abs(timing.delay_s) >= LEAST_TIMING_S + seen.latest_s
    if not seen.load_is_known and (nuisances or not is_late):
        uncertain_s = 0.0 if is_late else timing.delay_s
        figures = wrench_errors(refined.design, refined, kept.order, timing, nuisances, uncertain_s)
    for i in kept.order:
        if words[i] == "clock" and i not in nuisances:
            offset = parameters[i]["offset_s"]
            parameters[i]["offset_s"] = replace(offset, value=offset.value - timing.delay_s)
            parameters[i]["rate"] = of_wrong_clock(parameters[i]["rate"])
    return _Selection(kept, tuple(parameters), nuisances, is_late, figures)


def _term_effects(selection: _Selection, seen: WrenchObservation) -> list[Effect]:
    """Return the effects of the model that the reported terms make."""
    effects: list[Effect] = []
    refined = selection.kept.refined
    for i, _ in selection.reported:
        where = refined.design.candidates[i].where
        if selection.words[i] == "preload" and seen.load_is_known:
            effects += preloads(where, refined.of_laws.shares[i], seen)
        elif (effect := effect_of(selection.words[i], where, selection.parameters[i], seen)) is not None:
            effects.append(effect)
    return effects


def _term_findings(
    selection: _Selection, seen: WrenchObservation, figures: HeldoutErrors, search: SubsetSearch[Any]
) -> list[Finding]:
    """Return the findings of the reported terms, the largest gain first."""
    best = selection.kept.best
    is_one_speed = seen.is_uniform and has_one_speed(seen.reference.at(seen.reference_s)[:, 0], seen.step_s)
    findings = []
    for i, gain in selection.reported:
        word, parameters = selection.words[i], selection.parameters[i]
        candidate = selection.kept.refined.design.candidates[i]
        where, is_like_others = candidate.where, is_one_speed and candidate.term.is_memory
        alternatives = [other for other, _ in search.alternatives(best, i, confidence.EQUAL_SCORE)]
        if is_like_others and not alternatives:
            alternatives = search.memories_alike(best, i)
        sentence = (
            sentences.of_constant(parameters["offset"].value)
            if "offset" in parameters
            else sentences.of_effect(word, where, parameters)
        )
        if is_like_others and alternatives:
            sentence += f" At one speed without holds, {alternatives[0]} looks the same: {SPEEDS} tell them apart."
        findings.append(
            Finding(
                effect=word, alternatives=tuple(alternatives[:1]), foot=seen.layout.foot,
                where=where, equation=laws()[word].equation if word in laws() else "", recordings=(seen.name,),
                parameters=parameters, explains=gain, margin=search.margin(best, i),
                sentence=sentence,
                **heldout_of(
                    seen.load_is_known, float(np.sqrt(figures.after[0] ** 2 + gain)), float(figures.after[0])
                ),
            )
        )  # fmt: skip
    return findings


def _bit_shift_effects(faults: ReadingFaults, seen: WrenchObservation) -> list[Effect]:
    """Return the effects of bit shifts that were corrected before the regression."""
    shifts = [finding for finding in faults.findings if finding.effect == "bit_shift"]
    effects = [effect_of(finding.effect, finding.where, finding.parameters, seen) for finding in shifts]
    return [effect for effect in effects if effect is not None]


def _placement_findings(
    searched: SearchResult, seen: WrenchObservation, figures: HeldoutErrors
) -> tuple[HeldoutErrors, list[Finding], list[Effect]]:
    """Return figures, findings and effects of the insole's placement, which the search fitted before the terms.

    The figures have the error of the model as handed in, which does not know the placement.
    """
    before = searched.before
    if not searched.placed or before is None:
        return figures, [], []
    gain = max(float(before[0] ** 2 - figures.before[0] ** 2), 0.0) / len(searched.placed)
    findings, effects = [], []
    figures = replace(figures, before=before)
    for placement in searched.placed:
        effect = effect_of(placement.word, placement.where, placement.parameters, seen)
        if effect is not None:
            effects.append(effect)
        findings.append(
            Finding(
                effect=placement.word, foot=seen.layout.foot, where=placement.where,
                equation=laws()[placement.word].equation, recordings=(seen.name,),
                parameters=placement.parameters, explains=gain, margin=placement.margin,
                sentence=sentences.of_effect(placement.word, placement.where, placement.parameters),
                **heldout_of(seen.load_is_known, float(np.sqrt(figures.after[0] ** 2 + gain)), float(figures.after[0])),
            )
        )  # fmt: skip
    return figures, findings, effects


def _with_corrections(figures: HeldoutErrors, faults: ReadingFaults, seen: WrenchObservation) -> HeldoutErrors:
    """Return `figures` of the model as handed in: before corrections of readings and of a declared clock."""
    before = np.sqrt(figures.before**2 + faults.explained)
    return replace(figures, before=np.sqrt(before**2 + off_by_clock(seen)))


def _explain(faults: ReadingFaults, figures: HeldoutErrors, design: Design | BlockDesign) -> bool:
    """Return whether faults of the readings explain the mismatch; they do not beside a larger one."""
    is_unknown = any(finding.effect == "unknown" for finding in faults.findings)
    return is_unknown or (bool(faults.findings) and not explains_little(figures, design))


def _fault_findings(
    faults: ReadingFaults, refined: Refined[Any], effects: Sequence[Finding], figures: HeldoutErrors
) -> list[Finding]:
    """Return the findings on faults of the readings that remain beside the findings `effects`, and are not negligible.

    A finding on taxels is left out if all of them are at the place of an unknown effect, or in triangles that snap:
    that may be what they show. Taxels of a triangle snap at different loads. So is a burst of noise at the place of an
    unknown effect: a stuck bit or pick-up is loud at some loads or times only.
    """
    odd, layout = faults.odd_taxels, faults.observation.layout
    unknown_slots = {
        slot for finding in (*effects, *faults.findings) if finding.effect == "unknown" and finding.where != Where()
        for slot in finding.where.slots(layout).tolist()
    }  # fmt: skip
    remaining: Sequence[Finding] = odd.findings
    if odd.findings and isinstance(refined.design, BlockDesign):
        uneven = [
            finding.where for finding in effects
            if finding.effect == "unknown" or (finding.effect == "snap" and finding.where.scope == "triangle")
        ]  # fmt: skip
        uneven_slots = {slot for where in uneven for slot in where.slots(layout).tolist()}
        remaining = [
            finding for finding in odd.beside(model_pressure(refined.of_laws))
            if not uneven_slots.issuperset(finding.where.slots(layout).tolist())
        ]  # fmt: skip
    of_others = [
        finding for finding in faults.findings if finding not in odd.findings
        and not (finding.effect == "noise_burst" and unknown_slots.issuperset(finding.where.slots(layout).tolist()))
    ]  # fmt: skip
    return [finding for finding in (*of_others, *remaining) if not _is_negligible(finding, figures)]


def _is_negligible(finding: Finding, figures: HeldoutErrors) -> bool:
    """Return whether single taxels explain so little that the variation of the material between taxels does as much."""
    explained = float(figures.before[0] ** 2 - figures.after[0] ** 2)
    return finding.where.scope == "taxel" and bool(finding.parameters) and finding.explains < LEAST_GAINED * explained


def _single_terms(search: SubsetSearch[Any]) -> tuple[tuple[str, float, float], ...]:
    """Return word, gain and score per row of the terms that explain most alone."""
    n = search.design.n_rows
    best_by_word: dict[str, tuple[float, float]] = {}
    for single in search.singles():
        word = search.design.candidates[single.chosen[0]].word
        if np.isfinite(single.score) and (word not in best_by_word or single.score / n > best_by_word[word][1]):
            best_by_word[word] = (single.gain / n, single.score / n)
    by_score = sorted(best_by_word.items(), key=lambda item: -item[1][1])[:8]
    return tuple((word, gain, score) for word, (gain, score) in by_score)


def not_identifiable(whole: Design | BlockDesign, priors: Priors, taken_up: Collection[str]) -> list[dict[str, str]]:
    """Return the terms that this recording does not determine: their std is over a third of the plausible size.

    `taken_up`: words of static effects that the curves of a chamber may have taken up.
    """
    rows, done = [], set[str]()
    for term in TERMS:
        if term.word in done or term.is_internal:
            continue
        done.add(term.word)
        why = term.needs(whole.load)
        if why is None and priors.share and term.word in ("gain", "stiffening"):
            why = f"the simulated load itself is off by about {priors.share:.0%} and {1e3 * priors.timing_s:.0f} ms"
        if why is None and term.word in taken_up:
            why = "the calibration may have been made with the memory at work, and its curves contain a part of it"
        if why is None:
            candidates = [candidate for candidate in whole.candidates if candidate.word == term.word]
            if term.word == "delay" and whole.load.observation.offset_is_free:
                why = "the clock's offset is free, and a delay of all boards looks the same"
            elif term.plausible and candidates:
                k = candidates[0].columns[0]
                std = 1.0 / np.sqrt(max(float(whole.gram[k, k]), 1e-300))
                if std > term.plausible / 3.0:
                    dependence = "readings depend" if whole.load.is_known else "the wrench depends"
                    why = f"{dependence} little on it here, or on other terms in the same way"
            elif not candidates:
                why = "the recording is too short, or has nothing to show it by"
        if why is not None:
            rows.append({"effect": term.word, "why": why, "record_instead": term.shown_by(whole.load)})
    return rows
