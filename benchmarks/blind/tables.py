"""From judged cases to the tables of the issue, and to markdown."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.blind import bounds
from benchmarks.blind.rules import FULL_STRENGTH

Rows = list[dict[str, Any]]
STRENGTHS = (0.5, 1.0, 3.0, 10.0)  # x the floor


def rate(values: list[float]) -> dict[str, Any]:
    n, right = len(values), float(sum(values))
    low, high = bounds.wilson(right, n)
    return {"n": n, "right": right, "rate": right / n if n else None, "low": low, "high": high}


def strong(row: dict[str, Any]) -> bool:
    return row["k"] is None or row["k"] >= FULL_STRENGTH


def near(row: dict[str, Any], k: float) -> bool:
    return row["k"] is not None and abs(np.log(max(row["k"], 1e-9) / k)) < 0.35


def f1(counts: tuple[int, int, int]) -> float:
    hit, extra, missed = counts
    return 2 * hit / (2 * hit + extra + missed)


def _quantiles(values: list[float]) -> dict[str, Any]:
    if not values:
        return {"n": 0, "median": None}
    return {"n": len(values), "median": float(np.median(values)), "p10": float(np.quantile(values, 0.1))}


def per_effect(rows: Rows, keep: Callable[[dict[str, Any]], bool]) -> dict[str, dict[str, Any]]:
    """First-named rate of cases with one effect, by effect."""
    mine = [r for r in rows if r["kind"] in ("single", "faint", "fault") and keep(r)]
    return {w: rate([r["points"] for r in mine if r["wanted"] == [w]]) for w in sorted({r["wanted"][0] for r in mine})}


def _places(rows: Rows) -> dict[str, Any]:
    counts = [(p["scope"], p["counts"]) for r in rows for p in r.get("places", []) if strong(r)]
    total = np.sum([c for _, c in counts], axis=0) if counts else np.zeros(3)
    by_scope = {s: _quantiles([f1(c) for scope, c in counts if scope == s]) for s in sorted({s for s, _ in counts})}
    mean = float(np.mean([f1(c) for _, c in counts])) if counts else None
    pooled = f1(tuple(total.tolist())) if counts else None
    return {"n": len(counts), "mean": mean, "pooled": pooled, "by_scope": by_scope}


def _parameters(rows: Rows) -> dict[str, Any]:
    found = [p for r in rows if strong(r) for p in r.get("parameters", [])]
    given = [p for p in found if p["relative_error"] is not None]
    covered = [float(p["covered"]) for p in found if p["covered"] is not None]
    names = sorted({(p["effect"], p["parameter"]) for p in given})
    return {
        "median_error": float(np.median([p["relative_error"] for p in given])) if given else None,
        "coverage": rate(covered),
        "not_given": len(found) - len(given),
        "by_parameter": {
            f"{e} {name}": _quantiles(
                [p["relative_error"] for p in given if (p["effect"], p["parameter"]) == (e, name)]
            )
            for e, name in names
        },
    }


def _untouched(rows: Rows) -> dict[str, Any] | None:
    compared = [(r, r["untouched"]) for r in rows if "untouched" in r]
    if not compared:
        return None
    known = ("single", "pair", "triple")
    shares = [u["recovered"] for r, u in compared if r["kind"] in known and strong(r) and "recovered" in u]
    changes = [(u["change"], r["case"]) for r, u in compared if "change" in u]
    return {
        "recovered": _quantiles(shares),
        "made_worse": [{"case": case, "change": change} for change, case in changes if change > 0.02],
        "largest_change": max((c for c, _ in changes), default=None),
        "failures": [{"case": r["case"], "why": u["failure"]} for r, u in compared if u["failure"]],
    }


def runs(rows: Rows) -> dict[str, Any]:
    """What the runs took, and how they ended."""
    ran = [r["run"] for r in rows if r["run"]]
    return {
        "n": len(ran),
        "median_s": float(np.median([r["seconds"] for r in ran])) if ran else None,
        "longest_s": max((r["seconds"] for r in ran), default=None),
        "peak_mb": max((r["peak_mb"] for r in ran), default=None),
        "status": {str(s): sum(r["status"] == s for r in ran) for s in sorted({r["status"] for r in ran})},
    }


def tables(rows: Rows) -> dict[str, Any]:
    """Everything that is reported."""

    def of(*kinds: str) -> Rows:
        return [r for r in rows if r["kind"] in kinds]

    nulls = of("null")
    false_alarms = sum(r["false_alarm"] for r in nulls)
    known = [r for r in of("single", "pair", "triple", "fault") if strong(r)]
    stated = [(p, was) for r in rows for p, was in r["confidences"]]
    out: dict[str, Any] = {
        "answered": rate([float(r["answered"]) for r in rows]),
        "nulls": {
            **rate([float(r["false_alarm"]) for r in nulls]),
            "upper": bounds.clopper_pearson_upper(false_alarms, len(nulls)) if nulls else None,
        },
        "singles": rate([r["points"] for r in of("single", "fault") if strong(r)]),
        "per_effect": per_effect(rows, strong),
        "outside": rate([r["points"] for r in of("outside") if strong(r)]),
        "outside_by_kind": {
            v: rate([r["points"] for r in of("outside") if r["variant"] == v and strong(r)])
            for v in sorted({r["variant"] for r in of("outside")})
        },
        "known_called_unknown": rate([float(r["first_unknown"]) for r in known]),
        "undecidable": rate([r["points"] for r in of("undecidable")]),
        "place": _places(rows),
        "parameters": _parameters(rows),
        "confidence": {
            "n": len(stated),
            "brier": bounds.brier(stated),
            "ece": bounds.expected_calibration_error(stated),
        },
        "faint": {k: per_effect(rows, lambda r, k=k: r["kind"] == "faint" and near(r, k)) for k in (0.5, 1.0)},
        "by_strength": {k: rate([r["points"] for r in of("single", "faint") if near(r, k)]) for k in STRENGTHS},
        "weaker_than_asked": [
            {"case": r["case"], "wanted": r["wanted"], "k": r["k"], "named": r["named"]}
            for r in of("single", "pair", "triple", "outside")
            if not strong(r)
        ],
        "untouched": _untouched(rows),
    }
    for kind in ("pair", "triple"):
        mine = [r for r in of(kind) if strong(r)]
        out[kind] = {"exact": rate([float(r["exact"]) for r in mine]), "recall": rate([r["recall"] for r in mine])}
    return out


def percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.0f} %"


def shown(rate: dict[str, Any]) -> str:
    if not rate["n"]:
        return "no case"
    return f"{percent(rate['rate'])} ({rate['right']:g} of {rate['n']}; {percent(rate['low'])}–{percent(rate['high'])})"


def met(value: float | None, wanted: float, at_most: bool = False) -> str:
    if value is None:
        return "–"
    return "met" if (value <= wanted if at_most else value >= wanted) else "missed"


def targets(t: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """(what, wanted, measured, met or missed), in the issue's order."""
    weakest = min(((r["rate"], w) for w, r in t["per_effect"].items() if r["n"]), default=(None, "–"))
    rows = [
        ("single effects named first", "≥ 95 %", shown(t["singles"]), met(t["singles"]["rate"], 0.95)),
        ("… the weakest effect", "≥ 80 %", f"{percent(weakest[0])} ({weakest[1]})", met(weakest[0], 0.8)),
    ]
    for kind, wanted in (("pair", 0.85), ("triple", 0.75)):
        exact, recall = t[kind]["exact"], t[kind]["recall"]
        rows.append((f"exact set of {kind}s", f"≥ {percent(wanted)}", shown(exact), met(exact["rate"], wanted)))
        rows.append((f"recall in {kind}s", "≥ 95 %", shown(recall), met(recall["rate"], 0.95)))
    nulls, place, parameters = t["nulls"], t["place"], t["parameters"]
    coverage = parameters["coverage"]
    inside = None if not coverage["n"] else float(0.85 <= coverage["rate"] <= 0.95)
    f1 = "–" if place["mean"] is None else f"{place['mean']:.2f} (mean of {place['n']}; pooled {place['pooled']:.2f})"
    upper = "–" if nulls["upper"] is None else f"{shown(nulls)}, upper bound {percent(nulls['upper'])}"
    unknown = t["known_called_unknown"]
    rows += [
        ("false alarms on nulls", "≤ 5 %", upper, met(nulls["rate"], 0.05, at_most=True)),
        ("outside the library called unknown", "≥ 90 %", shown(t["outside"]), met(t["outside"]["rate"], 0.9)),
        ("known effects called unknown", "≤ 5 %", shown(unknown), met(unknown["rate"], 0.05, at_most=True)),
        ("undecidable answered so", "≥ 95 %", shown(t["undecidable"]), met(t["undecidable"]["rate"], 0.95)),
        ("place, F1 per taxel", "≥ 0.9", f1, met(place["mean"], 0.9)),
        (
            "parameters, median error",
            "≤ 10 %",
            f"{percent(parameters['median_error'])}, {parameters['not_given']} not given",
            met(parameters["median_error"], 0.1, at_most=True),
        ),
        ("90 % intervals cover", "85–95 %", shown(coverage), met(inside, 1.0)),
    ]
    if t["untouched"]:
        recovered, worse = t["untouched"]["recovered"], t["untouched"]["made_worse"]
        median = "–" if recovered["median"] is None else f"{recovered['median']:.2f} of {recovered['n']}"
        failed = f"{len(worse)} cases, largest change {percent(t['untouched']['largest_change'])}"
        if t["untouched"]["failures"]:
            failed += f", {len(t['untouched']['failures'])} without a prediction"
        rows.append(("recovered share of the oracle's gain, median", "≥ 0.9", median, met(recovered["median"], 0.9)))
        rows.append(("made worse by more than 2 %", "none", failed, met(float(len(worse)), 0.0, at_most=True)))
    return rows


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(r) + " |" for r in rows]) + "\n"


