"""The verdict and the shares, from numbers alone."""

from __future__ import annotations

import math

import pytest

from insole_daemon.diagnosis.outcome import shares, verdict


@pytest.mark.parametrize(
    ("before", "after", "findings", "unknown", "undecided", "expected"),
    [
        (1.05, 1.05, 0, 0, False, "no mismatch"),
        (4.0, 1.0, 0, 0, False, "unexplained"),  # what fell without a finding is no explanation
        (4.0, 1.14, 1, 0, False, "explained"),
        (4.0, 1.16, 1, 0, False, "partly explained"),
        (4.0, 3.9, 1, 0, False, "unexplained"),
        (4.0, math.sqrt(1 + 0.79 * 15), 1, 0, False, "partly explained"),  # a fifth, and a little more
        (4.0, math.sqrt(1 + 0.81 * 15), 1, 0, False, "unexplained"),
        (4.0, 1.1, 2, 1, False, "partly explained"),
        (4.0, 1.1, 1, 1, False, "unexplained"),
        (4.0, 1.1, 1, 0, True, "not decidable"),
        (1.02, 1.01, 1, 0, False, "explained"),  # lost frames leave no error behind
    ],
)
def test_the_verdict_follows_from_the_numbers(
    before: float, after: float, findings: int, unknown: int, undecided: bool, expected: str
) -> None:
    assert verdict(before, after, 1.0, 1.1, findings=findings, unknown=unknown, undecided=undecided) == expected


def test_shares_of_findings_and_alignment_sum_to_one() -> None:
    explained, aligned = shares([6.0, 3.0, 0.0], before=4.0, after=1.0)
    assert explained == pytest.approx((0.4, 0.2, 0.0))
    assert aligned == pytest.approx(0.4)


def test_gains_that_overlap_are_reduced_in_proportion() -> None:
    explained, aligned = shares([20.0, 10.0], before=4.0, after=1.0)
    assert explained == pytest.approx((2 / 3, 1 / 3))
    assert aligned == pytest.approx(0.0)


def test_without_findings_the_alignment_has_the_whole_share() -> None:
    assert shares([], before=1.0, after=1.0) == ((), 1.0)
    assert shares([-1.0], before=1.0, after=1.2) == ((0.0,), 1.0)
