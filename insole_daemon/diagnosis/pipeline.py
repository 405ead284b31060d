"""`insole diagnose` where the load is known in sum, by a force shoe or plate: the stages in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..config import Foot
from ..errors import DiagnosisError, EffectError, UndecidableError
from ..physics.calibration import BEGAN, Calibration
from ..physics.effect import Effect, Where
from ..physics.effects import laws
from ..physics.law import Array
from ..recording.loading import FootRecording, Recording
from . import merging, outcome, sentences
from .excitation import require_cycles
from .export import wrench_model
from .export.as_effect import as_effect
from .feet import choose
from .finding import Finding, Quantity, Verdict
from .gathering import join_places
from .model.blocks import RECALIBRATIONS, BlockDesign, Priors, place_of
from .model.design import Design
from .model.refine import Refined, refine
from .model.regression import Timing
from .observations.chamber import observe_chamber
from .observations.own_curves import observe_uncalibrated
from .observations.paired import PairedObservation, observe_paired
from .observations.reading_faults import ReadingFaults, reading_faults
from .observations.walk import observe_walk
from .observations.warmth import with_warmth
from .observations.wrench import WrenchObservation
from .outcome import Outcome
from .parameters import parameters_of
from .places import said
from .searching import Searched
from .searching import search as search_terms
from .select import confidence, left_over
from .select.count_figures import count_figures
from .select.search import FittedSet, SubsetSearch
from .select.timing_search import TimedSet
from .select.wrench_figures import Figures, figures
from .terms import TERMS

OF_THE_INSOLE = (*merging.LASTING, "delay")  # of several recordings
LEAST_STEPS = 3
LEAST_DELAY_S = 0.003  # three standard deviations of a declared clock's offset
LEAST_RATE = 1e-4
MOST_RATE = 1e-4  # of a clock of the reference's own: more is a finding (formats.md)
LEAST_LATE_S = 0.05  # that it makes by the end, at the least
LEAST_ROWS_OFF_S = 0.1  # of a reference whose rows were to go with the cycles
NEVER_TELL = ("dead_taxels", "open_triangle")  # where they are there all the time
LEAST_GAINED = 0.001  # of what a set explains, that each of it does where it enters
LEAST_NEEDED = 0.05  # of it, that is lost where one that does not is left out: less, and it is not needed
PER_TAXEL = 4.0  # a taxel's share of a triangle's excess that counts as much as a channel's of a wrench
UNKNOWN_EXCESS = 1.0  # mean squares of the noise that are left
UNKNOWN_SHARE = 0.08  # of what a set explains, that it may leave: no law is met exactly
UNKNOWN_OF_MEMORY = 0.12  # the same with a memory, where the load is known: materials follow their laws less nearly
STRONGER = 4.0  # times what is left without a name, that an effect beside it explains
MOST_NULL = 1.12  # times the noise floor: what a recording without a mismatch may leave
MOST_WORSE = np.array([1.02, 1.1, 1.1])  # times the error before, of f_z, m_x and m_y on held-out rows


@dataclass(frozen=True, slots=True, eq=False)
class WalkResult:
    """What one recording came to."""

    faults: ReadingFaults
    design: Design | BlockDesign
    refined: Refined[Any]
    figures: Figures
    findings: tuple[Finding, ...]
    effects: tuple[Effect, ...]
    candidates: tuple[tuple[str, float, float], ...]  # best single sets: words, gain and score in units of the rows
    not_identifiable: tuple[dict[str, str], ...]
    is_unknown: bool
    timing: Timing

    @property
    def seen(self) -> WrenchObservation:
        """Its rows."""
        return self.design.load.observation


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WrenchDiagnosis(Outcome):
    """What is said of recordings of one kind, and what it was told from."""

    results: tuple[WalkResult, ...]
    effects: tuple[Effect, ...]

    def static(self) -> dict[str, Any]:
        """The static model that was asked about, as `insole-calibration/1`."""
        seen = self.results[0].seen
        nothing = np.zeros(seen.usable.shape, bool)
        return wrench_model.document(seen, (), (), {"made_by": f"insole diagnose {__version__}"}, None, nothing)


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    progress: Callable[[str], None],
    simulations: Sequence[Recording] = (),
    asked: Foot | None = None,
) -> WrenchDiagnosis:
    """What differs between recordings and the static model, under the load of their references.

    The model is `calibration`, else the first recording's own, else the curves that fit chambers best. `simulations`:
    of their trials, one for each or one for all, whose load then stands for the references'. `asked`: the foot, where
    there are two. DiagnosisError where the recordings do not belong together or cannot show anything, UndecidableError
    where the insole is loaded too seldom.
    """
    _refuse_mixture(recordings, simulations)
    feet = choose(recordings, asked, bool(simulations))
    every = _observed(recordings, feet, calibration, progress, simulations)
    _refuse_still([each for each in every if each.is_uniform])
    results = [diagnose_one(seen, foot, progress) for seen, foot in zip(every, feet, strict=True)]
    findings = merging.merge_findings(
        [
            merging.Said(
                r.seen.name, r.seen.load_is_known, r.findings, frozenset(x["effect"] for x in r.not_identifiable)
            )
            for r in results
        ]
    )
    names = tuple(each.folder.name for each in recordings)
    heldout = _heldout(results)
    first = next((each for each in results if each.seen.load_is_known), results[0])
    effects = _effects(results, first, findings)
    provenance = {"made_by": f"insole diagnose {__version__}", "recordings": list(names), BEGAN: int(feet[0].t_ns[0])}
    return WrenchDiagnosis(
        recordings=names,
        against="simulation" if simulations else "model",
        verdict=_verdict(heldout, findings, results),
        heldout=heldout,
        clocks=np.array([_clock(each) for each in results]),
        findings=findings,
        rejected=_rejected(first),
        not_identifiable=_never_told(results),
        model=wrench_model.document(
            first.seen, effects, _absorbed(first), provenance, first.figures.recalibrated, _broken(first)
        ),
        results=tuple(results),
        effects=effects,
    )


def _refuse_mixture(recordings: Sequence[Recording], simulations: Sequence[Recording]) -> None:
    if len(simulations) not in (0, 1, len(recordings)):
        raise DiagnosisError(
            f"{len(simulations)} simulations for {len(recordings)} recordings, expected one for each, in the same "
            "order, or one for all"
        )
    others = [each for each in recordings if each.kind not in ("chamber", "shoe")]
    if others and not simulations and len({each.kind for each in recordings}) > 1:
        raise DiagnosisError(
            f"{others[0].folder}: expected a chamber or a force shoe as in the other recordings, found kind "
            f"{others[0].kind}: leave it out"
        )


def _observed(
    recordings: Sequence[Recording],
    feet: Sequence[FootRecording],
    calibration: Calibration | None,
    progress: Callable[[str], None],
    simulations: Sequence[Recording],
) -> list[WrenchObservation]:
    """Every recording by the static model; of an insole without one in a chamber, by the curves that fit it best."""
    is_chamber = not simulations and all(each.kind == "chamber" for each in recordings)
    if is_chamber and not has_model(feet[0], calibration):
        return [with_warmth(each) for each in observe_uncalibrated(recordings, feet, progress)]
    model = static_model(recordings[0], feet[0], calibration)
    every: list[WrenchObservation] = []
    for i, (recording, foot) in enumerate(zip(recordings, feet, strict=True)):
        progress(f"reading {recording.folder.name}")
        if simulations:
            every.append(observe_paired(recording, foot, model, simulations[i if len(simulations) > 1 else 0]))
        else:
            every.append(_observe(recording, foot, model))
    return [with_warmth(each) for each in every]


def _effects(results: Sequence[WalkResult], first: WalkResult, findings: Sequence[Finding]) -> tuple[Effect, ...]:
    """Of the model: what the result `first` has, and what lasts and only others tell; nothing that as many deny."""
    denied = {each.effect for each in findings if len(each.contradicted_by) >= len(each.recordings)}
    found = [each for each in first.effects if each.law.word not in denied]
    for result in results:
        words = {each.law.word for each in found}
        found += [
            each for each in result.effects
            if result is not first and each.law.word in OF_THE_INSOLE and each.law.word not in words | denied
        ]  # fmt: skip
    return tuple(sorted(found, key=lambda each: np.inf if each.law.order is None else each.law.order))


def _never_told(results: Sequence[WalkResult]) -> tuple[dict[str, str], ...]:
    """What none of the recordings can tell."""
    others = [{row["effect"] for row in each.not_identifiable} for each in results[1:]]
    return tuple(row for row in results[0].not_identifiable if all(row["effect"] in other for other in others))


def _observe(recording: Recording, foot: FootRecording, model: Calibration) -> WrenchObservation:
    if recording.kind == "shoe":
        return observe_walk(recording, foot, model)
    return observe_chamber(recording, foot, model)


def _figures(
    whole: Design | BlockDesign,
    refined: Refined[Any],
    order: Sequence[int],
    timing: Timing,
    nuisances: Sequence[int] = (),
    uncertain_s: float = 0.0,
) -> Figures:
    if isinstance(whole, BlockDesign):
        return count_figures(refined, order)
    return figures(whole, refined, order, timing, nuisances, uncertain_s)


def _measured(whole: Design | BlockDesign, refined: Refined[Any], timing: Timing) -> tuple[list[int], Figures]:
    """The candidates of a set, the largest first, and its figures as they enter in this order."""
    order = sorted(range(len(refined.shares)), key=lambda i: -_energy(refined, i))
    return order, _figures(whole, refined, order, timing)


def _with_faults(found: Figures, faults: ReadingFaults) -> Figures:
    """With what was put right before the regression: the model as handed in knows nothing of it."""
    square = sum(each.explains for each in faults.findings)
    return replace(found, before=np.sqrt(found.before**2 + square)) if square else found


def _is_next_to_nothing(each: Finding, found: Figures) -> bool:
    """Whether single taxels take away so little that a material which differs from taxel to taxel does as much."""
    whole = float(found.before[0] ** 2 - found.after[0] ** 2)
    return each.where.scope == "taxel" and bool(each.parameters) and each.explains < LEAST_GAINED * whole


def _heldout_of(seen: WrenchObservation, before: float, after: float) -> dict[str, Any]:
    return {"heldout_count" if seen.load_is_known else "heldout_n": (before, after)}


def has_model(foot: FootRecording, calibration: Calibration | None) -> bool:
    """Whether there is a calibration of this very insole, by which pressures are told."""
    model = calibration if calibration is not None else foot.calibration
    return model is not None and not model.builtin


def static_model(recording: Recording, foot: FootRecording, calibration: Calibration | None) -> Calibration:
    """The model asked about: `calibration`, else that of `foot`; DiagnosisError where there is no static one."""
    model = calibration if calibration is not None else foot.calibration
    if model is None or not has_model(foot, calibration):
        raise DiagnosisError(
            f"{recording.folder}: expected a calibration, found none: a wrench is computed from pressures. "
            "Give one with --calibration; insole calibrate makes it"
        )
    if model.effects:
        words = ", ".join(each.law.word for each in model.effects)
        raise DiagnosisError(f"the model has effects already ({words}), expected a static one: diagnose against that")
    return model


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
        effect = _effect(each.word, each.where, each.parameters, seen)
        if effect is not None:
            effects.append(effect)
        findings.append(
            Finding(
                effect=each.word, foot=seen.layout.foot, where=each.where, equation=laws()[each.word].equation,
                recordings=(seen.name,), parameters=each.parameters, explains=gained, margin=each.margin,
                confidence=confidence.confidence(each.margin, False),
                sentence=sentences.of_effect(each.word, each.where, each.parameters),
                **_heldout_of(seen, float(np.sqrt(found.after[0] ** 2 + gained)), float(found.after[0])),
            )
        )  # fmt: skip
    return found, findings, effects


def diagnose_one(seen: WrenchObservation, foot: FootRecording, progress: Callable[[str], None]) -> WalkResult:
    """The stages for one recording: faults of readings, regression, search, refinement, figures, findings."""
    _refuse_unloaded(seen)
    faults = reading_faults(foot, seen)
    seen = faults.observation
    progress("comparing with every term of the library")
    searched = search_terms(seen, faults, foot)
    timed = searched.timed
    first = timed[0]
    whole, search = first.search.design, first.search
    best = search.simplified(first.best, confidence.CLOSE)
    progress("measuring the error on blocks that were held out")
    while True:
        refined = refine(whole, best.chosen)
        idle = _idle(search, best.chosen, refined)
        if idle is not None:
            best = search.fit([k for i, k in enumerate(best.chosen) if i != idle])
            continue
        order, found = _measured(whole, refined, first.timing)
        if order and not _is_better(found):
            # What makes rows worse that it was not fitted to explains nothing.
            best = search.fit([k for i, k in enumerate(best.chosen) if i != order[-1]])
            continue
        lighter = _lighter(search, best, order, found, lambda each: _measured(whole, each, first.timing)[1])
        if lighter is None:
            break
        best = lighter
    is_unknown = _is_unknown(found, whole, refined, first.timing)
    if is_unknown:
        # What explains hardly more than is left without a name may be a part of that.
        least = np.inf if _explains_little(found, whole) else STRONGER * _unexplained(found, whole)
        strong = [k for i, k in enumerate(best.chosen) if refined.gain - refined.gain_without(i) > least]
        if len(strong) < len(best.chosen):
            best = search.fit(strong)
            refined = refine(whole, best.chosen)
            order, found = _measured(whole, refined, first.timing)
    nuisances = [i for i in order if _is_nuisance(refined.design.candidates[i].word, parameters_of(refined, i, foot))]
    is_late = abs(first.timing.delay_s) >= LEAST_DELAY_S + seen.latest_s
    if nuisances or not is_late:
        uncertain_s = 0.0 if is_late else first.timing.delay_s
        found = _figures(whole, refined, order, first.timing, nuisances, uncertain_s)
    found, findings, effects = _placed(searched, seen, found)
    found = _with_faults(found, faults)
    if findings and not found.after[0] < found.before[0]:
        findings, effects, is_unknown = [], [], True  # what makes held-out rows worse explains nothing
    if not (findings or order or first.words or faults.findings):
        is_unknown |= bool(
            found.before[0] > MOST_NULL * found.floor[0] and _excess(found, whole).max() > UNKNOWN_EXCESS
        )
    if is_unknown:
        findings.append(_unknown(seen, found, whole))
    has_clock = any(each.word == "clock" for i, each in enumerate(refined.design.candidates) if i not in nuisances)
    # Beside a wrong clock a delay is a part of that clock's offset.
    named = tuple(word for word in first.words if word != "delay" or (is_late and not has_clock))
    if not is_unknown or _timing_energy(whole, first.timing) > STRONGER * _unexplained(found, whole):
        findings += _timings(seen, timed, named, found, float(whole.least.max()))
    effects += _timing_effects(first, named)
    for rank, i in enumerate(order):
        candidate = refined.design.candidates[i]
        position = i
        gain = found.gains[rank]
        parameters = parameters_of(refined, i, foot)
        if i in nuisances:
            continue
        if candidate.word == "clock":
            offset = parameters["offset_s"]
            parameters["offset_s"] = replace(offset, value=offset.value - first.timing.delay_s)
        effect = _effect(candidate.word, candidate.where, parameters, seen)
        if effect is not None:
            effects.append(effect)
        alternatives = search.alternatives(best, position, confidence.SAME)
        margin = search.margin(best, position)
        sure = confidence.confidence(margin, bool(alternatives))
        findings.append(
            Finding(
                effect=candidate.word, alternatives=tuple(word for word, _ in alternatives[:1]), foot=seen.layout.foot,
                where=candidate.where, equation=laws()[candidate.word].equation if candidate.word in laws() else "",
                recordings=(seen.name,), parameters=parameters, explains=gain, confidence=sure, margin=margin,
                sentence=sentences.of_constant(parameters["offset"].value) if "offset" in parameters
                else sentences.of_effect(candidate.word, candidate.where, parameters),
                **_heldout_of(seen, float(np.sqrt(found.after[0] ** 2 + gain)), float(found.after[0])),
            )
        )  # fmt: skip
    findings = list(join_places(findings, seen))
    effects.sort(key=lambda each: np.inf if each.law.order is None else each.law.order)  # the order of the signal path
    findings += [each for each in faults.findings if not _is_next_to_nothing(each, found)]
    result = WalkResult(
        faults, whole, refined, found, (), tuple(effects), _singles(search),
        tuple(_not_identifiable(whole, {each.effect for each in findings}, searched.priors)), is_unknown,
        first.timing,
    )  # fmt: skip
    return replace(result, findings=(*findings, *_own_clock(result)))


def _refuse_still(chambers: Sequence[WrenchObservation]) -> None:
    if chambers:
        loads = [each.reference.at(each.reference_s)[:, 0] for each in chambers]
        span = max(float(np.ptp(load)) for load in loads)
        require_cycles(chambers[0].name, loads, [each.step_s for each in chambers], span)


def _refuse_unloaded(seen: WrenchObservation) -> None:
    force = seen.reference.at(seen.reference_s)[:, 0]
    if seen.load_is_known:
        return
    low, high = 0.1 * float(force.max()), 0.3 * float(force.max())
    state = np.where(force > high, 1, np.where(force < low, 0, -1))
    row = np.maximum.accumulate(np.where(state >= 0, np.arange(len(state)), 0))
    steps = int((np.diff(state[row]) == 1).sum())
    stands = float(np.mean(force > low)) > 0.9
    if steps < LEAST_STEPS and not stands:
        raise UndecidableError(
            f"{seen.name}: the foot is loaded {steps} times, expected at least {LEAST_STEPS} steps: one rise and fall "
            "fits any physics. Record a walk of a minute"
        )


def _is_better(found: Figures) -> bool:
    """Whether rows that were held out have become better on the whole, and no channel clearly worse."""
    level = np.maximum(found.floor, 1e-12)
    whole = np.sum((found.after / level) ** 2) < np.sum((found.before / level) ** 2)
    return bool(whole and np.all(found.after <= MOST_WORSE[: len(found.after)] * found.before))


def _lighter(
    search: SubsetSearch[Any],
    best: FittedSet,
    order: Sequence[int],
    found: Figures,
    measured: Callable[[Refined[Any]], Figures],
) -> FittedSet | None:
    """`best` without a candidate that makes the error hardly smaller on rows that were held out; None: all do.

    Neither when it enters after stronger ones, nor when all others are there. A clock only aligns.
    """
    whole = search.design
    least_needed = LEAST_NEEDED if isinstance(whole, BlockDesign) else LEAST_GAINED
    unit = np.maximum(found.floor, 1e-12)  # of each channel

    def square(rms: Array) -> float:
        return float(np.sum((rms / unit) ** 2))

    before, after = square(found.before), square(found.after)
    for i, gain in reversed(list(zip(order, found.gains, strict=True))):
        if gain > LEAST_GAINED * sum(found.gains) or whole.candidates[best.chosen[i]].word == "clock":
            continue
        rest = [k for j, k in enumerate(best.chosen) if j != i]
        others = search.singles() if len(rest) == 1 else []
        without = max([search.fit(rest), *others], key=lambda each: each.score)
        left = square(measured(refine(whole, without.chosen)).after)
        if best.chosen[i] not in without.chosen and left - after < least_needed * (before - after):
            return without
    return None


def _idle(search: SubsetSearch[Any], chosen: Sequence[int], refined: Refined[Any]) -> int | None:
    """A candidate that explains less than its price now that the others are refined; None where all are worth it.

    Of several, that without which the others explain most once they are refined again.
    """
    every = [search.design.candidates[k] for k in chosen]
    prices = [search.prices.least_price(k, each, every) for k, each in zip(chosen, every, strict=True)]
    idle = [i for i, price in enumerate(prices) if refined.gain - refined.gain_without(i) < price]
    if len(idle) < 2:
        return idle[0] if idle else None

    def score_without(i: int) -> float:
        others = tuple(j for j in range(len(every)) if j != i)
        return refine(refined.design, others).gain - sum(prices[j] for j in others)

    return max(idle, key=score_without)


def _energy(refined: Refined[Any], i: int) -> float:
    columns = refined.design.candidates[i].columns
    share = refined.shares[i]
    return float(share @ refined.design.gram[np.ix_(columns, columns)] @ share)


def _is_unknown(found: Figures, whole: Design | BlockDesign, refined: Refined[Any], timing: Timing) -> bool:
    """Whether a mismatch is left that no set of terms explains."""
    if refined.shares and _explains_little(found, whole):
        return True
    explained = refined.gain + _timing_energy(whole, timing)
    has_memory = any(each.term.is_memory for each in refined.design.candidates)
    share = UNKNOWN_OF_MEMORY if has_memory and isinstance(whole, BlockDesign) else UNKNOWN_SHARE
    return bool(_excess(found, whole).max() > UNKNOWN_EXCESS and _unexplained(found, whole) > share * explained)


def _explains_little(found: Figures, whole: Design | BlockDesign) -> bool:
    """Whether so little is better on held-out rows of a known load that the verdict is `unexplained`."""
    if not isinstance(whole, BlockDesign):
        return False  # the force may be right and the moments wrong
    before, after, floor = (float(each[0]) for each in (found.before, found.after, found.floor))
    return before**2 - after**2 < outcome.LEAST_EXPLAINED * (before**2 - floor**2)


def _unexplained(found: Figures, whole: Design | BlockDesign) -> float:
    """Squared residual beyond the noise, in its variances."""
    return float(whole.n_rows * found.left.excess.sum())


def _timing_energy(whole: Design | BlockDesign, timing: Timing) -> float:
    """Squared residual that a delay and a lag of the whole insole take away; a clock's free offset is neither."""
    aligned = Timing(timing.delay_s if whole.load.observation.offset_is_free else 0.0)
    return float(whole.retimed(aligned).total - whole.total)


