"""Delays and clocks within the tolerance of the times that were recorded."""

from __future__ import annotations

import pytest

from insole_daemon.diagnosis.finding import Quantity
from insole_daemon.diagnosis.timings import is_nuisance


@pytest.mark.parametrize(
    ("delay_s", "latest_s", "expected"),
    [(0.002, 0.0, True), (0.014, 0.0, False), (0.014, 0.02, True), (0.06, 0.02, False)],
)
def test_a_delay_within_the_age_of_the_readings_is_none(delay_s, latest_s, expected):
    """The rows of a host without ages have readings that were taken at any time since the row before."""
    assert is_nuisance("delay", {"delay_s": Quantity(delay_s, 1e-3, "s")}, latest_s) is expected


@pytest.mark.parametrize(
    ("tau_s", "latest_s", "expected"),
    [(0.04, 0.0, False), (0.04, 0.02, True), (0.04, 0.005, False), (0.4, 0.2, False)],
)
def test_a_viscoelasticity_as_fast_as_the_age_of_the_readings_is_none(tau_s, latest_s, expected):
    parameters = {"a": Quantity(0.17, 0.06, "1"), "tau_s": Quantity(tau_s, 0.005, "s")}
    assert is_nuisance("viscoelasticity", parameters, latest_s) is expected
