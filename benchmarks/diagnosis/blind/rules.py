"""Scores the answer to one case by the rules of formats.md."""

from dataclasses import dataclass
from typing import Any

import numpy as np

LONGEST_LIST = 2  # effect and alternatives together; a longer list counts as wrong
WITH_AMPLITUDE = ("hysteresis", "creep", "viscoelasticity")
NORMAL_90 = 1.645
FULL_STRENGTH = 2.8  # x the floor: "3 x", with the tolerance of the solver
ALARMS = ("explained", "partly explained", "unexplained")
MAP_MM, MAP_DEG = 1.0, 0.2


@dataclass(frozen=True)
class Finding:
    """One finding of a file `insole-diagnosis/1`."""

    effect: str
    alternatives: tuple[str, ...]
    where: dict[str, Any]
    parameters: dict[str, Any]  # as they were stated
    confidence: float | None

    def parameter(self, name: str) -> tuple[list[float], list[float]]:
        """Values and standard deviations that were stated for a parameter, each a list that may be empty."""
        stated = self.parameters.get(name)
        stated = stated if isinstance(stated, dict) else {"value": stated}
        value_and_std = ([] if stated.get(key) is None else stated[key] for key in ("value", "std"))
        value, std = (np.atleast_1d(np.asarray(numbers, float)).tolist() for numbers in value_and_std)
        return value, std

    @property
    def words(self) -> tuple[str, ...]:
        """The effect and its alternatives."""
        return (self.effect, *self.alternatives)

    def points(self, wanted: set[str]) -> float:
        """1 if the effect is one of `wanted`, 0.5 if an alternative is, else 0; 0 if the list is too long."""
        if len(set(self.words)) > LONGEST_LIST:
            return 0.0
        return 1.0 if self.effect in wanted else 0.5 if wanted & set(self.alternatives) else 0.0


def read_findings(diagnosis: dict[str, Any]) -> list[Finding]:
    """The findings of a file `insole-diagnosis/1`, in their order."""
    findings = []
    for stated in diagnosis.get("findings", []):
        parameters = dict(stated.get("parameters", {}))
        if "amplitude_fraction" in stated:
            parameters["amplitude_fraction"] = stated["amplitude_fraction"]
        alternatives = tuple(
            alternative for alternative in stated.get("alternatives", []) if alternative != stated["effect"]
        )
        findings.append(
            Finding(stated["effect"], alternatives, stated.get("where") or {}, parameters, stated.get("confidence"))
        )
    return findings


def taxels_of(where: dict[str, Any], insole_ids: list[list[int]]) -> set[tuple[int, ...]]:
    """Taxels of a `where`: those whose identifier begins with one of its ids; without ids, all of `insole_ids`."""
    ids = [tuple(prefix) for prefix in where.get("ids", [])]
    all_taxels = [tuple(taxel) for taxel in insole_ids]
    if where.get("scope", "insole") == "insole" or not ids:
        return set(all_taxels)
    return {taxel for taxel in all_taxels if any(taxel[: len(prefix)] == prefix for prefix in ids)}


def place_f1(findings: list[Finding], effect: dict[str, Any], insole_ids: list[list[int]], depth: int) -> float | None:
    """F1 of the place of all findings with an accepted name, per taxel (depth 3) or (board, triangle) (depth 2).

    None where a place has no meaning, or the effect was not named.
    """
    accepted = [finding for finding in findings if finding.effect in effect["accept"]]
    wanted = {tuple(taxel)[:depth] for taxel in effect["taxels"]}
    if not accepted or not wanted:
        return None
    stated = {taxel[:depth] for finding in accepted for taxel in taxels_of(finding.where, insole_ids)}
    return 2 * len(stated & wanted) / (len(stated) + len(wanted))