def _excess(found: Figures, whole: Design | BlockDesign) -> Array:
    """(c,) of what is left, by channel, in mean squares of its noise; of one taxel's where channels are triangles."""
    noise = np.where(found.left.noise > 0, found.left.noise, np.inf)
    if not isinstance(whole, BlockDesign):
        return np.asarray(found.left.excess / noise)
    taxels = np.maximum(whole.seen.usable.sum(axis=1), 1)
    return np.asarray(found.left.excess / noise / taxels * PER_TAXEL)


def _unknown(seen: WrenchObservation, found: Figures, whole: Design | BlockDesign) -> Finding:
    channel = 0
    if isinstance(whole, BlockDesign):
        excess = _excess(found, whole)
        where = place_of(excess > 0.3 * float(excess.max()), whole.seen)
        text = "readings differ from the model by more than noise; no known effect explains it"
    else:
        channel = int(np.argmax(_excess(found, whole)))
        name = ("the force", "the moment m_x", "the moment m_y")[channel]
        where, text = Where(), f"{name} differs from the model by more than noise; no known effect explains it"
    load = seen.reference.at(seen.reference_s)
    load = load.mean(axis=1) if seen.load_is_known else load[:, 0]
    left = np.where(found.known, found.course_after[:, channel], 0.0)
    regime, equation = left_over.regime_and_equation(load, left, seen.step_s, seen.load_is_known)
    if regime:
        (low, high), phase = list(regime.values())
        of, unit = (1e-3, "kPa") if seen.load_is_known else (1.0, "N")
        text += f"; most of it is there while {phase} between {low * of:.0f} and {high * of:.0f} {unit}"
    place = said(where)
    return Finding(
        effect="unknown", foot=seen.layout.foot, where=where, recordings=(seen.name,), confidence=0.8, explains=0.0,
        regime=regime, equation=equation, sentence=f"{place[0].upper()}{place[1:]}: {text}.",
        **_heldout_of(seen, float(found.before[0]), float(found.after[0])),
    )  # fmt: skip


