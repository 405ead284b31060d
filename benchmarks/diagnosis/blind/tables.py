"""Makes the table of results and targets from scored cases, and writes it as markdown."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from . import bounds
from .rules import FULL_STRENGTH

Rows = list[dict[str, Any]]
KNOWN = ("single", "local", "pair", "triple", "simulation")
STRENGTHS = (0.5, 1.0, 3.0, 10.0)  # x the floor
GAIN_WORTH_SHARING = 1.1  # static error over the oracle's; below it a model has nothing to gain
WORSE = 0.02
NULL_QUANTILE = 0.95


def rate(values: list[float]) -> dict[str, Any]:
    """Mean of the points with Wilson's interval."""
    n, right = len(values), float(sum(values))
    low, high = bounds.wilson(right, n)
    return {"n": n, "right": right, "rate": right / n if n else None, "low": low, "high": high}


def is_strong(row: dict[str, Any]) -> bool:
    """Whether all effects are at 3 x the floor or more; faults have no strength and count as strong."""
    return row["k"] is None or row["k"] >= FULL_STRENGTH


def is_near(row: dict[str, Any], k: float) -> bool:
    """Whether the strength is k x the floor within a third."""
    return row["k"] is not None and abs(np.log(max(row["k"], 1e-9) / k)) < 0.35


def format_percent(value: float | None) -> str:
    """A share as a percentage; a dash for None."""
    return "–" if value is None else f"{100 * value:.0f} %"


def format_share(share: dict[str, Any]) -> str:
    """Text of a result of `rate`."""
    if not share["n"]:
        return "no case"
    low, high = format_percent(share["low"]), format_percent(share["high"])
    return f"{format_percent(share['rate'])} ({share['right']:g} of {share['n']}; {low}–{high})"


def _quantity(values: list[float], statistic: Callable[[Any], Any] = np.median) -> dict[str, Any]:
    """A statistic of `values` with its 95 % bootstrap interval."""
    if not values:
        return {"n": 0, "value": None, "low": None, "high": None}
    rng = np.random.default_rng(0)
    samples = [statistic(rng.choice(values, len(values))) for _ in range(300)]
    low, high = (float(q) for q in np.quantile(samples, (0.025, 0.975)))
    return {"n": len(values), "value": float(statistic(values)), "low": low, "high": high}


class Bar:
    """One row of the table: title, target (`bar`), measured value, and whether the target is reached."""

    def __init__(self, title: str, bar: str, measured: str, reached: bool | None):
        self.title, self.bar, self.measured, self.reached = title, bar, measured, reached

    def cells(self) -> tuple[str, str, str, str]:
        """Texts of the row's cells."""
        return self.title, self.bar, self.measured, {True: "reached", False: "missed", None: "–"}[self.reached]


def _share(title: str, values: list[float], at_least: float | None = None, at_most: float | None = None) -> Bar:
    """A row with the mean of points and its target, `at_least` or `at_most`."""
    share = rate(values)
    value = share["rate"]
    if at_least is not None:
        return Bar(
            title, f"≥ {format_percent(at_least)}", format_share(share), None if value is None else value >= at_least
        )
    assert at_most is not None
    return Bar(title, f"≤ {format_percent(at_most)}", format_share(share), None if value is None else value <= at_most)


def _number(title: str, bar: str, quantity: dict[str, Any], reached: Callable[[float], bool], unit: str = "") -> Bar:
    """A row with a result of `_quantity`; `reached` decides whether a value meets the target."""
    if quantity["value"] is None:
        return Bar(title, bar, "no case", None)
    scale = 100 if unit == " %" else 1
    value, low, high = (scale * quantity[key] for key in ("value", "low", "high"))
    digits = 0 if unit == " %" else 1 if unit else 2
    text = f"{value:.{digits}f}{unit} (n {quantity['n']}; {low:.{digits}f}–{high:.{digits}f}{unit})"
    return Bar(title, bar, text, reached(quantity["value"]))


def _beyond_nulls(rows: Rows, faint: Rows) -> list[float]:
    """For each faint case called `no mismatch`: 1 if before/floor is above the 95 % quantile of the nulls, else 0."""

    def ratio(row: dict[str, Any]) -> float | None:
        has_both = row["before"] is not None and row["floor"]
        return float(row["before"]) / float(row["floor"]) if has_both else None

    is_beyond = []
    for row in faint:
        nulls = [
            ratio_of_null
            for null in rows
            if null["kind"] == "null"
            and null["recording"] == row["recording"]
            and (ratio_of_null := ratio(null)) is not None
        ]
        ratio_of_row = ratio(row)
        if row["verdict"] == "no mismatch" and nulls and ratio_of_row is not None:
            is_beyond.append(float(ratio_of_row > np.quantile(nulls, NULL_QUANTILE)))
    return is_beyond