def runs_markdown(r: dict[str, Any]) -> str:
    if not r["n"]:
        return "No run is in the log.\n"
    ended = ", ".join(f"{status}: {n}" for status, n in r["status"].items())
    return (
        f"Runs: {r['n']}, median {r['median_s']:.1f} s, longest {r['longest_s']:.1f} s, peak {r['peak_mb']:.0f} MB; "
        f"exit status {ended}.\n"
    )


def markdown(t: dict[str, Any]) -> str:
    """The tables of the chamber."""
    out = [
        f"Chamber, {t['answered']['n']} cases, {t['answered']['right']:g} answered.\n",
        table(("what", "wanted", "measured", ""), targets(t)),
        "Single effects at 3 × the floor or more, named first:\n",
        table(("effect", "right"), [(w, shown(r)) for w, r in t["per_effect"].items()]),
        "Outside the library:\n",
        table(("kind", "called unknown"), [(w, shown(r)) for w, r in t["outside_by_kind"].items()]),
    ]
    out.append("Named first, by strength:\n")
    out.append(table(("× the floor", "right"), [(str(k), shown(r)) for k, r in t["by_strength"].items()]))
    for k, curve in t["faint"].items():
        out.append(f"At {k} × the floor, as it is:\n")
        out.append(table(("effect", "named first"), [(w, shown(r)) for w, r in curve.items()]))
    errors = [(n, f"{100 * q['median']:.1f} %", str(q["n"])) for n, q in t["parameters"]["by_parameter"].items()]
    out += ["Parameters:\n", table(("parameter", "median error", "n"), errors)]
    confidence = t["confidence"]
    if confidence["n"]:
        out.append(f"Confidence: Brier {confidence['brier']:.3f}, ECE {confidence['ece']:.3f}, n {confidence['n']}.\n")
    if t["weaker_than_asked"]:
        out.append(
            f"{len(t['weaker_than_asked'])} cases could not be made as strong as asked; no rate above has them.\n"
        )
    return "\n".join(out)