def _timings(
    seen: WrenchObservation, timed: Sequence[TimedSet[Any]], named: Sequence[str], found: Figures, least_gain: float
) -> list[Finding]:
    """Delay and lag of the whole insole, those of them `named`; hypotheses that are as good are alternatives."""
    first = timed[0]
    findings = []
    values = {"delay": ("delay_s", first.timing.delay_s), "lag": ("tau_s", first.timing.lag_s)}
    for word in named:
        name, value = values[word]
        without = min((each.left for each in timed if word not in each.words), default=np.inf)
        margin = (without - first.left) / least_gain
        others = [
            each for each in timed[1:]
            if word not in each.words and each.left - first.left < confidence.SAME * least_gain
        ]  # fmt: skip
        other = next((w for each in others for w in each.words if w not in first.words), None)
        parameters = {name: Quantity(value, 0.03 * value + 5e-4, "s")}
        findings.append(
            Finding(
                effect=word, alternatives=() if other is None else (other,), foot=seen.layout.foot, where=Where(),
                equation=laws()[word].equation, recordings=(seen.name,), parameters=parameters,
                explains=found.timing_gain / len(first.words),
                confidence=confidence.confidence(margin, other is not None), margin=margin,
                sentence=sentences.of_effect(word, Where(), parameters),
                **_heldout_of(seen, float(np.sqrt(found.after[0] ** 2 + found.timing_gain)), float(found.after[0])),
            )
        )  # fmt: skip
    return findings


