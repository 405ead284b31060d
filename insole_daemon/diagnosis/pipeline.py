"""`insole diagnose`: what several recordings of one insole say together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..config import Foot
from ..physics.calibration import BEGAN, Calibration
from ..physics.effect import Effect
from ..recording.loading import Recording
from . import merging, outcome
from .export import wrench_model
from .feet import choose
from .finding import Finding, Verdict
from .model.blocks import RECALIBRATIONS
from .observing import observed, refuse_mixture, refuse_still
from .one_recording import diagnose_one
from .result import Diagnosis, RecordingResult
from .timings import clock_of
from .unexplained import MOST_NULL, UNKNOWN_EXCESS, excess

OF_THE_INSOLE = (*merging.LASTING, "delay")  # of several recordings
NEVER_TELL = ("dead_taxels", "open_triangle")  # where they are there all the time


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    progress: Callable[[str], None],
    simulations: Sequence[Recording] = (),
    asked: Foot | None = None,
) -> Diagnosis:
    """What differs between recordings and the static model, under the load of their references.

    The model is `calibration`, else the first recording's own, else the curves that fit chambers best. `simulations`:
    of their trials, one for each or one for all, whose load then stands for the references'. `asked`: the foot, where
    there are two. DiagnosisError where the recordings do not belong together or cannot show anything, UndecidableError
    where the insole is loaded too seldom.
    """
    refuse_mixture(recordings, simulations)
    feet = choose(recordings, asked, bool(simulations))
    every = observed(recordings, feet, calibration, progress, simulations)
    refuse_still([each for each in every if each.is_uniform])
    # Observations are large: each goes once it is replaced by one without the faults of its readings.
    results = [diagnose_one(every.pop(0), foot, progress) for foot in feet]
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
    return Diagnosis(
        recordings=names,
        against="simulation" if simulations else "model",
        verdict=_verdict(heldout, findings, results),
        heldout=heldout,
        clocks=np.array([clock_of(each) for each in results]),
        findings=findings,
        rejected=_rejected(first),
        not_identifiable=_never_told(results),
        model=wrench_model.document(
            first.seen, effects, _absorbed(first), provenance, first.figures.recalibrated, _broken(first)
        ),
        results=tuple(results),
        effects=effects,
    )


def _effects(
    results: Sequence[RecordingResult], first: RecordingResult, findings: Sequence[Finding]
) -> tuple[Effect, ...]:
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


def _never_told(results: Sequence[RecordingResult]) -> tuple[dict[str, str], ...]:
    """What none of the recordings can tell."""
    others = [{row["effect"] for row in each.not_identifiable} for each in results[1:]]
    return tuple(row for row in results[0].not_identifiable if all(row["effect"] in other for other in others))


def _heldout(results: Sequence[RecordingResult]) -> dict[str, Any]:
    """Of all taxels in counts where the load is known, and of the wrench, each over all its recordings."""
    known = [each for each in results if each.seen.load_is_known]
    walks = [each for each in results if not each.seen.load_is_known]
    moments = {"m_x": _pooled(walks, 1, "N·m"), "m_y": _pooled(walks, 2, "N·m")} if walks else {}
    if not known:
        return {**_pooled(walks, 0, "N"), **moments}
    return {**_pooled(known, 0, "count"), **({"f_z": _pooled(walks, 0, "N"), **moments} if walks else {})}


def _pooled(results: Sequence[RecordingResult], channel: int, unit: str) -> dict[str, Any]:
    weights = [int(each.figures.known.sum()) for each in results]
    figures_of = {
        name: float(np.sqrt(np.average([getattr(r.figures, name)[channel] ** 2 for r in results], weights=weights)))
        for name in ("before", "after", "floor")
    }
    return {"unit": unit, **{name: round(value, 4) for name, value in figures_of.items()}}


def _verdict(heldout: dict[str, Any], findings: Sequence[Finding], results: Sequence[RecordingResult]) -> Verdict:
    before, after, floor = (float(heldout[name]) for name in ("before", "after", "floor"))
    # What a declared clock may be off by within its prior is no mismatch.
    calm = all(float(np.max(excess(r.figures, r.design))) < UNKNOWN_EXCESS for r in results)
    return outcome.verdict(
        before if findings else min(before, after), after, floor, MOST_NULL * floor if calm else floor,
        findings=len(findings), unknown=sum(each.effect == "unknown" for each in findings),
        undecided=any(each.alternatives for each in findings),
    )  # fmt: skip


def _absorbed(result: RecordingResult) -> list[wrench_model.Absorbed]:
    """What the curves handed in had absorbed of the effects found."""
    inner, found = result.refined.design, {}
    for candidate in inner.candidates:
        for word, column in zip(candidate.companion_words, candidate.companions.tolist(), strict=True):
            if word not in RECALIBRATIONS:
                continue  # what an earlier load has left is no part of a curve
            share = result.figures.companion_shares.get(column, 0.0)
            found[column] = wrench_model.Absorbed(word, candidate.where, share)
    return list(found.values())


def _broken(result: RecordingResult) -> NDArray[np.bool_]:
    """(T, 12) taxels that never tell the load."""
    found = np.zeros(result.seen.usable.shape, bool)
    for each in result.findings:
        if each.effect in NEVER_TELL and not each.when_s:
            found.reshape(-1)[each.where.slots(result.seen.layout)] = True
    return found


def _rejected(result: RecordingResult) -> tuple[dict[str, str], ...]:
    chosen = {each.effect for each in result.findings}
    return tuple(
        {"effect": word, "why": f"alone it takes away {gain:.2f} noise variances a row, {score:.2f} after its price"}
        for word, gain, score in result.candidates
        if word not in chosen
    )
