"""`insole diagnose` where a force shoe says the load in sum: the order of the stages."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ... import __version__
from ...errors import DiagnosisError, UndecidableError
from ...physics.calibration import BEGAN, Calibration
from ...physics.effect import Effect
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from .. import outcome
from ..audit import audit
from ..opinion import Opinion
from ..outcome import Outcome
from . import figures, findings, modelling, nulls, walk
from .deciding import Decided, decide
from .evidence import Evidence, part
from .findings import Explained
from .hypothesis import Hypothesis
from .known import Agreed, Known, agreed
from .naming import Naming, Search, Tried
from .walk import Walk

LEAST_STEPS = 3
_PER_TAXEL = "three sums of {n} taxels hold nothing of a single one"
_CHAMBER = "the insole in a vacuum bag or a chamber, where the load is known on every taxel"
INVISIBLE = {
    "crosstalk": ("it moves load between neighbours and leaves their sum as it is", "an indenter one taxel wide"),
    "swapped_triangles": (
        _PER_TAXEL,
        "the same walk simulated, as the load (--simulation), or pressing on one triangle",
    ),
    "map_transform": (
        "a turned or shifted map and unequal gains of triangles move the same moments",
        "the same walk simulated, as the load (--simulation)",
    ),
    "preload": ("a constant load in the shoe is a part of the rest", "the unloaded insole in the shoe and outside"),
    "creep": (
        "in the minutes of a walk it looks like a rest that wanders, or a viscoelasticity",
        "a hold of at least 60 s, then 60 s without load",
    ),
    "temperature": ("an insole that only warms up wanders as a drift does", "warming up and cooling down again"),
    "snap": ("in a sum of taxels that snap one after the other it has no edge", _CHAMBER),
}
OWN_CLOCK = "the shoe has a clock of its own, whose offset a delay of all boards cannot be told from"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalkDiagnosis(Outcome):
    """What is said of walks, and what it was told from."""

    explained: Explained
    gains_of_nulls: Array
    effects: tuple[Effect, ...]  # that were found in them
    opinions: Mapping[str, Opinion]  # by word, of the effects that were known from elsewhere

    @property
    def decided(self) -> Decided:
        """What was decided of the walks."""
        return self.explained.decided

    @property
    def naming(self) -> Naming:
        """All that was tried."""
        return self.explained.naming


def diagnose(
    recordings: Sequence[Recording],
    feet: Sequence[FootRecording],
    calibration: Calibration | None,
    budget_s: float | None,
    progress: Callable[[str], None],
    known: Known | None = None,
) -> WalkDiagnosis:
    """What differs between walks, or standing, and the static model: `calibration`, else the first recording's own.

    `feet`: the one foot of each recording; `known`: what a chamber has shown of the same insole. DiagnosisError where
    they cannot show anything, UndecidableError where there are too few steps.
    """
    deadline = math.inf if budget_s is None else time.monotonic() + budget_s
    model = static_model(recordings[0], feet[0], calibration)
    progress("auditing the readings")
    audits = [audit(foot, each.folder.name, steps=True) for foot, each in zip(feet, recordings, strict=True)]
    kept = np.all([each.kept for each in audits], axis=0)

    def read(static: Calibration) -> list[Walk]:
        return [
            walk.read(recording, foot, static, replace(audited, kept=kept))
            for recording, foot, audited in zip(recordings, feet, audits, strict=True)
        ]

    handed_in = [part(each) for each in read(model)]
    parts, agrees = handed_in, Agreed((), (), {})
    if known is not None:
        highest_pa = max(float(each.walk.pressure_pa.max()) for each in handed_in)
        agrees = agreed(read(known.curves(highest_pa)), known, progress)
        parts = [part(each) for each in agrees.walks]
    steps = sum(len(each.contacts) for each in parts)
    if steps < LEAST_STEPS:
        raise UndecidableError(
            f"{recordings[0].folder}: the foot is loaded {steps} times, expected at least {LEAST_STEPS} steps: one "
            "rise and fall fits any physics. Record a walk of a minute"
        )
    evidence = Evidence(parts)
    progress("noise alone: what it would explain")
    of_nulls = nulls.gains(evidence)
    search = Search(evidence, nulls.price(of_nulls))
    progress(f"searching what explains {steps} steps")
    naming = search.name(deadline)
    progress("decoys: what a filter without physics explains")
    decided = decide(search, naming)
    hypothesis = Hypothesis(evidence, tuple(decided.best.terms))
    recalibration = evidence.recalibration(hypothesis.unexplained(decided.best.fitted), None)
    names = tuple(each.walk.name for each in parts)
    explained = Explained(evidence, names, naming, decided, recalibration)
    found, effects = findings.named(explained)
    drifting, of_drifts = findings.drifts(explained)
    found += drifting + findings.gains(explained)
    found += [finding for each in audits for finding in each.findings]
    found.sort(key=lambda each: -each.explains)
    provenance = {
        "made_by": f"insole diagnose {__version__}", "recordings": list(names), BEGAN: int(feet[0].t_ns[0]),
    }  # fmt: skip
    return WalkDiagnosis(
        recordings=names,
        against="model",
        verdict=outcome.verdict(found),
        heldout=_heldout(explained, evidence if known is None else Evidence(handed_in)),
        clocks=_clocks(hypothesis, decided.best),
        findings=tuple(found),
        rejected=_rejected(explained),
        not_identifiable=_not_identifiable(explained, len(parts[0].walk.slots)),
        model=modelling.document(evidence, recalibration, [*agrees.effects, *effects, *of_drifts], provenance),
        explained=explained,
        gains_of_nulls=of_nulls,
        effects=tuple(effects),
        opinions=agrees.opinions,
    )


def static_model(first: Recording, foot: FootRecording, calibration: Calibration | None) -> Calibration:
    """The model that is asked about: `calibration`, else that of `foot` in the first recording; DiagnosisError."""
    model = calibration if calibration is not None else foot.calibration
    if model is None:
        raise DiagnosisError(
            f"{first.folder}: expected a calibration, found none: a wrench is told from pressures. "
            "Give one with --calibration; insole calibrate makes it"
        )
    if model.effects:
        words = ", ".join(each.law.word for each in model.effects)
        raise DiagnosisError(f"the model has effects already ({words}), expected a static one: diagnose against that")
    return model


def _heldout(explained: Explained, handed_in: Evidence) -> Mapping[str, Any]:
    """Of f_z, with the moments beside it: the model as it was `handed_in`, what was found, and the noise."""
    static = Hypothesis(handed_in, ())
    before = static.unexplained(static.fit())

    def told(channel: int, unit: str) -> dict[str, Any]:
        values = (
            figures.rms(handed_in, before, channel),
            explained.rms(explained.decided.best, channel),
            figures.floor(explained.evidence, channel),
        )
        return {"unit": unit, **{k: round(v, 4) for k, v in zip(("before", "after", "floor"), values, strict=True)}}

    return {**told(0, "N"), "m_x": told(1, "N·m"), "m_y": told(2, "N·m")}


def _clocks(hypothesis: Hypothesis, best: Tried) -> Array:
    """(recordings, 2) offset_s and rate of the shoe's clock: a delay is in neither."""
    moved = hypothesis.clocks(best.fitted.theta)
    return np.array([
        (part.walk.shoe.epoch_s * (part.walk.shoe.clock == "own") + part.walk.offset_s - late, part.walk.rate + rate)
        if part.walk.shoe.clock == "own" else (0.0, 0.0)
        for part, (late, rate) in zip(hypothesis.evidence.parts, moved.tolist(), strict=True)
    ])  # fmt: skip