def _timing_effects(first: TimedSet[Any], named: Sequence[str]) -> list[Effect]:
    effects = []
    if "lag" in named:
        effects.append(as_effect("lag", Where(), {"tau_s": Quantity(first.timing.lag_s, 0.0, "s")}))
    if "delay" in named and first.timing.delay_s > 0:
        effects.append(as_effect("delay", Where(), {"delay_s": Quantity(first.timing.delay_s, 0.0, "s")}))
    return effects


def _is_nuisance(word: str, parameters: dict[str, Quantity]) -> bool:
    """Whether it is no more than what a declared clock may be off by."""
    if word == "delay":
        return float(parameters["delay_s"].value) < LEAST_DELAY_S
    if word == "clock":
        offset_s, rate = float(parameters["offset_s"].value), float(parameters["rate"].value)
        return abs(rate) < LEAST_RATE and abs(offset_s) < LEAST_DELAY_S
    return False


def _effect(word: str, where: Where, parameters: dict[str, Quantity], seen: WrenchObservation) -> Effect | None:
    """As a chain runs it; None where there is no law, or its values lie beyond what can be undone."""
    if word not in laws():
        return None
    named = {each.name for each in laws()[word].parameters}
    own = {name: quantity for name, quantity in parameters.items() if name in named}
    if word == "swapped_triangles":
        own["pair"] = Quantity([list(identity) for identity in where.ids], np.zeros((2, 2)), "1")
        where = Where()
    if word == "drift":
        own["t_s"] = replace(own["t_s"], value=[float(t) for t in own["t_s"].value])
    try:
        found = as_effect(word, where, own)
    except EffectError:
        return None
    highest = float(np.ceil(seen.pressure_pa.max()))
    return replace(found, valid_range={"pressure_pa": (0.0, highest)}) if found.law.domain == "pressure" else found