def _recovered(rows: Rows) -> list[float]:
    """Shares of the oracle's gain that models of strong, known effects recover."""
    comparisons = [r["untouched"] for r in rows if r["kind"] in KNOWN and is_strong(r) and r.get("untouched")]
    return [comparison["recovered"] for comparison in comparisons if comparison.get("recovered") is not None]


def bars(rows: Rows) -> list[Bar]:
    """All rows of the table of results, in its order."""

    def rows_of(*kinds: str) -> Rows:
        return [r for r in rows if r["kind"] in kinds]

    alone = [r for r in rows_of("single", "local") if is_strong(r)]
    results = [
        _share("single ≥ 3 × floor and faults: named first", [r["points"] for r in alone], 0.95),
        _share("… exact set", [float(r["exact"]) for r in alone], 0.90),
    ]
    for recording in ("chamber", "walk"):
        of_recording = [r for r in alone if r["recording"] == recording]
        results.append(_share(f"… {recording}: named first", [r["points"] for r in of_recording], 0.90))
        results.append(_share(f"… {recording}: exact set", [float(r["exact"]) for r in of_recording], 0.85))
    faint = [r for r in rows_of("faint", "single", "local") if is_near(r, 1.0)]
    is_noticed = [float(r["mentioned"] or r["verdict"] in ("unexplained", "partly explained")) for r in faint]
    results.append(
        Bar("1 × floor: named, in alternatives, or `unexplained`", "–", format_share(rate(is_noticed)), None)
    )
    results.append(_share("… `no mismatch` beyond the nulls", _beyond_nulls(rows, faint), at_most=0.0))
    results.append(_share("… wrong name", [float(r["wrong_name"]) for r in faint], at_most=0.05))
    for kind, bar in (("pair", 0.80), ("triple", 0.65)):
        results.append(_share(f"{kind}s: exact", [float(r["exact"]) for r in rows_of(kind) if is_strong(r)], bar))
    paired = [r for r in rows_of("simulation") if is_strong(r)]
    results.append(_share("paired simulation: named first", [r["points"] for r in paired], 0.90))
    maps = [float(r["map_right"]) for r in paired if r["map_right"] is not None]
    results.append(_share("… swap or map right", maps, 0.95))
    results.append(_share("nulls, false alarms", [float(r["false_alarm"]) for r in rows_of("null")], at_most=0.02))
    outside = [r for r in rows_of("unknown") if is_strong(r)]
    results.append(_share("outside the library: `unknown` first", [r["points"] for r in outside], 0.90))
    boards = [float(r["right_board"]) for r in outside if r["right_board"] is not None]
    results.append(_share("… right board", boards, 0.80))
    known = [r for r in rows_of(*KNOWN) if is_strong(r)]
    results.append(_share("known called `unknown`", [float(r["first_unknown"]) for r in known], at_most=0.05))
    for recording, place_unit, bar in (("chamber", "per taxel", 0.95), ("walk", "per (board, triangle)", 0.85)):
        f1 = [p for r in known if r["recording"] == recording for p in r["places"]]
        results.append(
            _number(f"place, F1 {place_unit}, {recording}", f"≥ {bar}", _quantity(f1, np.mean), lambda x, b=bar: x >= b)
        )
    parameters = [p for r in known for p in r["parameters"]]
    errors = [p["relative_error"] for p in parameters if p["relative_error"] is not None]
    results.append(_number("parameters: median error", "≤ 10 %", _quantity(errors), lambda x: x <= 0.1, " %"))
    covered = rate([float(p["covered"]) for p in parameters if p["covered"] is not None])
    is_calibrated = None if covered["rate"] is None else 0.85 <= covered["rate"] <= 0.95
    results.append(Bar("… 90 % intervals cover", "85–95 %", format_share(covered), is_calibrated))
    results.append(
        _number(
            "recovered share of the oracle's gain, median", "≥ 0.95", _quantity(_recovered(rows)), lambda x: x >= 0.95
        )
    )
    compared = [r["untouched"] for r in rows if r.get("untouched") and r["untouched"].get("change") is not None]
    made_worse = [float(comparison["change"] > WORSE) for comparison in compared]
    results.append(_share("untouched data made worse by > 2 %", made_worse, at_most=0.0))
    results += _confidence(rows) + _runs(rows)
    return results


