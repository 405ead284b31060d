"""From judged cases to the table of bars, and to markdown."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from . import bounds
from .rules import FULL_STRENGTH

Rows = list[dict[str, Any]]
KNOWN = ("single", "local", "pair", "triple", "simulation")
STRENGTHS = (0.5, 1.0, 3.0, 10.0)  # x the floor
GAIN_WORTH_SHARING = 1.1  # static error over the oracle's: below it there is nothing to recover
WORSE = 0.02
NULL_QUANTILE = 0.95


def rate(values: list[float]) -> dict[str, Any]:
    """Share of right ones with Wilson's interval."""
    n, right = len(values), float(sum(values))
    low, high = bounds.wilson(right, n)
    return {"n": n, "right": right, "rate": right / n if n else None, "low": low, "high": high}


def strong(row: dict[str, Any]) -> bool:
    """At 3 x the floor or more; a fault has no strength."""
    return row["k"] is None or row["k"] >= FULL_STRENGTH


def near(row: dict[str, Any], k: float) -> bool:
    """Within a third of k x the floor."""
    return row["k"] is not None and abs(np.log(max(row["k"], 1e-9) / k)) < 0.35


def percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.0f} %"


def shown(found: dict[str, Any]) -> str:
    if not found["n"]:
        return "no case"
    low, high = percent(found["low"]), percent(found["high"])
    return f"{percent(found['rate'])} ({found['right']:g} of {found['n']}; {low}–{high})"


def _quantity(values: list[float], of: Callable[[Any], Any] = np.median) -> dict[str, Any]:
    """A statistic with its 95 % bootstrap interval."""
    if not values:
        return {"n": 0, "value": None, "low": None, "high": None}
    rng = np.random.default_rng(0)
    drawn = [of(rng.choice(values, len(values))) for _ in range(300)]
    low, high = (float(q) for q in np.quantile(drawn, (0.025, 0.975)))
    return {"n": len(values), "value": float(of(values)), "low": low, "high": high}


class Bar:
    """One row of the table: what, the bar, what was measured, and whether it is reached."""

    def __init__(self, what: str, bar: str, measured: str, reached: bool | None):
        self.what, self.bar, self.measured, self.reached = what, bar, measured, reached

    def cells(self) -> tuple[str, str, str, str]:
        return self.what, self.bar, self.measured, {True: "reached", False: "missed", None: "–"}[self.reached]


def _share(what: str, values: list[float], least: float | None = None, most: float | None = None) -> Bar:
    found = rate(values)
    value = found["rate"]
    if least is not None:
        return Bar(what, f"≥ {percent(least)}", shown(found), None if value is None else value >= least)
    assert most is not None
    return Bar(what, f"≤ {percent(most)}", shown(found), None if value is None else value <= most)


def _number(what: str, bar: str, found: dict[str, Any], reached: Callable[[float], bool], unit: str = "") -> Bar:
    if found["value"] is None:
        return Bar(what, bar, "no case", None)
    scale = 100 if unit == " %" else 1
    value, low, high = (scale * found[key] for key in ("value", "low", "high"))
    digits = 0 if unit == " %" else 1 if unit else 2
    text = f"{value:.{digits}f}{unit} (n {found['n']}; {low:.{digits}f}–{high:.{digits}f}{unit})"
    return Bar(what, bar, text, reached(found["value"]))


def _beyond_nulls(rows: Rows, faint: Rows) -> list[float]:
    """Of faint cases called `no mismatch`: 1 where before/floor lies beyond that of the nulls."""

    def ratio(row: dict[str, Any]) -> float | None:
        good = row["before"] is not None and row["floor"]
        return float(row["before"]) / float(row["floor"]) if good else None

    out = []
    for row in faint:
        nulls = [
            x
            for r in rows
            if r["kind"] == "null" and r["recording"] == row["recording"] and (x := ratio(r)) is not None
        ]
        mine = ratio(row)
        if row["verdict"] == "no mismatch" and nulls and mine is not None:
            out.append(float(mine > np.quantile(nulls, NULL_QUANTILE)))
    return out


def _recovered(rows: Rows) -> list[float]:
    found = [r["untouched"] for r in rows if r["kind"] in KNOWN and strong(r) and r.get("untouched")]
    return [u["recovered"] for u in found if u.get("recovered") is not None]