def _heldout(results: Sequence[WalkResult]) -> dict[str, Any]:
    """Of all taxels in counts where the load is known, and of the wrench, each over all its recordings."""
    known = [each for each in results if each.seen.load_is_known]
    walks = [each for each in results if not each.seen.load_is_known]
    moments = {"m_x": _pooled(walks, 1, "N·m"), "m_y": _pooled(walks, 2, "N·m")} if walks else {}
    if not known:
        return {**_pooled(walks, 0, "N"), **moments}
    return {**_pooled(known, 0, "count"), **({"f_z": _pooled(walks, 0, "N"), **moments} if walks else {})}


def _pooled(results: Sequence[WalkResult], channel: int, unit: str) -> dict[str, Any]:
    weights = [int(each.figures.known.sum()) for each in results]
    figures_of = {
        name: float(np.sqrt(np.average([getattr(r.figures, name)[channel] ** 2 for r in results], weights=weights)))
        for name in ("before", "after", "floor")
    }
    return {"unit": unit, **{name: round(value, 4) for name, value in figures_of.items()}}


def _verdict(heldout: dict[str, Any], findings: Sequence[Finding], results: Sequence[WalkResult]) -> Verdict:
    before, after, floor = (float(heldout[name]) for name in ("before", "after", "floor"))
    # What a declared clock may be off by within its prior is no mismatch.
    calm = all(float(np.max(_excess(r.figures, r.design))) < UNKNOWN_EXCESS for r in results)
    return outcome.verdict(
        before if findings else min(before, after), after, floor, MOST_NULL * floor if calm else floor,
        findings=len(findings), unknown=sum(each.effect == "unknown" for each in findings),
        undecided=any(each.alternatives for each in findings),
    )  # fmt: skip


