"""Diagnose several recordings of one insole: the functions behind `insole diagnose`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..config import Foot
from ..physics.calibration import BEGAN, Calibration
from ..physics.effect import Effect
from ..recording.loading import FootRecording, Recording
from . import merging, outcome
from .caches import forget_cached, return_freed_memory, reuse_freed_memory
from .export import wrench_model
from .feet import choose
from .finding import LEFT_OUT, Finding, Verdict
from .model.blocks import RECALIBRATIONS
from .observations.chamber import ChamberObservation
from .observations.wrench import WrenchObservation
from .observing import observed, refuse_mixture, refuse_still
from .one_recording import diagnose_one
from .read_by_model import MEMORIES, ChamberModel, read_by, with_bursts_as_read
from .result import Diagnosis, RecordingResult
from .terms import creep_by_reference, mean_curve
from .timings import clock_of
from .unexplained import null_bound

LASTING_EFFECTS = (*merging.LASTING, "delay")  # that any recording may add to the model
REACHED = 0.999  # quantile of the activations in a chamber, up to which its curves are known
CLEAR = 0.01  # of what all findings explain
LESS = 0.5  # of the squared error beyond the floor: a walk is read by the model of a chamber if that leaves no more
CLEARLY_LESS = 0.6  # of the squared error beyond the floor, on the clock of the edges against the declared one
PERMANENT_FAULTS = ("dead_taxels", "open_triangle")  # of taxels, if they last for the whole recording


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    progress: Callable[[str], None],
    simulations: Sequence[Recording] = (),
    asked: Foot | None = None,
) -> Diagnosis:
    """Return what differs between recordings and the static model under the load of their references.

    The model is `calibration`, else the first recording's own, else curves fitted to chambers. `simulations` of the
    trials, one for each or one for all, replace the references. `asked` is the foot, if there are two. Raises
    DiagnosisError if the recordings do not belong together or have no usable reference, UndecidableError if the load
    changes too rarely.
    """
    reuse_freed_memory()
    refuse_mixture(recordings, simulations)
    feet = choose(recordings, asked, bool(simulations))
    observations = observed(recordings, feet, calibration, progress, simulations)
    refuse_still([observation for observation in observations if observation.is_uniform])
    results, undone = _diagnose_each(observations, feet, progress)
    findings = merging.merge_findings([_findings_of(*each) for each in zip(results, undone, strict=True)])
    names = tuple(recording.folder.name for recording in recordings)
    heldout = _heldout(results, findings)
    first = next((result for result in results if result.seen.load_is_known), results[0])
    effects = _effects(results, first, findings)
    provenance = {"made_by": f"insole diagnose {__version__}", "recordings": list(names), BEGAN: int(feet[0].t_ns[0])}
    return Diagnosis(
        recordings=names,
        against="simulation" if simulations else "model",
        verdict=_verdict(heldout, findings, results),
        heldout=heldout,
        clocks=np.array([clock_of(result) for result in results]),
        findings=findings,
        rejected=_rejected(first),
        not_identifiable=_not_identifiable_by_any(results),
        model=wrench_model.document(
            first.seen,
            effects,
            _absorbed_by_curves(first),
            provenance,
            first.figures.recalibrated,
            _without_contact(first),
        ),
        results=tuple(results),
        effects=effects,
    )


def _diagnose_each(
    observations: list[WrenchObservation], feet: Sequence[FootRecording], progress: Callable[[str], None]
) -> tuple[list[RecordingResult], list[frozenset[str]]]:
    """Return the result of each recording, and the words of the memories without which it was read.

    A walk beside a chamber that shows memories is also read by the model of the chamber, and stays so if that leaves
    far less. `observations` is emptied, because they are large.
    """
    order = sorted(range(len(feet)), key=lambda i: not observations[i].load_is_known)
    by_recording = dict(zip(range(len(feet)), observations, strict=True))
    observations.clear()
    results: dict[int, RecordingResult] = {}
    undone = [frozenset[str]()] * len(feet)
    model: ChamberModel | None = None
    for i in order:
        seen, foot = by_recording.pop(i), feet[i]
        if not seen.load_is_known:
            seen = replace(seen, ruled_out=_ruled_out(results.values()))
        result = _on_likelier_clock(seen, foot, progress)
        if seen.load_is_known:
            model = model or _model_of_memories(result)
        _release(result, seen)
        if model is not None and not seen.load_is_known:
            progress(f"reading {seen.name} by the model of the chamber")
            again = diagnose_one(read_by(model, seen, foot), foot, progress)
            if _is_better(again, result, model.words):
                findings = with_bursts_as_read(again.findings, result.findings)
                result = replace(again, findings=findings, figures=replace(again.figures, before=result.figures.before))
                undone[i] = model.words
            _release(result, seen)
        results[i] = result
    return [results[i] for i in range(len(feet))], undone


def _release(result: RecordingResult, seen: WrenchObservation) -> None:
    """Free what `result` and the observation `seen` can compute again, for the next recording."""
    result.forget_cached()
    forget_cached(seen)
    return_freed_memory()


def _on_likelier_clock(
    seen: WrenchObservation, foot: FootRecording, progress: Callable[[str], None]
) -> RecordingResult:
    """Return the result of a recording on its clock, or on the declared one although the edges contradict that.

    A strong memory moves edges, too. The clock of the edges is used if it leaves clearly less.
    """
    result = diagnose_one(seen, foot, progress)
    if not (isinstance(seen, ChamberObservation) and seen.is_declared_clock_doubtful):
        return result
    progress(f"comparing {seen.name} on the declared clock, too")
    declared = diagnose_one(seen.with_declared_clock(), foot, progress)
    left, left_declared = (_excess_square(one) for one in (result, declared))
    return result if left < CLEARLY_LESS * left_declared else declared


def _excess_square(result: RecordingResult) -> float:
    """Return the held-out mean square error beyond the floor, counts²."""
    return float(result.figures.after[0] ** 2 - result.figures.floor[0] ** 2)


def _ruled_out(results: Iterable[RecordingResult]) -> frozenset[str]:
    """Return `baseline` if a recording with a known load shows none: a constant of a walk is that of the shoe, then."""
    for result in results:
        cannot_tell = {entry["effect"] for entry in result.not_identifiable}
        names = {finding.effect for finding in result.findings}
        if result.seen.load_is_known and not result.is_unknown and "baseline" not in cannot_tell | names:
            return frozenset({"baseline"})
    return frozenset()


def _is_better(by_model: RecordingResult, plain: RecordingResult, undone: frozenset[str]) -> bool:
    """Return whether a walk read by the model of a chamber leaves far less, with one more effect at the most.

    The memories `undone` by the model count in both.
    """
    unit = np.maximum(plain.figures.before, 1e-12)
    every = [result.figures for result in (by_model, plain)]
    left = [float(np.sum((figures.after**2 - figures.floor**2) / unit**2)) for figures in every]
    n_words = [len(undone | _clear_words(result.findings)) for result in (by_model, plain)]
    return left[0] < LESS * left[1] and n_words[0] <= n_words[1] + 1


def _clear_words(findings: Sequence[Finding]) -> set[str]:
    """Return the words of the findings that explain at least CLEAR of what all of them explain."""
    least = CLEAR * sum(finding.explains for finding in findings)
    return {finding.effect for finding in findings if finding.explains >= least}


def _model_of_memories(result: RecordingResult) -> ChamberModel | None:
    """Return the model of a recording whose load is known, with its memories alone; None if it has none."""
    memories = [effect for effect in result.effects if effect.law.word in MEMORIES]
    if not memories or result.is_unknown:
        return None
    absorbed, broken = _absorbed_by_curves(result), _without_contact(result)
    document = wrench_model.document(result.seen, memories, absorbed, {}, result.figures.recalibrated, broken)
    return ChamberModel(document, np.quantile(result.seen.activation_count, REACHED, axis=0))


def _findings_of(result: RecordingResult, undone: frozenset[str]) -> merging.RecordingFindings:
    cannot_tell = frozenset(entry["effect"] for entry in result.not_identifiable)
    return merging.RecordingFindings(result.seen.name, result.seen.load_is_known, result.findings, cannot_tell, undone)


def _effects(
    results: Sequence[RecordingResult], first: RecordingResult, findings: Sequence[Finding]
) -> tuple[Effect, ...]:
    """Return the effects of the model: those of `first`, and lasting ones of other recordings.

    Effects that as many recordings contradict as confirm are left out.
    """
    contradicted = {item.effect for item in findings if len(item.contradicted_by) >= len(item.recordings)}
    effects = [item for item in first.effects if item.law.word not in contradicted]
    for result in results:
        words = {item.law.word for item in effects}
        effects += [
            item for item in result.effects
            if result is not first and item.law.word in LASTING_EFFECTS and item.law.word not in words | contradicted
        ]  # fmt: skip
    return tuple(sorted(effects, key=lambda item: np.inf if item.law.order is None else item.law.order))


def _not_identifiable_by_any(results: Sequence[RecordingResult]) -> tuple[dict[str, str], ...]:
    """Return the effects that none of the recordings identifies."""
    words_of_others = [{entry["effect"] for entry in result.not_identifiable} for result in results[1:]]
    return tuple(
        entry for entry in results[0].not_identifiable if all(entry["effect"] in words for words in words_of_others)
    )


def _heldout(results: Sequence[RecordingResult], findings: Sequence[Finding]) -> dict[str, Any]:
    """Return the held-out errors, pooled over recordings: of counts if the load is known, else of the wrench.

    If all findings are `unknown`, or faults beside them, the model is the one handed in, and so is its error.
    """
    words = {finding.effect for finding in findings}
    if "unknown" in words and words <= {"unknown", *LEFT_OUT}:
        results = [replace(result, figures=result.figures.of_the_model_handed_in) for result in results]
    known = [result for result in results if result.seen.load_is_known]
    walks = [result for result in results if not result.seen.load_is_known]
    moments = {"m_x": _pooled(walks, 1, "N·m"), "m_y": _pooled(walks, 2, "N·m")} if walks else {}
    if not known:
        return {**_pooled(walks, 0, "N"), **moments}
    return {**_pooled(known, 0, "count"), **({"f_z": _pooled(walks, 0, "N"), **moments} if walks else {})}


def _pooled(results: Sequence[RecordingResult], channel: int, unit: str) -> dict[str, Any]:
    weights = [int(result.figures.known.sum()) for result in results]
    figures_of = {
        name: float(
            np.sqrt(
                np.average(
                    [getattr(pooled_result.figures, name)[channel] ** 2 for pooled_result in results], weights=weights
                )
            )
        )
        for name in ("before", "after", "floor")
    }
    return {"unit": unit, **{name: round(value, 4) for name, value in figures_of.items()}}


def _verdict(heldout: dict[str, Any], findings: Sequence[Finding], results: Sequence[RecordingResult]) -> Verdict:
    before, after, floor = (float(heldout[name]) for name in ("before", "after", "floor"))
    null_before = null_bound((item.figures, item.design) for item in results) * floor
    return outcome.verdict(
        before if findings else min(before, after), after, floor, null_before,
        findings=len(findings), unknown=sum(item.effect == "unknown" for item in findings),
        undecided=any(item.alternatives for item in findings),
    )  # fmt: skip


def _absorbed_by_curves(result: RecordingResult) -> list[wrench_model.Absorbed]:
    """Return the parts of the selected effects that the calibration's curves contain, unless these are refitted."""
    if result.figures.recalibrated is not None:
        return []
    law = result.refined.of_laws
    design, share_of, absorbed = law.design, law.companion_shares, {}
    for candidate in design.candidates:
        for word in (*RECALIBRATIONS, mean_curve.TERM.word, creep_by_reference.CALIBRATED):
            if columns := candidate.companions_of(word):
                shares = np.array([share_of.get(column, 0.0) for column in columns])
                at_pa = mean_curve.knots_pa(design.load) if word == mean_curve.TERM.word else None
                absorbed[columns[0]] = wrench_model.Absorbed(word, candidate.where, shares, at_pa)
    return list(absorbed.values())


def _without_contact(result: RecordingResult) -> NDArray[np.bool_]:
    """Return the taxels (T, 12) that lack contact for the whole recording."""
    is_broken = np.zeros(result.seen.usable.shape, bool)
    for finding in result.findings:
        if finding.effect in PERMANENT_FAULTS and not finding.when_s:
            is_broken.reshape(-1)[finding.where.slots(result.seen.layout)] = True
    return is_broken


def _rejected(result: RecordingResult) -> tuple[dict[str, str], ...]:
    chosen = {finding.effect for finding in result.findings}
    return tuple(
        {"effect": word, "why": f"alone it explains {gain:.2f} noise variances a row, {score:.2f} after its penalty"}
        for word, gain, score in result.candidates
        if word not in chosen
    )