def bars(rows: Rows) -> list[Bar]:
    """The rows of the issue's table, in its order."""

    def of(*kinds: str) -> Rows:
        return [r for r in rows if r["kind"] in kinds]

    alone = [r for r in of("single", "local") if strong(r)]
    out = [
        _share("single ≥ 3 × floor and faults: named first", [r["points"] for r in alone], 0.95),
        _share("… exact set", [float(r["exact"]) for r in alone], 0.90),
    ]
    for recording in ("chamber", "walk"):
        mine = [r for r in alone if r["recording"] == recording]
        out.append(_share(f"… {recording}: named first", [r["points"] for r in mine], 0.90))
        out.append(_share(f"… {recording}: exact set", [float(r["exact"]) for r in mine], 0.85))
    faint = [r for r in of("faint", "single", "local") if near(r, 1.0)]
    said = [float(r["mentioned"] or r["verdict"] in ("unexplained", "partly explained")) for r in faint]
    out.append(Bar("1 × floor: named, in alternatives, or `unexplained`", "–", shown(rate(said)), None))
    out.append(_share("… `no mismatch` beyond the nulls", _beyond_nulls(rows, faint), most=0.0))
    out.append(_share("… wrong name", [float(r["wrong_name"]) for r in faint], most=0.05))
    for kind, bar in (("pair", 0.80), ("triple", 0.65)):
        out.append(_share(f"{kind}s: exact", [float(r["exact"]) for r in of(kind) if strong(r)], bar))
    paired = [r for r in of("simulation") if strong(r)]
    out.append(_share("paired simulation: named first", [r["points"] for r in paired], 0.90))
    maps = [float(r["map_right"]) for r in paired if r["map_right"] is not None]
    out.append(_share("… swap or map right", maps, 0.95))
    out.append(_share("nulls, false alarms", [float(r["false_alarm"]) for r in of("null")], most=0.02))
    outside = [r for r in of("unknown") if strong(r)]
    out.append(_share("outside the library: `unknown` first", [r["points"] for r in outside], 0.90))
    boards = [float(r["right_board"]) for r in outside if r["right_board"] is not None]
    out.append(_share("… right board", boards, 0.80))
    known = [r for r in of(*KNOWN) if strong(r)]
    out.append(_share("known called `unknown`", [float(r["first_unknown"]) for r in known], most=0.05))
    for recording, how, bar in (("chamber", "per taxel", 0.95), ("walk", "per (board, triangle)", 0.85)):
        f1 = [p for r in known if r["recording"] == recording for p in r["places"]]
        out.append(
            _number(f"place, F1 {how}, {recording}", f"≥ {bar}", _quantity(f1, np.mean), lambda x, b=bar: x >= b)
        )
    parameters = [p for r in known for p in r["parameters"]]
    errors = [p["relative_error"] for p in parameters if p["relative_error"] is not None]
    out.append(_number("parameters: median error", "≤ 10 %", _quantity(errors), lambda x: x <= 0.1, " %"))
    covered = rate([float(p["covered"]) for p in parameters if p["covered"] is not None])
    inside = None if covered["rate"] is None else 0.85 <= covered["rate"] <= 0.95
    out.append(Bar("… 90 % intervals cover", "85–95 %", shown(covered), inside))
    out.append(
        _number(
            "recovered share of the oracle's gain, median", "≥ 0.95", _quantity(_recovered(rows)), lambda x: x >= 0.95
        )
    )
    compared = [r["untouched"] for r in rows if r.get("untouched") and r["untouched"].get("change") is not None]
    out.append(_share("untouched data made worse by > 2 %", [float(u["change"] > WORSE) for u in compared], most=0.0))
    out += _confidence(rows) + _runs(rows)
    return out


def _confidence(rows: Rows) -> list[Bar]:
    stated = [(p, was) for r in rows for p, was in r["confidences"]]
    mine, base = bounds.log_score(stated), bounds.base_log_score(stated)
    if mine is None or base is None:
        return [Bar(what, bar, "no case", None) for what, bar in _CONFIDENCE]
    steep, interval = bounds.slope(stated), bounds.resampled(stated, bounds.slope)
    text = (
        "–"
        if steep is None or interval is None
        else f"{steep:.2f} (n {len(stated)}; {interval[0]:.2f}–{interval[1]:.2f})"
    )
    gain = bounds.resampled(stated, lambda s: (bounds.log_score(s) or 0) - (bounds.base_log_score(s) or 0))
    assert gain is not None or len(stated) < 3
    more = "" if gain is None else f"; difference {gain[0]:+.3f} to {gain[1]:+.3f}"
    return [
        Bar(*_CONFIDENCE[0], f"{mine:.3f} against {base:.3f} (n {len(stated)}{more})", mine > base),
        Bar(*_CONFIDENCE[1], text, None if steep is None else 0.8 <= steep <= 1.2),
    ]