def _clock(result: WalkResult) -> tuple[float, float]:
    """Offset and rate of the reference's clock."""
    seen = result.seen
    offset_s, rate = seen.reference.start_s + seen.offset_s, seen.rate
    if seen.offset_is_free:  # the rows' load may be moved already
        moved_s = result.design.moved_s if isinstance(result.design, BlockDesign) else 0.0
        offset_s -= result.timing.delay_s - moved_s
    names = _base_names(result.design)
    for name, share in zip(names, result.figures.base_shares.tolist(), strict=True):
        if name == "offset_s":
            offset_s += share
        if name == "rate":
            rate, offset_s = rate + share, offset_s - share * float(seen.t_s.mean())
    if seen.declared_offset_s is not None and not seen.offset_is_free:
        return 0.0, 0.0
    return offset_s, rate


def _base_names(whole: Design | BlockDesign) -> tuple[str, ...]:
    return whole.nuisance.shared_names if isinstance(whole, BlockDesign) else whole.base.names


def _own_clock(result: WalkResult) -> list[Finding]:
    """A clock of the reference's own that runs as no two quartzes do, or rows that do not go with the cycles."""
    seen = result.seen
    is_named = any(each.effect == "clock" for each in result.findings)
    if isinstance(seen, PairedObservation) or not seen.offset_is_free or is_named:
        return []
    offset_s, rate = _clock(result)
    late_s = abs(rate) * float(seen.t_s[-1])
    by_row = not seen.reference.has_times
    runs = abs(rate) > MOST_RATE + 3.0 * seen.rate_std and late_s > LEAST_LATE_S
    if not (runs or (by_row and max(abs(offset_s), late_s) > LEAST_ROWS_OFF_S)):
        return []
    parameters = {"offset_s": Quantity(offset_s, 0.01, "s"), "rate": Quantity(rate, seen.rate_std, "1")}
    return [
        Finding(
            effect="clock", foot=seen.layout.foot, where=Where(), recordings=(seen.name,), parameters=parameters,
            equation=laws()["clock"].equation, confidence=0.95, explains=0.0,
            sentence=f"The reference's clock runs {abs(rate):.3%} {'fast' if rate > 0 else 'slow'} against the CAN "
            f"frames' and says {offset_s:+.2f} s at the first of them.",
        )
    ]  # fmt: skip