def _one_value(name: str, values: list[float], finding: Finding) -> float | None:
    """One value for a list of stated values, or None.

    Strengths add up, times are averaged with the strengths as weights, and a slow shift is the last minus the first.
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


def _scale(name: str, true: float, parameters: dict[str, list[float]]) -> float:
    """The true size that an error is divided by: of a gain, its distance from 1; of a shift of the map, its length."""
    if name == "gain":
        return abs(true - 1)
    if name in ("x_mm", "y_mm"):
        return float(np.hypot(parameters["x_mm"][0], parameters["y_mm"][0]))
    return abs(true)


def parameter_errors(findings: list[Finding], effect: dict[str, Any]) -> list[dict[str, Any]]:
    """For every scored parameter: relative error, and whether the 90 % interval covers the true value."""
    finding = next((candidate for candidate in findings if candidate.effect == effect["effect"]), None)
    if finding is None:
        return []
    wanted = dict(effect["parameters"])
    if effect.get("amplitude_fraction") is not None and effect["effect"] in WITH_AMPLITUDE:
        wanted["amplitude_fraction"] = [effect["amplitude_fraction"]]
    rows = []
    for name, (true, *_) in wanted.items():
        value, std = finding.parameter(name)
        estimate = _one_value(name, value, finding)
        row: dict[str, Any] = {"effect": effect["effect"], "parameter": name, "true": true, "estimate": estimate}
        scale = max(_scale(name, true, effect["parameters"]), 1e-12)
        row["relative_error"] = None if estimate is None else abs(estimate - true) / scale
        is_single = estimate is not None and len(value) == 1 and len(std) == 1
        row["covered"] = abs(estimate - true) <= NORMAL_90 * std[0] if is_single and estimate is not None else None
        rows.append(row)
    return rows


def without_tolerated(findings: list[Finding], truth: dict[str, Any]) -> list[Finding]:
    """The findings without those that are neither right nor wrong on this recording."""
    concealed = {word for effect in truth["effects"] for word in effect["accept"]}
    return [
        finding for finding in findings if finding.effect not in truth["tolerated"] or concealed & set(finding.words)
    ]


def _score_known(findings: list[Finding], truth: dict[str, Any]) -> dict[str, Any]:
    """Points, exact set, recall, places and parameters of a case with known effects."""
    accepted_by_effect = [set(effect["accept"]) for effect in truth["effects"]]
    accepted_words: set[str] = set().union(*accepted_by_effect)
    short_findings = [finding for finding in findings if len(set(finding.words)) <= LONGEST_LIST]
    named = {finding.effect for finding in short_findings}
    alternatives = {a for finding in short_findings for a in finding.alternatives}
    depth = 3 if truth["recording"] == "chamber" else 2
    places = [place_f1(findings, effect, truth["taxels"], depth) for effect in truth["effects"]]
    return {
        "points": findings[0].points(accepted_words) if findings else 0.0,
        "exact": bool(findings)
        and len(short_findings) == len(findings)
        and all(finding.effect in accepted_words for finding in findings)
        and all(named & a for a in accepted_by_effect),
        "recall": sum(1.0 if named & a else 0.5 if alternatives & a else 0.0 for a in accepted_by_effect)
        / len(accepted_by_effect),
        "mentioned": any(accepted_words & set(finding.words) for finding in findings),
        "wrong_name": any(
            not accepted_words & set(finding.words) and finding.effect != "unknown" for finding in findings
        ),
        "places": [p for p in places if p is not None],
        "parameters": [p for effect in truth["effects"] for p in parameter_errors(findings, effect)],
        "map_right": _is_map_right(findings, truth["effects"][0]) if len(truth["effects"]) == 1 else None,
    }


def _is_map_right(findings: list[Finding], effect: dict[str, Any]) -> bool | None:
    """Whether exactly the swapped triangles were named, or the map is right within 0.2 deg and 1 mm; else None."""
    word = effect["effect"]
    if word not in ("swapped_triangles", "map_transform"):
        return None
    of_word = [finding for finding in findings if finding.effect == word]
    if len(of_word) != 1:
        return False
    if word == "swapped_triangles":
        return {tuple(triangle) for triangle in of_word[0].where.get("ids", [])} == {
            tuple(triangle) for triangle in effect["where"]["ids"]
        }
    for name, tolerance in (("x_mm", MAP_MM), ("y_mm", MAP_MM), ("rotation_deg", MAP_DEG)):
        value = of_word[0].parameter(name)[0]
        if len(value) != 1 or abs(value[0] - effect["parameters"][name][0]) > tolerance:
            return False
    return True


def judge(truth: dict[str, Any], diagnosis: dict[str, Any] | None) -> dict[str, Any]:
    """Score one case. `diagnosis` is None if there is no answer, which counts as wrong."""
    strengths = [effect["k_floor"] for effect in truth["effects"] if effect["k_floor"] is not None]
    findings = read_findings(diagnosis) if diagnosis else []
    scored = without_tolerated(findings, truth)
    verdict = diagnosis.get("verdict") if diagnosis else None
    heldout = (diagnosis or {}).get("heldout") or {}
    row: dict[str, Any] = {
        "kind": truth["kind"],
        "recording": truth["recording"],
        "against": truth["against"],
        "wanted": sorted(effect["effect"] for effect in truth["effects"]),
        "law": "+".join(effect["law"] for effect in truth["effects"]),
        "scope": "+".join(effect["where"]["scope"] for effect in truth["effects"]),
        "k": min(strengths, default=None),
        "period_ms": truth["period_ms"],
        "answered": diagnosis is not None,
        "named": [list(finding.words) for finding in scored],
        "verdict": verdict,
        "before": heldout.get("before"),
        "after": heldout.get("after"),
        "floor": heldout.get("floor"),
        "first_unknown": bool(scored) and scored[0].effect == "unknown",
    }
    if truth["kind"] == "null":
        row["false_alarm"] = diagnosis is None or bool(scored) or (not findings and verdict in ALARMS)
    elif truth["kind"] == "undecidable":
        row["points"] = _score_undecidable(truth, scored, verdict)
    elif truth["kind"] == "unknown":
        accepted_words = {word for effect in truth["effects"] for word in effect["accept"]}
        row["points"] = scored[0].points(accepted_words) if scored else 0.0
        row["right_board"] = _is_right_board(scored, truth) if truth["local"] else None
    else:
        row |= _score_known(scored, truth)
    acceptable = {word for effect in truth["effects"] for word in effect["accept"]} | set(truth["equivalent"])
    row["confidences"] = [
        (float(finding.confidence), bool(acceptable & set(finding.words)))
        for finding in scored
        if finding.confidence is not None
    ]
    return row


def _is_right_board(findings: list[Finding], truth: dict[str, Any]) -> bool:
    """Whether the first finding is on the board of the effect and on no other."""
    if not findings:
        return False
    boards = {taxel[0] for taxel in taxels_of(findings[0].where, truth["taxels"])}
    return boards == {taxel[0] for taxel in truth["effects"][0]["taxels"]}


def _score_undecidable(truth: dict[str, Any], findings: list[Finding], verdict: str | None) -> float:
    """1 for "not decidable", or for a first finding of exactly two equivalent words of which one is true; else 0."""
    if verdict == "not decidable":
        return 1.0
    if not findings:
        return 0.0
    words = set(findings[0].words)
    wanted = {effect["effect"] for effect in truth["effects"]}
    return 1.0 if len(words) == LONGEST_LIST and words <= set(truth["equivalent"]) and wanted & words else 0.0