_CONFIDENCE = (
    ("confidence: log score against the base rate", "better"),
    ("… slope of the reliability curve", "0.8–1.2"),
)


def _runs(rows: Rows) -> list[Bar]:
    ran = [r["run"] for r in rows if r["run"]]
    broken = [float(r["traceback"] or r["status"] < 0 or r["ended"] != "by itself") for r in ran]
    seconds, memory = [r["seconds"] for r in ran], [r["peak_mb"] for r in ran]
    return [
        _share("tracebacks, crashes and time-outs", broken, most=0.0),
        _number("wall, median", "≤ 20 s", _quantity(seconds), lambda x: x <= 20, " s"),
        _number("… worst", "≤ 120 s", _quantity(seconds, np.max), lambda x: x <= 120, " s"),
        _number("memory, worst", "≤ 1024 MB", _quantity(memory, np.max), lambda x: x <= 1024, " MB"),
    ]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(r) + " |" for r in rows]) + "\n"


def _per_effect(rows: Rows) -> list[tuple[str, ...]]:
    mine = [r for r in rows if r["kind"] in ("single", "local", "simulation") and strong(r)]
    words = sorted({w for r in mine for w in r["wanted"]})
    columns = (("chamber", "reference"), ("walk", "reference"), ("walk", "simulation"))
    return [
        (
            word,
            *(
                shown(
                    rate([r["points"] for r in mine if r["wanted"] == [word] and (r["recording"], r["against"]) == c])
                )
                for c in columns
            ),
        )
        for word in words
    ]


def _by_strength(rows: Rows) -> list[tuple[str, ...]]:
    mine = [r for r in rows if r["kind"] in ("single", "local", "faint")]
    return [
        (
            f"{k:g}",
            *(
                shown(rate([r["points"] for r in mine if near(r, k) and r["recording"] == rec]))
                for rec in ("chamber", "walk")
            ),
        )
        for k in STRENGTHS
    ]


def _nulls(rows: Rows) -> list[tuple[str, str]]:
    nulls = [r for r in rows if r["kind"] == "null"]
    groups: dict[str, list[float]] = {}
    for r in nulls:
        periods = sorted(set(r["period_ms"]))
        for key in (
            f"{r['recording']}, {r['against']}",
            "boards " + ("mixed" if len(periods) > 1 else f"{periods[0]} ms"),
        ):
            groups.setdefault(key, []).append(float(r["false_alarm"]))
    return [(key, shown(rate(values))) for key, values in sorted(groups.items())]


def markdown(rows: Rows) -> str:
    """The table of bars, and what stands beside it."""
    weak = [r for r in rows if r["kind"] in (*KNOWN, "unknown") and not strong(r)]
    undecidable = rate([r["points"] for r in rows if r["kind"] == "undecidable"])
    failures = [r["untouched"]["failure"] for r in rows if r.get("untouched") and r["untouched"]["failure"]]
    parts = [
        table(("what", "bar", "measured", ""), [b.cells() for b in bars(rows)]),
        "Named first at 3 × the floor or more, by effect:\n",
        table(("effect", "chamber", "walk", "walk beside a simulation"), _per_effect(rows)),
        "Named first, by strength:\n",
        table(("× the floor", "chamber", "walk"), _by_strength(rows)),
        "False alarms on nulls:\n",
        table(("recordings", "alarmed"), _nulls(rows)),
        f"Undecidable by design, answered so: {shown(undecidable)}.\n",
        (
            f"{len(weak)} cases could not be made as strong as asked and count in no rate for 3 × the floor; "
            f"{sum(not r['answered'] for r in rows)} cases have no answer; "
            f"{len(failures)} no prediction on untouched data.\n"
        ),
    ]
    return "\n".join(parts)
