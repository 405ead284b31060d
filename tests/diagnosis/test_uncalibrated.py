"""Chambers without a calibration: curves are fitted to the recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.observations.fitted_curves import invert_curve
from insole_daemon.diagnosis.pipeline import diagnose
from insole_daemon.diagnosis.result import Diagnosis

from .chamber import LAYOUT, Array, load, relaxing, write


def without_calibration(folder: Path) -> Diagnosis:
    document = folder / "recording.yaml"
    document.write_text("\n".join(row for row in document.read_text().splitlines() if "calibration:" not in row) + "\n")
    (folder / "calibration.json").unlink()
    return diagnose([insole_daemon.load(folder)], None, lambda text: None)


def test_a_null_has_no_finding_and_no_static_effect_is_identifiable(tmp_path: Path) -> None:
    found = without_calibration(write(tmp_path / "null"))
    assert (found.verdict, found.findings) == ("no mismatch", ())
    assert found.heldout["before"] == pytest.approx(1.08, rel=0.03)  # the noise and its rounding
    untold = {each["effect"]: each["why"] for each in found.not_identifiable}
    for word in ("gain", "baseline", "stiffening", "bit_shift"):
        assert "no calibration" in untold[word]


def test_a_memory_is_named_and_its_model_gives_the_load(tmp_path: Path) -> None:
    found = without_calibration(write(tmp_path / "solid", relaxing(0.3, 0.8)))
    (finding,) = found.findings
    assert (finding.effect, finding.where.scope) == ("viscoelasticity", "insole")
    assert finding.parameters["a"].value == pytest.approx(0.3, rel=0.15)
    assert finding.parameters["tau_s"].value == pytest.approx(0.8, rel=0.2)
    assert found.verdict == "explained"
    # The best static curve is what it is compared with, and the memory's mean is in that.
    assert 1.4 < found.heldout["before"] < 2.0


def test_a_board_that_switches_with_the_load_is_a_snap_with_its_thresholds(tmp_path: Path) -> None:
    """As a board of the published insoles does: all its taxels read twenty counts more from one load to another."""
    t_s, pressure = load()
    on, is_on = np.zeros(len(t_s)), False
    for k, value in enumerate(pressure.tolist()):
        is_on = value >= 60e3 or (is_on and value > 35e3)
        on[k] = is_on

    def switching(cycle_s: Array, counts: Array) -> None:
        board = np.repeat(LAYOUT.identities[:, 0] == 6, 12)
        counts[:, board] -= 20.0 * (np.interp(cycle_s, t_s, on) > 0.5)[:, None]

    (finding,) = without_calibration(write(tmp_path / "switches", touch=switching)).findings
    assert (finding.effect, finding.where.ids) == ("snap", ((6,),))
    assert finding.parameters["up_pa"].value == pytest.approx(60e3, rel=0.1)
    assert finding.parameters["down_pa"].value == pytest.approx(35e3, rel=0.15)


def test_an_inverted_curve_rises_and_returns_the_load() -> None:
    loads = np.linspace(0.0, 3e5, 200)
    activation = 60.0 * loads / (loads + 4e5)
    back = invert_curve(activation, loads)
    assert np.abs(np.polynomial.polynomial.polyval(activation, back) - loads).max() < 1.5e3
    beyond = np.polynomial.polynomial.polyval(np.linspace(-2.0, 1.5 * activation[-1], 400), back)
    assert (np.diff(beyond) > 0).all()


@pytest.mark.parametrize("first", [-5.0, 0.0, 13.0], ids=["below_no_load", "at_no_load", "above_no_load"])
def test_an_inverted_curve_is_continued_straight_to_no_load_and_beyond_its_end(first: float) -> None:
    """A walk loads a taxel less, or half as much again, as the chamber did to which the curve was fitted."""
    loads = np.linspace(5e3, 3e5, 200)
    activation = first + 60.0 * np.tanh(loads / 2e5) + 4.0 * np.sin(loads / 2e4)
    back = invert_curve(np.maximum.accumulate(activation), loads)
    count = activation[-1] * np.array([0.0, 1.0, 1.25, 1.5])
    at_no_load, at_end, *beyond = np.polynomial.polynomial.polyval(count, back)
    assert -2e5 < at_no_load < 6e4
    assert at_end < beyond[0] < beyond[1] < 4.0 * at_end


def test_a_load_that_hardly_rises_at_the_ends_of_a_curve_is_inverted() -> None:
    """Otherwise the straight extensions beyond the ends would be longer than the curve."""
    activation = np.linspace(-8.0, 38.0, 200)
    loads = 88e3 * np.sin(np.linspace(-1.54, 1.54, 200))
    back = np.polynomial.polynomial.polyval(activation, invert_curve(activation, loads))
    assert np.sqrt(np.mean((back - loads) ** 2)) < 0.02 * np.ptp(loads)
