"""A reference that stepped or drifted is told from sensors that did."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis import diagnosing
from insole_daemon.diagnosis.candidates import candidates
from insole_daemon.diagnosis.diagnosing import Diagnosis, diagnose

from .chamber import write

COURSE = ([0.0, 15.0, 45.0, 60.0], [0.0, 0.3, -0.4, 1.0])


@pytest.fixture(autouse=True)
def _few_candidates(monkeypatch):
    def some(excitation):
        return {word: candidates(excitation)[word] for word in ("hysteresis", "viscoelasticity", "drift")}

    monkeypatch.setattr(diagnosing, "candidates", some)


def found(folder) -> Diagnosis:
    return diagnose([insole_daemon.load(folder)], None, None, lambda text: None)


@pytest.mark.parametrize("clock", ["can", "own"])
def test_a_reference_that_stepped(tmp_path, clock):
    def reference(t_s, p):
        return p + 8e3 * (t_s > 31.7)

    diagnosis = found(write(tmp_path / "stepped", reference=reference, clock=clock, seconds=60.0))
    (finding,) = diagnosis.findings
    assert finding.effect == "reference_fault"
    assert finding.when_s[0][0] == pytest.approx(31.7, abs=0.2)
    assert "+8.0" in finding.sentence or "+7.9" in finding.sentence
    assert diagnosis.heldout["after"] < 1.02 * diagnosis.heldout["floor"]


@pytest.mark.parametrize("size_pa", [60e3, 20e3])  # far enough to bend the curves, and where they are straight
def test_a_reference_that_drifted(tmp_path, size_pa):
    def reference(t_s, p):
        return p + size_pa * np.interp(t_s, *COURSE)

    diagnosis = found(write(tmp_path / "drifted", reference=reference, seconds=60.0))
    assert [each.effect for each in diagnosis.findings] == ["reference_fault"]
    assert diagnosis.heldout["after"] < 1.02 * diagnosis.heldout["floor"]


def test_counts_that_drifted_are_no_fault_of_the_reference(tmp_path):
    def touch(t_s, counts):
        counts += 2.5 * np.interp(t_s, *COURSE)[:, None]

    diagnosis = found(write(tmp_path / "drift", touch=touch, seconds=60.0))
    assert [each.effect for each in diagnosis.findings] == ["drift"]


def test_counts_that_stepped_everywhere_are_no_fault_of_the_reference(tmp_path):
    def touch(t_s, counts):
        counts += 3.0 * (t_s > 31.7)[:, None]

    diagnosis = found(write(tmp_path / "zeroed", touch=touch, seconds=60.0))
    assert "reference_fault" not in [each.effect for each in diagnosis.findings]