def _confidence(rows: Rows) -> list[Bar]:
    """Rows on the calibration of the stated confidences."""
    stated = [(confidence, is_true) for r in rows for confidence, is_true in r["confidences"]]
    score, base_score = bounds.log_score(stated), bounds.base_log_score(stated)
    if score is None or base_score is None:
        return [Bar(title, bar, "no case", None) for title, bar in _CONFIDENCE]
    slope, interval = bounds.slope(stated), bounds.bootstrap_interval(stated, bounds.slope)
    text = (
        "–"
        if slope is None or interval is None
        else f"{slope:.2f} (n {len(stated)}; {interval[0]:.2f}–{interval[1]:.2f})"
    )
    gain = bounds.bootstrap_interval(stated, lambda s: (bounds.log_score(s) or 0) - (bounds.base_log_score(s) or 0))
    assert gain is not None or len(stated) < 3
    difference = "" if gain is None else f"; difference {gain[0]:+.3f} to {gain[1]:+.3f}"
    return [
        Bar(*_CONFIDENCE[0], f"{score:.3f} against {base_score:.3f} (n {len(stated)}{difference})", score > base_score),
        Bar(*_CONFIDENCE[1], text, None if slope is None else 0.8 <= slope <= 1.2),
    ]


_CONFIDENCE = (
    ("confidence: log score against the base rate", "better"),
    ("… slope of the reliability curve", "0.8–1.2"),
)


def _runs(rows: Rows) -> list[Bar]:
    """Rows on crashes, duration and memory of the runs."""
    runs = [r["run"] for r in rows if r["run"]]
    broken = [float(r["traceback"] or r["status"] < 0 or r["ended"] != "by itself") for r in runs]
    seconds, memory = [r["seconds"] for r in runs], [r["peak_mb"] for r in runs]
    return [
        _share("tracebacks, crashes and time-outs", broken, at_most=0.0),
        _number("wall, median", "≤ 20 s", _quantity(seconds), lambda x: x <= 20, " s"),
        _number("… worst", "≤ 120 s", _quantity(seconds, np.max), lambda x: x <= 120, " s"),
        _number("memory, worst", "≤ 1024 MB", _quantity(memory, np.max), lambda x: x <= 1024, " MB"),
    ]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(r) + " |" for r in rows]) + "\n"


def _per_effect(rows: Rows) -> list[tuple[str, ...]]:
    """Rows of the table by effect, for each kind of recording."""
    strong_rows = [r for r in rows if r["kind"] in ("single", "local", "simulation") and is_strong(r)]
    words = sorted({w for r in strong_rows for w in r["wanted"]})
    columns = (("chamber", "reference"), ("walk", "reference"), ("walk", "simulation"))

    def points(word: str, column: tuple[str, str]) -> list[float]:
        return [r["points"] for r in strong_rows if r["wanted"] == [word] and (r["recording"], r["against"]) == column]

    return [(word, *(format_share(rate(points(word, column))) for column in columns)) for word in words]


def _by_strength(rows: Rows) -> list[tuple[str, ...]]:
    """Rows of the table by strength, for chamber and walk."""
    known_rows = [r for r in rows if r["kind"] in ("single", "local", "faint")]
    return [
        (
            f"{k:g}",
            *(
                format_share(rate([r["points"] for r in known_rows if is_near(r, k) and r["recording"] == recording]))
                for recording in ("chamber", "walk")
            ),
        )
        for k in STRENGTHS
    ]


def _nulls(rows: Rows) -> list[tuple[str, str]]:
    """Rows of the table of false alarms, by kind of recording and by period."""
    nulls = [r for r in rows if r["kind"] == "null"]
    groups: dict[str, list[float]] = {}
    for r in nulls:
        periods = sorted(set(r["period_ms"]))
        for key in (
            f"{r['recording']}, {r['against']}",
            "boards " + ("mixed" if len(periods) > 1 else f"{periods[0]} ms"),
        ):
            groups.setdefault(key, []).append(float(r["false_alarm"]))
    return [(key, format_share(rate(values))) for key, values in sorted(groups.items())]


def markdown(rows: Rows) -> str:
    """The table of results, the tables by effect, strength and kind of null, and the numbers of cases left out."""
    weak = [r for r in rows if r["kind"] in (*KNOWN, "unknown") and not is_strong(r)]
    undecidable = rate([r["points"] for r in rows if r["kind"] == "undecidable"])
    failures = [r["untouched"]["failure"] for r in rows if r.get("untouched") and r["untouched"]["failure"]]
    sections = [
        table(("what", "bar", "measured", ""), [b.cells() for b in bars(rows)]),
        "Named first at 3 × the floor or more, by effect:\n",
        table(("effect", "chamber", "walk", "walk beside a simulation"), _per_effect(rows)),
        "Named first, by strength:\n",
        table(("× the floor", "chamber", "walk"), _by_strength(rows)),
        "False alarms on nulls:\n",
        table(("recordings", "alarmed"), _nulls(rows)),
        f"Undecidable by design, answered so: {format_share(undecidable)}.\n",
        (
            f"{len(weak)} cases could not be made as strong as asked and count in no rate for 3 × the floor; "
            f"{sum(not r['answered'] for r in rows)} cases have no answer; "
            f"{len(failures)} no prediction on untouched data.\n"
        ),
    ]
    return "\n".join(sections)
