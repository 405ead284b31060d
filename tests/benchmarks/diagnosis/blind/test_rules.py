"""The rules of formats.md on answers made by hand."""

from typing import Any

import pytest

from benchmarks.diagnosis.blind import bounds
from benchmarks.diagnosis.blind.rules import judge

INSOLE_TAXELS = [[5, t, k] for t in range(3) for k in range(10)] + [[6, t, k] for t in range(2) for k in range(10)]


def truth(kind: str, *words: str, **changes: Any) -> dict[str, Any]:
    effects = [
        {
            "effect": word,
            "where": {"scope": "insole", "ids": []},
            "taxels": INSOLE_TAXELS,
            "k_floor": 3.0,
            "law": word,
            "accept": [word],
            "parameters": {},
            "amplitude_fraction": 0.1,
        }
        for word in words
    ]
    common = {"recording": "chamber", "against": "reference", "local": False, "period_ms": [20, 20, 20]}
    return {
        "kind": kind,
        "effects": effects,
        "equivalent": [],
        "tolerated": [],
        "taxels": INSOLE_TAXELS,
        **common,
        **changes,
    }


def answer(*named: Any, verdict: str = "explained") -> dict[str, Any]:
    findings = []
    for finding in named:
        effect, alternatives, other_keys = finding if isinstance(finding, tuple) else (finding, [], {})
        findings.append({"effect": effect, "alternatives": alternatives, "confidence": 0.9, **other_keys})
    return {"format": "insole-diagnosis/1", "verdict": verdict, "findings": findings}


