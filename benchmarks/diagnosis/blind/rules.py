"""What counts as right, case by case, as formats.md says it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

LONGEST_LIST = 2  # effect and alternatives together; a longer list is a miss
WITH_AMPLITUDE = ("hysteresis", "creep", "viscoelasticity")
NORMAL_90 = 1.645
FULL_STRENGTH = 2.8  # x the floor: "3 x", with the tolerance of the solver
ALARMS = ("explained", "partly explained", "unexplained")
MAP_MM, MAP_DEG = 1.0, 0.2


@dataclass(frozen=True)
class Finding:
    """A finding of an `insole-diagnosis/1`."""

    effect: str
    alternatives: tuple[str, ...]
    where: dict[str, Any]
    parameters: dict[str, Any]  # as they were stated
    confidence: float | None

    def parameter(self, name: str) -> tuple[list[float], list[float]]:
        """Value and standard deviation, each a list; empty where nothing was stated."""
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


def taxels_of(where: dict[str, Any], every: list[list[int]]) -> set[tuple[int, ...]]:
    """The taxels a `where` speaks of: all of them, or those its ids are the beginning of."""
    ids = [tuple(i) for i in where.get("ids", [])]
    all_taxels = [tuple(t) for t in every]
    if where.get("scope", "insole") == "insole" or not ids:
        return set(all_taxels)
    return {t for t in all_taxels if any(t[: len(i)] == i for i in ids)}


def place_f1(found: list[Finding], effect: dict[str, Any], every: list[list[int]], depth: int) -> float | None:
    """F1 of the place of all findings with an accepted name, per taxel (depth 3) or (board, triangle) (depth 2).

    None where a place has no meaning, or the effect was not named.
    """
    mine = [f for f in found if f.effect in effect["accept"]]
    wanted = {tuple(t)[:depth] for t in effect["taxels"]}
    if not mine or not wanted:
        return None
    said = {t[:depth] for f in mine for t in taxels_of(f.where, every)}
    return 2 * len(said & wanted) / (len(said) + len(wanted))


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


def _scale(name: str, true: float, parameters: dict[str, list[float]]) -> float:
    """What an error is relative to: a gain to what it is more than 1, a shift of the map to its length."""
    if name == "gain":
        return abs(true - 1)
    if name in ("x_mm", "y_mm"):
        return float(np.hypot(parameters["x_mm"][0], parameters["y_mm"][0]))
    return abs(true)


def parameter_errors(found: list[Finding], effect: dict[str, Any]) -> list[dict[str, Any]]:
    """Relative error, and whether the 90 % interval covers the truth, of every parameter that is scored."""
    mine = next((f for f in found if f.effect == effect["effect"]), None)
    if mine is None:
        return []
    wanted = dict(effect["parameters"])
    if effect.get("amplitude_fraction") is not None and effect["effect"] in WITH_AMPLITUDE:
        wanted["amplitude_fraction"] = [effect["amplitude_fraction"]]
    out = []
    for name, (true, *_) in wanted.items():
        value, std = mine.parameter(name)
        estimate = _one_value(name, value, mine)
        row: dict[str, Any] = {"effect": effect["effect"], "parameter": name, "true": true, "estimate": estimate}
        scale = max(_scale(name, true, effect["parameters"]), 1e-12)
        row["relative_error"] = None if estimate is None else abs(estimate - true) / scale
        single = estimate is not None and len(value) == 1 and len(std) == 1
        row["covered"] = abs(estimate - true) <= NORMAL_90 * std[0] if single and estimate is not None else None
        out.append(row)
    return out


def counted(found: list[Finding], truth: dict[str, Any]) -> list[Finding]:
    """Without the words that are neither right nor wrong on this recording."""
    concealed = {w for e in truth["effects"] for w in e["accept"]}
    return [f for f in found if f.effect not in truth["tolerated"] or concealed & set(f.words)]


def _named(found: list[Finding], truth: dict[str, Any]) -> dict[str, Any]:
    """Points, exact set, recall, places and parameters where known effects are concealed."""
    accepted = [set(e["accept"]) for e in truth["effects"]]
    anything: set[str] = set().union(*accepted)
    short = [f for f in found if len(set(f.words)) <= LONGEST_LIST]
    named = {f.effect for f in short}
    also = {a for f in short for a in f.alternatives}
    depth = 3 if truth["recording"] == "chamber" else 2
    places = [place_f1(found, e, truth["taxels"], depth) for e in truth["effects"]]
    return {
        "points": found[0].points(anything) if found else 0.0,
        "exact": bool(found)
        and len(short) == len(found)
        and all(f.effect in anything for f in found)
        and all(named & a for a in accepted),
        "recall": sum(1.0 if named & a else 0.5 if also & a else 0.0 for a in accepted) / len(accepted),
        "mentioned": any(anything & set(f.words) for f in found),
        "wrong_name": any(not anything & set(f.words) and f.effect != "unknown" for f in found),
        "places": [p for p in places if p is not None],
        "parameters": [p for e in truth["effects"] for p in parameter_errors(found, e)],
        "map_right": _map_right(found, truth["effects"][0]) if len(truth["effects"]) == 1 else None,
    }


def _map_right(found: list[Finding], effect: dict[str, Any]) -> bool | None:
    """Swapped triangles: both and no other; a map: within 0.2 deg and 1 mm. None for other words."""
    word = effect["effect"]
    if word not in ("swapped_triangles", "map_transform"):
        return None
    mine = [f for f in found if f.effect == word]
    if len(mine) != 1:
        return False
    if word == "swapped_triangles":
        return {tuple(i) for i in mine[0].where.get("ids", [])} == {tuple(i) for i in effect["where"]["ids"]}
    for name, most in (("x_mm", MAP_MM), ("y_mm", MAP_MM), ("rotation_deg", MAP_DEG)):
        value = mine[0].parameter(name)[0]
        if len(value) != 1 or abs(value[0] - effect["parameters"][name][0]) > most:
            return False
    return True


def judge(truth: dict[str, Any], diagnosis: dict[str, Any] | None) -> dict[str, Any]:
    """Everything that is scored of one case. No answer is a wrong answer."""
    strengths = [e["k_floor"] for e in truth["effects"] if e["k_floor"] is not None]
    stated = findings(diagnosis) if diagnosis else []
    found = counted(stated, truth)
    verdict = diagnosis.get("verdict") if diagnosis else None
    heldout = (diagnosis or {}).get("heldout") or {}
    row: dict[str, Any] = {
        "kind": truth["kind"],
        "recording": truth["recording"],
        "against": truth["against"],
        "wanted": sorted(e["effect"] for e in truth["effects"]),
        "law": "+".join(e["law"] for e in truth["effects"]),
        "scope": "+".join(e["where"]["scope"] for e in truth["effects"]),
        "k": min(strengths, default=None),
        "period_ms": truth["period_ms"],
        "answered": diagnosis is not None,
        "named": [list(f.words) for f in found],
        "verdict": verdict,
        "before": heldout.get("before"),
        "after": heldout.get("after"),
        "floor": heldout.get("floor"),
        "first_unknown": bool(found) and found[0].effect == "unknown",
    }
    if truth["kind"] == "null":
        row["false_alarm"] = diagnosis is None or bool(found) or (not stated and verdict in ALARMS)
    elif truth["kind"] == "undecidable":
        row["points"] = _undecidable(truth, found, verdict)
    elif truth["kind"] == "unknown":
        wanted = {w for e in truth["effects"] for w in e["accept"]}
        row["points"] = found[0].points(wanted) if found else 0.0
        row["right_board"] = _right_board(found, truth) if truth["local"] else None
    else:
        row |= _named(found, truth)
    acceptable = {w for e in truth["effects"] for w in e["accept"]} | set(truth["equivalent"])
    row["confidences"] = [
        (float(f.confidence), bool(acceptable & set(f.words))) for f in found if f.confidence is not None
    ]
    return row


def _right_board(found: list[Finding], truth: dict[str, Any]) -> bool:
    """The first finding is on the board of the effect and on no other."""
    if not found:
        return False
    boards = {t[0] for t in taxels_of(found[0].where, truth["taxels"])}
    return boards == {t[0] for t in truth["effects"][0]["taxels"]}


def _undecidable(truth: dict[str, Any], found: list[Finding], verdict: str | None) -> float:
    """Right is "not decidable", or a first finding of exactly two words the data cannot tell apart, the truth one."""
    if verdict == "not decidable":
        return 1.0
    if not found:
        return 0.0
    words = set(found[0].words)
    wanted = {e["effect"] for e in truth["effects"]}
    return 1.0 if len(words) == LONGEST_LIST and words <= set(truth["equivalent"]) and wanted & words else 0.0