def _absorbed(result: WalkResult) -> list[wrench_model.Absorbed]:
    """What the curves handed in had absorbed of the effects found."""
    inner, found = result.refined.design, {}
    for candidate in inner.candidates:
        for word, column in zip(candidate.companion_words, candidate.companions.tolist(), strict=True):
            if word not in RECALIBRATIONS:
                continue  # what an earlier load has left is no part of a curve
            share = result.figures.companion_shares.get(column, 0.0)
            found[column] = wrench_model.Absorbed(word, candidate.where, share)
    return list(found.values())


def _broken(result: WalkResult) -> NDArray[np.bool_]:
    """(T, 12) taxels that never tell the load."""
    found = np.zeros(result.seen.usable.shape, bool)
    for each in result.findings:
        if each.effect in NEVER_TELL and not each.when_s:
            found.reshape(-1)[each.where.slots(result.seen.layout)] = True
    return found


def _rejected(result: WalkResult) -> tuple[dict[str, str], ...]:
    chosen = {each.effect for each in result.findings}
    return tuple(
        {"effect": word, "why": f"alone it takes away {gain:.2f} noise variances a row, {score:.2f} after its price"}
        for word, gain, score in result.candidates
        if word not in chosen
    )


def _singles(search: SubsetSearch[Any]) -> tuple[tuple[str, float, float], ...]:
    n = search.design.n_rows
    found: dict[str, tuple[float, float]] = {}
    for each in search.singles():
        word = search.design.candidates[each.chosen[0]].word
        if np.isfinite(each.score) and (word not in found or each.score / n > found[word][1]):
            found[word] = (each.gain / n, each.score / n)
    ordered = sorted(found.items(), key=lambda item: -item[1][1])[:8]
    return tuple((word, gain, score) for word, (gain, score) in ordered)


def _not_identifiable(whole: Design | BlockDesign, found: set[str], priors: Priors) -> list[dict[str, str]]:
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
