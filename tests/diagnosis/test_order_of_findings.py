"""Findings are in the order of their size, and `unknown` is as large as what it leaves."""

from __future__ import annotations

import pytest

from insole_daemon.diagnosis.finding import Finding
from insole_daemon.diagnosis.merging import RecordingFindings, merge_findings
from insole_daemon.physics.effect import Where


def finding(effect: str, **sizes: float) -> Finding:
    return Finding(effect=effect, foot="left", where=Where(), sentence="", recordings=("bag",), **sizes)


@pytest.mark.parametrize(("left", "first"), [(9.0, "unknown"), (1.0, "gain")])
def test_unknown_comes_first_where_it_leaves_more_than_others_explain(left, first):
    findings = (finding("gain", explains=4.0), finding("unknown", left=left))
    merged = merge_findings([RecordingFindings("bag", True, findings, frozenset())])
    assert merged[0].effect == first
    assert merged[0].document().keys() == findings[0].document().keys()
