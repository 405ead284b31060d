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
from ..finding import Finding
from ..opinion import Opinion
from ..outcome import Outcome
from . import figures, findings, modelling, walk
from .camps import LEAST_STEPS, camps
from .deciding import Decided
from .evidence import Evidence
from .findings import Explained
from .hypothesis import Hypothesis
from .known import Agreed, Known, agreed
from .naming import Naming
from .part import Part, part
from .walk import Walk

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

    camps: tuple[Explained, ...]  # of walks that do not contradict each other; the model is of the first
    effects: tuple[Effect, ...]  # that were found in them
    opinions: Mapping[str, Opinion]  # by word, of the effects that were known from elsewhere

    @property
    def explained(self) -> Explained:
        """Most of the walks."""
        return self.camps[0]

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
    of_walks = camps(parts, deadline, progress)
    names = tuple(each.walk.name for each in parts)
    found, (effects, *_), (of_drifts, *_) = _findings(of_walks)
    found += [finding for each in audits for finding in each.findings]
    found.sort(key=lambda each: -each.explains)
    most, of_all = of_walks[0], known is None and len(of_walks) == 1
    of_the_day = of_drifts if most.names[0] == names[0] else []  # a model's times are those of the first recording
    provenance = {
        "made_by": f"insole diagnose {__version__}", "recordings": list(names), BEGAN: int(feet[0].t_ns[0]),
    }  # fmt: skip
    return WalkDiagnosis(
        recordings=names,
        against="model",
        verdict=outcome.verdict(found),
        heldout=_heldout(of_walks, most.evidence if of_all else Evidence(handed_in)),
        clocks=_clocks(of_walks, names),
        findings=tuple(found),
        rejected=_rejected(of_walks[0]),
        not_identifiable=_not_identifiable(of_walks[0], parts),
        model=modelling.document(
            most.evidence, most.recalibration, [*agrees.effects, *effects, *of_the_day], provenance
        ),
        camps=tuple(of_walks),
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


def _findings(of_walks: Sequence[Explained]) -> tuple[list[Finding], list[list[Effect]], list[list[Effect]]]:
    """Of all camps, and of each its effects and its drifts."""
    found, effects, of_drifts = list[Finding](), [], []
    for camp in of_walks:
        named, own = findings.named(camp)
        drifting, own_drifts = findings.drifts(camp)
        effects.append(own)
        of_drifts.append(own_drifts)
        for each in named:
            may_be = {each.effect, *each.alternatives}
            against = [
                name for other in of_walks if other is not camp and not may_be & other.words for name in other.names
            ]
            found.append(replace(each, contradicted_by=(*each.contradicted_by, *against)))
        found += drifting + findings.gains(camp)
    return found, effects, of_drifts


def _heldout(of_walks: Sequence[Explained], handed_in: Evidence) -> Mapping[str, Any]:
    """Of f_z, with the moments beside it: the model as it was `handed_in`, what was found, and the noise."""
    static = Hypothesis(handed_in, ())
    before = static.unexplained(static.fit())
    walks = [len(each.names) for each in of_walks]

    def told(channel: int, unit: str) -> dict[str, Any]:
        after = [each.rms(each.decided.best, channel) for each in of_walks]
        floor = [figures.floor(each.evidence, channel) for each in of_walks]
        both = (float(np.sqrt(np.average(np.square(each), weights=walks))) for each in (after, floor))
        values = (figures.rms(handed_in, before, channel), *both)
        return {"unit": unit, **{k: round(v, 4) for k, v in zip(("before", "after", "floor"), values, strict=True)}}

    return {**told(0, "N"), "m_x": told(1, "N·m"), "m_y": told(2, "N·m")}


def _clocks(of_walks: Sequence[Explained], names: Sequence[str]) -> Array:
    """(recordings, 2) offset_s and rate of the shoe's clock: a delay is in neither."""
    found = {}
    for each in of_walks:
        best = each.decided.best
        moved = Hypothesis(each.evidence, tuple(best.terms)).clocks(best.fitted.theta)
        for own, (late, rate) in zip((walked.walk for walked in each.evidence.parts), moved.tolist(), strict=True):
            told = (own.shoe.epoch_s + own.offset_s - late, own.rate + rate)
            found[own.name] = told if own.shoe.clock == "own" else (0.0, 0.0)
    return np.array([found[name] for name in names])


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


def _not_identifiable(explained: Explained, parts: Sequence[Part]) -> tuple[dict[str, str], ...]:
    found = [
        {"effect": word, "why": why.format(n=len(parts[0].walk.slots)), "record_instead": instead}
        for word, (why, instead) in INVISIBLE.items()
    ]
    if any(each.walk.shoe.clock == "own" for each in parts):
        found.append({"effect": "delay", "why": OWN_CLOCK, "record_instead": "the shoe on the clock of the CAN frames"})
    for word, others in explained.decided.alternatives.items():
        for other in others:
            found.append({"effect": other, "why": f"this walk cannot tell it from {word}",
                          "record_instead": f"faster steps, a tap with the foot, and {_CHAMBER}"})  # fmt: skip
    return tuple(found)
