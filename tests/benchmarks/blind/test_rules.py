"""The contract's rules on answers made by hand."""

from typing import Any

import pytest

from benchmarks.blind import bounds
from benchmarks.blind.rules import judge

EVERY = [[5, t, k] for t in range(3) for k in range(10)] + [[6, t, k] for t in range(2) for k in range(10)]


def truth(kind: str, *words: str, **more: Any) -> dict[str, Any]:
    effects = [
        {
            "effect": w,
            "where": {"scope": "insole", "ids": []},
            "taxels": EVERY,
            "k_floor": 3.0,
            "parameters": {},
            "amplitude_fraction": 0.1,
        }
        for w in words
    ]
    return {"kind": kind, "effects": effects, "equivalent": [], "also_right": [], "taxels": EVERY, **more}


def answer(*found: Any, verdict: str = "explained") -> dict[str, Any]:
    findings = []
    for f in found:
        effect, alternatives, more = f if isinstance(f, tuple) else (f, [], {})
        findings.append({"effect": effect, "alternatives": alternatives, "confidence": 0.9, **more})
    return {"format": "insole-diagnosis/1", "verdict": verdict, "findings": findings}


@pytest.mark.parametrize(
    ("found", "points"),
    [
        (("creep", [], {}), 1.0),
        (("creep", ["hysteresis"], {}), 1.0),
        (("hysteresis", ["creep"], {}), 0.5),
        (("hysteresis", ["lag", "creep"], {}), 0.0),
        (("creep", ["lag", "hysteresis"], {}), 0.0),
        (("lag", [], {}), 0.0),
        (("unknown", [], {}), 0.0),
    ],
)
def test_first_named(found, points):
    assert judge(truth("single", "creep"), answer(found))["points"] == points


def test_recalibration_nobody_concealed_is_passed_over():
    assert judge(truth("single", "creep"), answer("gain", "baseline", "creep"))["points"] == 1.0
    assert judge(truth("null"), answer("gain"))["false_alarm"] is False
    assert judge(truth("single", "gain"), answer("gain"))["points"] == 1.0
    assert judge(truth("single", "bit_shift"), answer(("gain", ["bit_shift"], {})))["points"] == 0.5
    assert judge(truth("null"), answer("stiffening"))["false_alarm"] is True


def test_nothing_said_is_wrong():
    assert judge(truth("null"), None)["false_alarm"] is True
    assert judge(truth("single", "creep"), None)["points"] == 0.0
    assert judge(truth("pair", "creep", "lag"), None)["exact"] is False
    assert judge(truth("undecidable", "creep", equivalent=["creep", "hysteresis"]), None)["points"] == 0.0


def test_sets():
    wanted = truth("pair", "creep", "lag")
    assert judge(wanted, answer("lag", "creep"))["exact"] is True
    row = judge(wanted, answer("lag", ("hysteresis", ["creep"], {})))
    assert (row["exact"], row["recall"]) == (False, 0.75)
    assert judge(wanted, answer("lag", "creep", "drift"))["exact"] is False
    assert judge(wanted, answer("lag", "gain", "creep"))["exact"] is True


@pytest.mark.parametrize(
    ("found", "verdict", "points"),
    [
        (("hysteresis", ["creep"], {}), "explained", 1.0),
        (("creep", ["hysteresis"], {}), "explained", 1.0),
        (("creep", [], {}), "explained", 0.0),
        (("creep", ["temperature"], {}), "explained", 0.0),
        (("hysteresis", ["viscoelasticity"], {}), "explained", 0.0),
        (("creep", ["hysteresis", "viscoelasticity"], {}), "explained", 0.0),
        (("creep", [], {}), "not decidable", 1.0),
    ],
)
def test_undecidable(found, verdict, points):
    wanted = truth("undecidable", "creep", equivalent=["creep", "hysteresis", "viscoelasticity"])
    assert judge(wanted, answer(found, verdict=verdict))["points"] == points


def test_outside_the_library():
    wanted = truth("outside", "unknown")
    assert judge(wanted, answer("unknown"))["points"] == 1.0
    assert judge(wanted, answer("creep", "unknown"))["points"] == 0.0
    assert judge(wanted, answer(verdict="no mismatch"))["points"] == 0.0
    assert judge(truth("outside", "unknown", also_right=["noise_burst"]), answer("noise_burst"))["points"] == 1.0


def test_place():
    wanted = truth("single", "creep")
    wanted["effects"][0]["taxels"] = [t for t in EVERY if t[:2] == [5, 1]]
    board = {"where": {"scope": "board", "ids": [[5]]}}
    taxels = {"where": {"scope": "taxel", "ids": [[5, 1, 0], [6, 0, 0]]}}
    assert judge(wanted, answer(("creep", [], board)))["places"][0]["counts"] == (10, 20, 0)
    assert judge(wanted, answer(("creep", [], taxels)))["places"][0]["counts"] == (1, 1, 9)
    assert judge(wanted, answer("lag"))["places"] == []


def test_parameters():
    wanted = truth("single", "viscoelasticity")
    wanted["effects"][0]["parameters"] = {"tau_s": [0.5], "a": [0.2]}
    said = {"tau_s": {"value": [0.55], "std": [0.02]}, "a": {"value": [0.1, 0.08]}}
    rows = judge(wanted, answer(("viscoelasticity", [], {"parameters": said, "amplitude_fraction": 0.11})))[
        "parameters"
    ]
    by_name = {r["parameter"]: r for r in rows}
    assert by_name["tau_s"]["relative_error"] == pytest.approx(0.1)
    assert by_name["tau_s"]["covered"] is False
    assert by_name["a"]["relative_error"] == pytest.approx(0.1)
    assert by_name["a"]["covered"] is None
    assert by_name["amplitude_fraction"]["relative_error"] == pytest.approx(0.1)


def test_bounds_are_the_published_ones():
    assert bounds.wilson(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert bounds.clopper_pearson_upper(0, 59) == pytest.approx(0.0495, abs=1e-4)
    assert bounds.clopper_pearson_upper(3, 3) == 1.0
    assert bounds.brier([(1.0, True), (0.5, False)]) == pytest.approx(0.125)
    assert bounds.expected_calibration_error([(0.9, True)] * 9 + [(0.9, False)]) == pytest.approx(0.0)
    assert bounds.expected_calibration_error([(0.95, False)] * 4) == pytest.approx(0.95)
