"""A chamber and walks of one insole, explained together.

In a chamber the load is known on every taxel: what it excites is named there. The walks are then told with its curves,
its effects of the material undone where they agree, and say what is left. What only heel strikes can tell, lag and
delay, the walks decide. Each half is asked what it says of what the other one found; who contradicts is named.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import __version__
from ..config import Foot
from ..physics import effects_document
from ..physics.calibration import BEGAN, Calibration
from ..physics.dynamic import OF_THEIR_TIME
from ..recording.loading import Recording
from . import diagnosing, modelling
from .confronted import opinions
from .continued import onwards
from .diagnosing import Diagnosis
from .feet import choose
from .finding import Finding
from .foot import diagnosing as on_foot
from .foot.diagnosing import WalkDiagnosis
from .foot.known import MEMORY, Known
from .foot.naming import TIMING
from .opinion import Opinion
from .outcome import Outcome, verdict


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Together(Outcome):
    """What is said of both, and the two halves it was told from."""

    chamber: Diagnosis
    walks: WalkDiagnosis


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    budget_s: float | None,
    progress: Callable[[str], None],
    asked: Foot | None = None,
) -> Together:
    """What differs between chambers and force shoes and the static model `calibration`, else the first recording's own.

    DiagnosisError and UndecidableError as each half has them.
    """
    began_s = time.monotonic()
    feet = choose(recordings, asked)
    model = on_foot.static_model(recordings[0], feet[0], calibration)
    in_chamber = [each for each in recordings if each.kind == "chamber"]
    shoes = [i for i, each in enumerate(recordings) if each.kind != "chamber"]
    chamber = diagnosing.diagnose(in_chamber, model, budget_s, progress, asked=asked)
    material = tuple(each for each in chamber.effects if each.law.word in MEMORY)
    layout = feet[0].layout

    def curves(highest_pa: float) -> Calibration:
        reaching = [onwards(each, model, highest_pa) for each in chamber.curves]
        return modelling.static(layout.foot, layout, reaching)

    left_s = None if budget_s is None else budget_s - (time.monotonic() - began_s)
    walks = on_foot.diagnose(
        [recordings[i] for i in shoes], [feet[i] for i in shoes], model, left_s, progress, Known(curves, material)
    )
    progress("asking the chamber what it says of the walks")
    of_walks = opinions(chamber, [each for each in walks.effects if each.law.word in MEMORY])
    names = tuple(each.folder.name for each in recordings)
    findings = tuple(_in_order(each, names) for each in _findings(chamber, walks, of_walks))
    halves = {name: half for half in (chamber, walks) for name in half.recordings}
    provenance = {"made_by": f"insole diagnose {__version__}", "recordings": list(names), BEGAN: int(feet[0].t_ns[0])}
    clocks = {name: row for half in (chamber, walks) for name, row in zip(half.recordings, half.clocks, strict=True)}
    return Together(
        recordings=names,
        against="model",
        verdict=verdict(findings),
        heldout={**chamber.heldout, **_of_walks(walks.heldout)},
        clocks=np.array([clocks[name] for name in names]),
        findings=findings,
        rejected=_rejected(chamber, walks, findings),
        not_identifiable=_not_identifiable(chamber, walks, findings),
        model={
            **walks.model,
            "effects": _effects(chamber, walks, first=halves[names[0]]),
            "provenance": provenance,
        },
        chamber=chamber,
        walks=walks,
    )


def _findings(chamber: Diagnosis, walks: WalkDiagnosis, of_walks: Mapping[str, Opinion]) -> tuple[Finding, ...]:
    """Of both, in the order of what each explains beside its own noise."""
    found: list[Finding] = []
    named = {each.effect: each for each in walks.findings}
    settled: dict[str, Finding] = {}
    for each in chamber.findings:
        each = replace(each, explains=each.explains / float(chamber.heldout["floor"]) ** 2)
        opinion = walks.opinions.get(each.effect)
        if opinion is not None:
            against = opinion.contradicted_by
            rms = f"{opinion.rms[0]:.1f} to {opinion.rms[1]:.1f} N"
            each = _asked(each, opinion, f"Undone on the walks it takes the error of the force from {rms}.")
        elif each.effect in TIMING and each.where.scope == "insole" and _could_tell(walks, each.effect):
            against = () if each.effect in named else walks.recordings
            each = replace(each, contradicted_by=(*each.contradicted_by, *against))
        else:
            against = ()
        # Where the walks decide otherwise, and the chamber could not tell the two apart, it is what the walks say.
        others = [word for word in (each.effect, *each.alternatives) if word in named]
        if others and (against == walks.recordings or each.effect in TIMING):
            settled[others[0]] = each
        else:
            found.append(each)
    for each in walks.findings:
        each = replace(each, explains=each.explains / float(walks.heldout["floor"]) ** 2)
        if each.effect in settled:
            each = replace(each, recordings=(*settled[each.effect].recordings, *each.recordings))
        elif each.effect in of_walks:
            opinion = of_walks[each.effect]
            more = "beside what was found there " if each.effect in walks.opinions else ""
            rms = f"{opinion.rms[0]:.2f} to {opinion.rms[1]:.2f} counts"
            cares = opinion.shown_by or opinion.contradicted_by
            said = f"{more}takes what is left of its blocks from {rms}" if cares else "makes no difference"
            each = _asked(each, opinion, f"In the chamber it {said}.")
        found.append(each)
    return tuple(sorted(found, key=lambda each: -each.explains))


def _in_order(finding: Finding, names: Sequence[str]) -> Finding:
    """With its recordings as they were given."""
    shown_by, against = ([n for n in names if n in each] for each in (finding.recordings, finding.contradicted_by))
    return replace(finding, recordings=tuple(shown_by), contradicted_by=tuple(against))


def _asked(finding: Finding, opinion: Opinion, sentence: str) -> Finding:
    """With what the other half says of it."""
    against = f" Against it: {', '.join(opinion.contradicted_by)}." if opinion.contradicted_by else ""
    return replace(
        finding,
        recordings=(*finding.recordings, *opinion.shown_by),
        contradicted_by=(*finding.contradicted_by, *opinion.contradicted_by),
        sentence=f"{finding.sentence} {sentence}{against}",
    )


def _could_tell(walks: WalkDiagnosis, word: str) -> bool:
    return word not in {each["effect"] for each in walks.not_identifiable}


def _effects(chamber: Diagnosis, walks: WalkDiagnosis, first: Outcome) -> list[Mapping[str, Any]]:
    """Of the model, which is for walking: what the walks agree with and found, and what they cannot see.

    Of times their own, only those of the recording named `first`: the model's begin with it.
    """
    material = (*MEMORY, *(word for word in TIMING if _could_tell(walks, word)))
    of_chamber = [
        each
        for each in chamber.effects
        if (each.law.word not in material or (each.where.scope != "insole" and each.law.word in TIMING))
        and (each.law.word not in OF_THEIR_TIME or first is chamber)
    ]
    of_walks = [each for each in walks.model["effects"] if each["effect"] not in OF_THEIR_TIME or first is walks]
    return [*effects_document.document(of_chamber, chamber.insole.layout), *of_walks]


def _of_walks(heldout: Mapping[str, Any]) -> dict[str, Any]:
    """The error of the force and of the moments, each under its own word."""
    force = {name: heldout[name] for name in ("unit", "before", "after", "floor")}
    return {"f_z": force, "m_x": heldout["m_x"], "m_y": heldout["m_y"]}


def _rejected(chamber: Diagnosis, walks: WalkDiagnosis, findings: Sequence[Finding]) -> tuple[Mapping[str, str], ...]:
    named = {each.effect for each in findings}
    return tuple(
        {"effect": each["effect"], "why": f"{where}: {each['why']}"}
        for where, half in (("in the chamber", chamber), ("on the walks", walks))
        for each in half.rejected
        if each["effect"] not in named
    )


def _not_identifiable(
    chamber: Diagnosis, walks: WalkDiagnosis, findings: Sequence[Finding]
) -> tuple[Mapping[str, str], ...]:
    """What neither half can tell, and what stands beside a finding as its alternative."""
    in_both = {each["effect"] for each in chamber.not_identifiable} & {
        each["effect"] for each in walks.not_identifiable
    }
    open_still = in_both | {word for each in findings for word in each.alternatives}
    found: dict[str, Mapping[str, str]] = {}
    for each in (*chamber.not_identifiable, *walks.not_identifiable):
        if each["effect"] in open_still:
            found[each["effect"]] = each  # what the walks lack stands last: it is what nothing has shown
    return tuple(found.values())
