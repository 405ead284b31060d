"""What counts as right, case by case, as the contract says it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

# A calibration is always a few per cent wrong, and what recalibration removes is to be reported: on a case where
# nothing of the kind was concealed such a finding is neither right nor wrong.
NUISANCE = ("gain", "baseline")
LONGEST_LIST = 2  # effect and alternatives together; a longer list is a miss
WITH_AMPLITUDE = ("hysteresis", "creep", "viscoelasticity")
NORMAL_90 = 1.645
FULL_STRENGTH = 2.9  # x the floor: "3 x", with the tolerance of the solver


@dataclass(frozen=True)
class Finding:
    effect: str
    alternatives: tuple[str, ...]
    where: dict[str, Any]
    parameters: dict[str, Any]  # as they were said
    confidence: float | None

    def parameter(self, name: str) -> tuple[list[float], list[float]]:
        """Value and standard deviation, each a list; empty where nothing was said."""
        said = self.parameters.get(name)
        said = said if isinstance(said, dict) else {"value": said}
        lists = ([] if said.get(key) is None else said[key] for key in ("value", "std"))
        value, std = (np.atleast_1d(np.asarray(x, float)).tolist() for x in lists)
        return value, std

    @property
    def words(self) -> tuple[str, ...]:
        return (self.effect, *self.alternatives)

    def points(self, wanted: set[str]) -> float:
        """1 when the first-named effect is wanted, a half when an alternative is, none for a list too long."""
        if len(set(self.words)) > LONGEST_LIST:
            return 0.0
        return 1.0 if self.effect in wanted else 0.5 if wanted & set(self.alternatives) else 0.0


def findings(diagnosis: dict[str, Any]) -> list[Finding]:
    """Of an `insole-diagnosis/1`, in their order."""
    out = []
    for f in diagnosis.get("findings", []):
        values = dict(f.get("parameters", {}))
        if "amplitude_fraction" in f:
            values["amplitude_fraction"] = f["amplitude_fraction"]
        alternatives = tuple(a for a in f.get("alternatives", []) if a != f["effect"])
        out.append(Finding(f["effect"], alternatives, f.get("where") or {}, values, f.get("confidence")))
    return out


def counted(found: list[Finding], truth: dict[str, Any]) -> list[Finding]:
    """Without the recalibration nobody concealed."""
    concealed = {e["effect"] for e in truth["effects"]}
    return [f for f in found if f.effect not in NUISANCE or concealed & set(f.words)]


def taxels_of(where: dict[str, Any], every: list[list[int]]) -> set[tuple[int, ...]]:
    """The taxels a `where` speaks of: all of them, or those its ids are the beginning of."""
    ids = [tuple(i) for i in where.get("ids", [])]
    all_taxels = [tuple(t) for t in every]
    if where.get("scope", "insole") == "insole" or not ids:
        return set(all_taxels)
    return {t for t in all_taxels if any(t[: len(i)] == i for i in ids)}


def place_counts(
    found: list[Finding], concealed: dict[str, Any], every: list[list[int]]
) -> tuple[int, int, int] | None:
    """(true positives, false positives, false negatives) of taxels; None where a place has no meaning or no answer."""
    mine = [f for f in found if f.effect == concealed["effect"]]
    wanted = {tuple(t) for t in concealed["taxels"]}
    if not mine or not wanted:
        return None
    said: set[tuple[int, ...]] = set().union(*(taxels_of(f.where, every) for f in mine))
    return len(said & wanted), len(said - wanted), len(wanted - said)


def _one_value(name: str, values: list[float], finding: Finding) -> float | None:
    """A list brought down to what the truth has one of.

    Strengths add up, times are weighted with them, and a slow shift is where it ends.
    """
    if not values:
        return None
    if len(values) == 1:
        return values[0]
    if name == "a":
        return float(np.sum(values))
    if name == "tau_s":
        weights = finding.parameter("a")[0]
        if len(weights) != len(values) or not np.sum(np.abs(weights)):
            weights = [1.0] * len(values)
        return float(np.exp(np.average(np.log(np.maximum(values, 1e-9)), weights=np.abs(weights))))
    if name == "shift_count":
        return values[-1] - values[0]
    return None


def parameter_errors(found: list[Finding], concealed: dict[str, Any]) -> list[dict[str, Any]]:
    """Relative error, and whether the 90 % interval covers the truth, of every parameter that is scored."""
    mine = next((f for f in found if f.effect == concealed["effect"]), None)
    if mine is None:
        return []
    wanted = dict(concealed["parameters"])
    if concealed.get("amplitude_fraction") is not None and concealed["effect"] in WITH_AMPLITUDE:
        wanted["amplitude_fraction"] = [concealed["amplitude_fraction"]]
    out = []
    for name, (true, *_) in wanted.items():
        value, std = mine.parameter(name)
        estimate = _one_value(name, value, mine)
        row: dict[str, Any] = {"effect": concealed["effect"], "parameter": name, "true": true, "estimate": estimate}
        row["relative_error"] = None if estimate is None else abs(estimate - true) / max(abs(true), 1e-12)
        single = estimate is not None and len(value) == 1 and len(std) == 1
        row["covered"] = abs(estimate - true) <= NORMAL_90 * std[0] if single and estimate is not None else None
        out.append(row)
    return out


def judge(truth: dict[str, Any], diagnosis: dict[str, Any] | None) -> dict[str, Any]:
    """Everything that is scored of one case. No answer is a wrong answer."""
    wanted = {e["effect"] for e in truth["effects"]}
    strengths = [e["k_floor"] for e in truth["effects"] if e["k_floor"] is not None]
    row: dict[str, Any] = {
        "kind": truth["kind"],
        "wanted": sorted(wanted),
        "k": min(strengths, default=None),
        "answered": diagnosis is not None,
        "named": [],
        "confidences": [],
    }
    found = counted(findings(diagnosis), truth) if diagnosis else []
    verdict = diagnosis.get("verdict") if diagnosis else None
    row["named"] = [list(f.words) for f in found]
    row["verdict"] = verdict
    row["first_unknown"] = bool(found) and found[0].effect == "unknown"
    if truth["kind"] == "null":
        row["false_alarm"] = diagnosis is None or bool(found)
    elif truth["kind"] == "undecidable":
        row["points"] = _undecidable(truth, found, verdict)
    elif truth["kind"] == "outside":
        row["points"] = found[0].points({"unknown", *truth["also_right"]}) if found else 0.0
    else:
        row["points"] = found[0].points(wanted) if found else 0.0
        named = {f.effect for f in found if len(set(f.words)) <= LONGEST_LIST}
        also = {a for f in found if len(set(f.words)) <= LONGEST_LIST for a in f.alternatives}
        row["exact"] = named == wanted and len(found) == len(named)
        row["recall"] = sum(1.0 if w in named else 0.5 if w in also else 0.0 for w in wanted) / len(wanted)
        row["places"] = [
            {"effect": e["effect"], "scope": e["where"]["scope"], "counts": c}
            for e in truth["effects"]
            if (c := place_counts(found, e, truth["taxels"])) is not None
        ]
        row["parameters"] = [p for e in truth["effects"] for p in parameter_errors(found, e)]
    acceptable = wanted | set(truth["equivalent"]) | set(truth["also_right"])
    row["confidences"] = [
        (float(f.confidence), bool(acceptable & set(f.words))) for f in found if f.confidence is not None
    ]
    return row


def _undecidable(truth: dict[str, Any], found: list[Finding], verdict: str | None) -> float:
    """Right is "not decidable", or a first finding of exactly two words the data cannot tell apart, the truth one."""
    if verdict == "not decidable":
        return 1.0
    if not found:
        return 0.0
    words = set(found[0].words)
    wanted = {e["effect"] for e in truth["effects"]}
    return 1.0 if len(words) == LONGEST_LIST and words <= set(truth["equivalent"]) and wanted & words else 0.0
