"""The tables of the walking suite."""

from typing import Any

import numpy as np

from benchmarks.blind import bounds
from benchmarks.blind.tables import Rows, f1, met, per_effect, percent, rate, shown, strong, table

_PATCH_F1 = 0.8  # the answer is that patch, give or take a triangle
_TOLERANCE = {"x_mm": 1.0, "y_mm": 1.0, "rotation_deg": 0.2}


def _patch(row: dict[str, Any]) -> float:
    return max((float(f1(p["counts"]) >= _PATCH_F1) for p in row["places"]), default=0.0)


def _map_right(row: dict[str, Any]) -> float:
    """Whether shift and rotation are within the tolerance."""
    said = {p["parameter"]: p for p in row["parameters"] if p["estimate"] is not None}
    return float(all(n in said and abs(said[n]["estimate"] - said[n]["true"]) <= e for n, e in _TOLERANCE.items()))


def _swap_right(row: dict[str, Any]) -> float:
    """Whether exactly the two triangles are named."""
    return max((float(f1(p["counts"]) == 1.0) for p in row["places"]), default=0.0)


def _force(rows: Rows, kind: str) -> dict[str, Any]:
    mine = [r["force"] for r in rows if r["kind"] == kind and "force" in r]
    done = [f for f in mine if "change" in f]
    return {
        "n": len(mine),
        "failures": len(mine) - len(done),
        "static_n": float(np.median([f["static"] for f in done])) if done else None,
        "model_n": float(np.median([f["model"] for f in done])) if done else None,
        "oracle_n": float(np.median([f["oracle"] for f in done])) if done else None,
        "median_change": float(np.median([f["change"] for f in done])) if done else None,
        "largest_change": max((f["change"] for f in done), default=None),
        "largest_over_handed_in": max((f["over_handed_in"] for f in done), default=None),
        "median_over_oracle": float(np.median([f["over_oracle"] for f in done])) if done else None,
    }


def tables(rows: Rows) -> dict[str, Any]:
    """Everything that is reported of walks."""
    of = {kind: [r for r in rows if r["kind"] == kind] for kind in ("null", "single", "together", "patch", "mapping")}
    patches = sorted({r["variant"] for r in of["patch"]})
    false_alarms = sum(r["false_alarm"] for r in of["null"])
    swapped = [r for r in of["mapping"] if r["wanted"] == ["swapped_triangles"]]
    moved = [r for r in of["mapping"] if r["wanted"] == ["map_transform"]]
    return {
        "answered": rate([float(r["answered"]) for r in rows]),
        "nulls": {
            **rate([float(r["false_alarm"]) for r in of["null"]]),
            "upper": bounds.clopper_pearson_upper(false_alarms, len(of["null"])) if of["null"] else None,
        },
        "singles": rate([r["points"] for r in of["single"] if strong(r)]),
        "per_effect": per_effect(rows, strong),
        "together": rate([float(r["exact"]) for r in of["together"]]),
        "together_recall": rate([r["recall"] for r in of["together"]]),
        "patch": rate([_patch(r) for r in of["patch"] if strong(r)]),
        "patch_by": {v: rate([_patch(r) for r in of["patch"] if r["variant"] == v and strong(r)]) for v in patches},
        "swapped": rate([min(r["points"], _swap_right(r)) for r in swapped]),
        "map_transform": rate([min(r["points"], _map_right(r)) for r in moved]),
        "force_together": _force(rows, "together"),
        "force_null": _force(rows, "null"),
    }


def targets(t: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """(what, wanted, measured, met or missed), in the issue's order."""
    nulls = t["nulls"]
    upper = "–" if nulls["upper"] is None else f"{shown(nulls)}, upper bound {percent(nulls['upper'])}"
    weakest = min((r["rate"] for r in t["patch_by"].values() if r["n"]), default=None)
    rows = [
        ("four together, named set right", "≥ 75 %", shown(t["together"]), met(t["together"]["rate"], 0.75)),
        ("single effects named first", "≥ 90 %", shown(t["singles"]), met(t["singles"]["rate"], 0.9)),
        ("false alarms on nulls", "≤ 5 %", upper, met(nulls["rate"], 0.05, at_most=True)),
        ("patch right", "≥ 80 %", shown(t["patch"]), met(t["patch"]["rate"], 0.8)),
        ("… the weakest patch", "≥ 60 %", percent(weakest), met(weakest, 0.6)),
        ("swapped triangles found", "≥ 95 %", shown(t["swapped"]), met(t["swapped"]["rate"], 0.95)),
        ("map within 0.2° and 1 mm", "≥ 95 %", shown(t["map_transform"]), met(t["map_transform"]["rate"], 0.95)),
    ]
    force, null = t["force_together"], t["force_null"]
    if force["median_change"] is not None:
        errors = f"{force['static_n']:.1f} → {force['model_n']:.1f} N, oracle {force['oracle_n']:.1f} N"
        change = f"{percent(force['median_change'])} ({errors}; median of {force['n']})"
        over = force["median_over_oracle"]
        rows.append(("f_z RMSE on untouched walks", "≤ −80 %", change, met(force["median_change"], -0.8, at_most=True)))
        rows.append(("… against the oracle", "≤ 1.3 ×", f"{over:.2f} ×", met(over, 1.3, at_most=True)))
    if null["largest_change"] is not None:
        for than, change in (
            ("as handed in", null["largest_over_handed_in"] - 1),
            ("recalibrated on the true force", null["largest_change"]),
        ):
            what = f"f_z on nulls worse than the static model {than}"
            rows.append((what, "≤ 2 %", percent(change), met(change, 0.02, at_most=True)))
    return rows


def markdown(t: dict[str, Any]) -> str:
    """The tables of the walks."""
    return "\n".join(
        [
            f"Walking, {t['answered']['n']} cases, {t['answered']['right']:g} answered.\n",
            table(("what", "wanted", "measured", ""), targets(t)),
            "Single effects in walking, named first:\n",
            table(("effect", "right"), [(w, shown(r)) for w, r in t["per_effect"].items()]),
            "Patches:\n",
            table(("patch", "right"), [(w, shown(r)) for w, r in t["patch_by"].items()]),
        ]
    )