@pytest.mark.parametrize(
    ("finding", "points"),
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
def test_points_depend_on_the_effect_that_is_named_first(finding, points):
    assert judge(truth("single", "creep"), answer(finding))["points"] == points


def test_recalibration_counts_like_any_word():
    assert judge(truth("single", "creep"), answer("gain", "creep"))["points"] == 0.0
    assert judge(truth("null"), answer("baseline"))["false_alarm"] is True
    assert judge(truth("single", "gain"), answer("gain"))["points"] == 1.0
    assert judge(truth("single", "bit_shift"), answer(("gain", ["bit_shift"], {})))["points"] == 0.5


def test_a_word_that_imitates_perfectly_is_right_too():
    sealed = truth("single", "preload")
    sealed["effects"][0]["accept"] = ["preload", "baseline"]
    score = judge(sealed, answer("baseline"))
    assert (score["points"], score["exact"], score["recall"]) == (1.0, True, 1.0)


def test_words_that_a_slow_converter_looks_like_are_passed_over():
    assert judge(truth("null", tolerated=["lag"]), answer("lag"))["false_alarm"] is False
    assert judge(truth("null", tolerated=["lag"]), answer("drift"))["false_alarm"] is True


def test_a_null_may_not_be_unexplained():
    assert judge(truth("null"), answer(verdict="unexplained"))["false_alarm"] is True
    assert judge(truth("null"), answer(verdict="no mismatch"))["false_alarm"] is False


def test_no_answer_is_wrong():
    assert judge(truth("null"), None)["false_alarm"] is True
    assert judge(truth("single", "creep"), None)["points"] == 0.0
    assert judge(truth("pair", "creep", "lag"), None)["exact"] is False
    assert judge(truth("undecidable", "creep", equivalent=["creep", "hysteresis"]), None)["points"] == 0.0


def test_an_exact_set_has_every_effect_first_and_no_other_finding():
    sealed = truth("pair", "creep", "lag")
    assert judge(sealed, answer("lag", "creep"))["exact"] is True
    row = judge(sealed, answer("lag", ("hysteresis", ["creep"], {})))
    assert (row["exact"], row["recall"]) == (False, 0.75)
    assert judge(sealed, answer("lag", "creep", "drift"))["exact"] is False
    assert judge(sealed, answer("lag", "gain", "creep"))["exact"] is False


@pytest.mark.parametrize(
    ("finding", "verdict", "points"),
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
def test_an_undecidable_case_needs_not_decidable_or_two_equivalent_words(finding, verdict, points):
    sealed = truth("undecidable", "creep", equivalent=["creep", "hysteresis", "viscoelasticity"])
    assert judge(sealed, answer(finding, verdict=verdict))["points"] == points


def test_an_effect_outside_the_vocabulary_must_be_called_unknown():
    sealed = truth("unknown", "unknown")
    assert judge(sealed, answer("unknown"))["points"] == 1.0
    assert judge(sealed, answer("creep", "unknown"))["points"] == 0.0
    assert judge(sealed, answer(verdict="no mismatch"))["points"] == 0.0
    local = truth("unknown", "unknown", local=True)
    local["effects"][0]["taxels"] = [t for t in INSOLE_TAXELS if t[:2] == [5, 1]]
    triangle = {"where": {"scope": "triangle", "ids": [[5, 1]]}}
    assert judge(local, answer(("unknown", [], triangle)))["right_board"] is True
    assert judge(local, answer("unknown"))["right_board"] is False


def test_a_place_is_scored_per_taxel_in_a_chamber_and_per_triangle_in_a_walk():
    sealed = truth("single", "creep")
    sealed["effects"][0]["taxels"] = [taxel for taxel in INSOLE_TAXELS if taxel[:2] == [5, 1]]
    board = {"where": {"scope": "board", "ids": [[5]]}}
    taxels = {"where": {"scope": "taxel", "ids": [[5, 1, 0], [6, 0, 0]]}}
    assert judge(sealed, answer(("creep", [], board)))["places"] == [pytest.approx(2 * 10 / 40)]
    assert judge(sealed, answer(("creep", [], taxels)))["places"] == [pytest.approx(2 * 1 / 12)]
    assert judge({**sealed, "recording": "walk"}, answer(("creep", [], taxels)))["places"] == [pytest.approx(2 / 3)]
    assert judge(sealed, answer("lag"))["places"] == []


@pytest.mark.parametrize(("reported", "right"), [([[5, 0], [5, 2]], True), ([[5, 0], [5, 1]], False)])
def test_swapped_triangles_have_to_be_both(reported, right):
    sealed = truth("simulation", "swapped_triangles")
    sealed["effects"][0]["where"] = {"scope": "triangle", "ids": [[5, 0], [5, 2]]}
    finding = ("swapped_triangles", [], {"where": {"scope": "triangle", "ids": reported}})
    assert judge(sealed, answer(finding))["map_right"] is right


@pytest.mark.parametrize(("rotation", "right"), [(3.1, True), (3.3, False)])
def test_a_map_has_to_be_within_the_tolerance(rotation, right):
    sealed = truth("simulation", "map_transform")
    sealed["effects"][0]["parameters"] = {"x_mm": [5.0], "y_mm": [-2.0], "rotation_deg": [3.0]}
    parameters = {"x_mm": {"value": [5.5]}, "y_mm": {"value": [-2.9]}, "rotation_deg": {"value": [rotation]}}
    row = judge(sealed, answer(("map_transform", [], {"parameters": parameters})))
    assert row["map_right"] is right
    # The error of a shift is relative to its length, because a component may be 0.
    assert row["parameters"][1]["relative_error"] == pytest.approx(0.9 / 29**0.5)


def test_stated_strengths_add_up_and_intervals_cover_the_true_value():
    sealed = truth("single", "viscoelasticity")
    sealed["effects"][0]["parameters"] = {"tau_s": [0.5], "a": [0.2]}
    parameters = {"tau_s": {"value": [0.55], "std": [0.02]}, "a": {"value": [0.1, 0.08]}}
    rows = judge(sealed, answer(("viscoelasticity", [], {"parameters": parameters, "amplitude_fraction": 0.11})))[
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
    assert bounds.log_score([(0.5, True), (0.5, False)]) == pytest.approx(-0.6931, abs=1e-4)
    confidences = [(0.9, True)] * 9 + [(0.9, False)] + [(0.1, True)] + [(0.1, False)] * 9
    assert bounds.slope(confidences) == pytest.approx(1.0)
    assert bounds.log_score(confidences) > bounds.base_log_score(confidences)
    assert bounds.slope([(0.8, True)] * 5) is None
