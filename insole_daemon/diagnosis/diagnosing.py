"""`insole diagnose`, from recordings to what is said of them: the order of the stages."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import __version__
from ..config import Foot
from ..errors import DiagnosisError
from ..physics.calibration import BEGAN, Calibration
from ..physics.effect import Effect
from ..physics.law import Array
from ..recording.loading import FootRecording, Recording
from . import beside, explained, handed_in, modelling
from . import jumps as jumping
from .agreement import agreed
from .audit import Audit, audit
from .candidate import Candidate, Excitation
from .candidates import candidates
from .carried import carried
from .deciding import RECORD, TWINS, Decided, decide, shown
from .decoys import challenged
from .evidence import Taxels
from .excitation import excitation
from .explained import Insole
from .feet import choose
from .groups import Located, locate
from .modelling import Curves
from .observed import Observed
from .observing import observe
from .one_cause import of_one_cause
from .outcome import Outcome, verdict_of
from .reference_faults import without_drift, without_steps
from .rezeros import rezeroed
from .static import LEAST as LEAST_STATIC

INVISIBLE = {
    "crosstalk": ("under a uniform load every neighbour says the same", "an indenter one taxel wide, or walking"),
    "preload": ("a constant load is a part of the static curve here", "the unloaded insole in the shoe and outside"),
    "map_transform": ("a uniform load has no place", "walking or standing with a force shoe"),
    "swapped_triangles": ("a uniform load is the same on both", "walking, or pressing on one triangle"),
}
# Times the noise floor: what `before` may be where nothing differs, 1.25 in squares. Beside the white noise, of which
# the floor is told, readings have slow noise, up to a fifth of their variance, and a calibration is never exact.
MOST_NULL = 1.118
MISSING = {
    "drift": "at least three cycles",
    "delay": "the reference on the clock of the CAN frames",
    "temperature": "an insole that warms up and cools down",
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Diagnosis(Outcome):
    """What is said where the load is known on every taxel, and what it was told from."""

    insole: Insole
    observed: tuple[Observed, ...]
    located: Located
    decided: tuple[Decided, ...]  # of each of the located groups
    curves: tuple[Curves, ...]  # of the model
    effects: tuple[Effect, ...]


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    budget_s: float | None,
    progress: Callable[[str], None],
    asked: Foot | None = None,
) -> Diagnosis:
    """What differs between recordings and their model, where the load is known.

    `calibration`: the model that is asked about; without it that of the first recording, without both only memory
    and faults are looked for. After `budget_s` no larger subsets are tried. `asked`: the foot, where there are two.
    DiagnosisError where the recordings do not belong together or cannot show anything.
    """
    deadline = math.inf if budget_s is None else time.monotonic() + budget_s
    feet = choose(recordings, asked)
    layout = feet[0].layout
    model = calibration if calibration is not None else feet[0].calibration
    if model is not None and model.builtin:  # it is nobody's belief of this insole
        model = None
    if model is not None and model.effects:
        words = ", ".join(each.law.word for each in model.effects)
        raise DiagnosisError(f"the model has effects already ({words}), expected a static one: diagnose against that")
    progress("auditing the readings")
    audits = [audit(foot, each.folder.name) for foot, each in zip(feet, recordings, strict=True)]
    observed, spikes = _observe(recordings, feet, audits)
    as_read = observed
    excited = excitation(observed)
    slots = observed[0].slots
    noise = np.sqrt(np.mean([each.noise_count**2 for each in observed], axis=0))
    observed, faults = without_steps(observed, noise)
    taxels = Taxels(tuple(observed), slots, noise)
    found_jumps = rezeroed(taxels)
    every = candidates(excited)
    admitted = {word: each for word, each in every.items() if each.needs(excited) is None}
    jumps = jumping.columns(observed, found_jumps)
    located = locate(taxels, admitted, jumps, deadline, progress)
    if _drifts(located) or any(found_jumps):  # it may have been at once, and more or less than without physics
        found_jumps = rezeroed(taxels, found_jumps, located)
        looked_at, jumps = jumps, jumping.columns(observed, found_jumps)
        if not np.array_equal(looked_at, jumps):
            located = locate(taxels, admitted, jumps, deadline, progress)
    observed, drifts = without_drift(observed, noise, located)
    if drifts:
        faults += drifts
        taxels = replace(taxels, observed=tuple(observed))
        located = locate(taxels, admitted, jumps, deadline, progress)
    progress("asking every recording, and decoys")
    tested = tuple(challenged(agreed(each, admitted, deadline)) for each in located.named)
    located = replace(located, named=of_one_cause(tested, excited))
    decided = [carried(each, decide(each.naming, excited, each.group.evidence.y.size)) for each in located.named]
    progress("fitting the model")
    names = tuple(each.name for each in observed)
    insole = Insole(feet[0].foot, layout, names, slots, noise, excited)
    parts = list(zip(located.named, decided, strict=True))
    curves = explained.curves(insole, located, parts)
    sure = explained.curves(insole, located, parts, sure=True)
    before, after = explained.held_out(insole, located, parts)
    findings, effects = explained.findings(insole, parts)
    findings += [finding for each in audits for finding in each.findings]
    findings += [
        finding for name, when in zip(names, spikes, strict=True) for finding in beside.of_spikes(insole, name, when)
    ]
    findings += beside.of_reference(insole, faults)
    jumped = beside.of_jumps(insole, observed, found_jumps)
    late = beside.of_delays(insole, observed, located)
    findings += [*jumped, *late]
    own = [each for each in jumped if each.recordings == names[:1]]  # a model's times are those of the first recording
    effects += [modelling.as_effect(each.effect, each.where, each.parameters) for each in [*own, *late]]
    clocks, clocks_std = _clocks(observed, located)
    findings += beside.of_clocks(insole, observed, clocks, clocks_std)
    blurred: list[dict[str, str]] = []
    if model is not None:
        bits = [board.shift for board in feet[0].boards if board.shift is not None]
        creeps = any("creep" in each.best.words for each in decided)
        holds = handed_in.components(insole, located, parts)
        recalibrated, held_count = beside.of_curves(insole, curves, model, bits, creeps, holds)
        findings += recalibrated
        told = {each.effect for each in recalibrated}
        if held_count > LEAST_STATIC * float(np.median(noise)):
            blurred = [_blurred(word, held_count) for word in ("gain", "baseline") if word not in told]
        before = handed_in.mismatch(replace(taxels, observed=tuple(as_read)), located.null.theta, model)
    findings.sort(key=lambda each: -each.explains)
    floor = float(np.mean(noise**2))
    rms = [round(float(np.sqrt(floor + square)), 4) for square in (before, after, 0.0)]
    heldout: dict[str, Any] = {"unit": "count", **dict(zip(("before", "after", "floor"), rms, strict=True))}
    provenance = {"made_by": f"insole diagnose {__version__}", "recordings": list(names), BEGAN: int(feet[0].t_ns[0])}
    return Diagnosis(
        recordings=names,
        insole=insole,
        against="model",
        verdict=verdict_of(findings, heldout, MOST_NULL * rms[2]),
        heldout=heldout,
        clocks=clocks,
        findings=tuple(findings),
        rejected=_rejected(parts),
        not_identifiable=(*_not_identifiable(every, excited, decided), *blurred),
        model=modelling.document(insole.foot, layout, sure, effects, provenance),
        observed=tuple(observed),
        located=located,
        decided=tuple(decided),
        curves=tuple(sure),
        effects=tuple(effects),
    )


def _observe(
    recordings: Sequence[Recording], feet: Sequence[FootRecording], audits: Sequence[Audit]
) -> tuple[list[Observed], list[tuple[tuple[float, float], ...]]]:
    """What is looked at of each recording, the same taxels of all, and when its reference had spikes."""
    kept = np.all([each.kept for each in audits], axis=0)
    if not kept.any():
        raise DiagnosisError(f"{recordings[0].folder}: no taxel says anything that can be believed: see the audit")
    seen = [
        observe(recording, foot, kept, audited)
        for recording, foot, audited in zip(recordings, feet, audits, strict=True)
    ]
    return [each for each, _ in seen], [spikes for _, spikes in seen]


def _drifts(located: Located) -> bool:
    return any("drift" in each.naming.best.words for each in located.named)


def _clocks(observed: Sequence[Observed], located: Located) -> tuple[Array, Array]:
    """(recordings, 2) offset_s and rate by the best explanation of most taxels, and their standard deviations."""
    found = np.array([(each.began_s + each.offset_s, each.rate) for each in observed])
    std = np.array([each.clock_std for each in observed])
    best = next((each for each in located.named if 2 * len(each.group.slots) > len(located.slots)), None)
    fitted = best.naming.best.fitted if best is not None else located.null
    corrections = fitted.clocks()
    if best is not None and corrections.size:
        std = np.maximum(std, best.naming.best.std[: corrections.size].reshape(-1, 2))
    return (found + corrections if corrections.size else found), std


def _rejected(
    parts: explained.Explained,
) -> tuple[dict[str, str], ...]:
    found: dict[str, str] = {}
    for named, each in parts:
        for decoy in named.naming.decoys:
            if decoy.as_good and decoy.word not in each.best.words:
                found[decoy.word] = (
                    f"{decoy.kind}, where it is no physics, it leaves {max(decoy.left, 0):.1%} of the mismatch "
                    f"on held-out blocks, and {max(decoy.effect_left_heldout, 0):.1%} as it should be"
                )
        for tried in named.naming.tried:
            if len(tried.words) == 1 and tried.words[0] not in each.best.words:
                found.setdefault(
                    tried.words[0],
                    f"alone it leaves {max(tried.left_heldout, 0):.0%} of the mismatch on held-out blocks, "
                    f"{' + '.join(each.best.words) or 'nothing'} leaves {max(each.best.left_heldout, 0):.0%}",
                )
    return tuple({"effect": word, "why": why} for word, why in found.items())


def _blurred(word: str, held_count: float) -> dict[str, str]:
    return {
        "effect": word,
        "why": f"the calibration may hold up to {held_count:.1f} counts of the mean of what was found: less cannot be "
        "told from it",
        "record_instead": "a calibration that waits at every level, at the temperature of the trial",
    }


def _not_identifiable(
    every: Mapping[str, Candidate],
    excited: Excitation,
    decided: Sequence[Decided],
) -> tuple[dict[str, str], ...]:
    found = [{"effect": word, "why": why, "record_instead": instead} for word, (why, instead) in INVISIBLE.items()]
    for word, each in every.items():
        why = each.needs(excited)
        if why is not None and word != "clock":  # an own clock is aligned, and told of beside the candidates
            found.append({"effect": word, "why": why, "record_instead": MISSING.get(word, "more of that")})
    there = shown(excited)
    for said_of in decided:
        for word, others in said_of.alternatives.items():
            for other in others:
                needed = TWINS.get(frozenset({word, other}))
                if needed is not None and needed not in there:
                    found.append({"effect": other, "why": f"these recordings cannot tell it from {word}",
                                  "record_instead": RECORD[needed]})  # fmt: skip
    return tuple(found)