def _rejected(explained: Explained) -> tuple[dict[str, str], ...]:
    best, decided = explained.decided.best, explained.decided
    found = [
        {
            "effect": word,
            "why": "the same filter run backwards, which no physics does, explains it as well: it averages noise",
        }
        for word in decided.denoising
    ]
    singles = {
        next(iter(t.words)): t
        for t in explained.naming.tried
        if len(t.terms) == 1 and not any(e.backwards for e in t.terms)
    }
    found += [
        {"effect": word, "why": f"alone it leaves {explained.rms(tried):.1f} N on held-out steps, "
         f"{' + '.join(sorted(best.words)) or 'the static model'} leaves {explained.rms(best):.1f} N"}
        for word, tried in singles.items() if word not in best.words and word not in decided.denoising
    ]  # fmt: skip
    return tuple(found)


def _not_identifiable(explained: Explained, n_taxels: int) -> tuple[dict[str, str], ...]:
    found = [
        {"effect": word, "why": why.format(n=n_taxels), "record_instead": instead}
        for word, (why, instead) in INVISIBLE.items()
    ]
    if any(each.walk.shoe.clock == "own" for each in explained.evidence.parts):
        found.append({"effect": "delay", "why": OWN_CLOCK, "record_instead": "the shoe on the clock of the CAN frames"})
    for word, others in explained.decided.alternatives.items():
        for other in others:
            found.append({"effect": other, "why": f"this walk cannot tell it from {word}",
                          "record_instead": f"faster steps, a tap with the foot, and {_CHAMBER}"})  # fmt: skip
    return tuple(found)
