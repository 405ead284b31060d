"""Messages of `insole diagnose` on a calibration whose curves fall at no load, or end below the readings."""

from __future__ import annotations

import json

import pytest

from insole_daemon.diagnosis.observing import observed
from insole_daemon.recording.loading import load

from . import chamber


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, ""),
        ({"coefficients_pa": [0.0, -500.0, 700.0]}, "bag: the curves of 60 of 60 taxels fall at no load"),
        (
            {"coefficients_pa": [0.0, 9000.0, -664.0, 113.5, -4.19]},
            "bag: readings of 60 of 60 taxels go beyond their curves",
        ),
    ],
)
def test_doubts_about_the_curves_of_many_taxels_are_said(tmp_path, change, said):
    folder = chamber.write(tmp_path / "bag", seconds=30.0)
    calibration = json.loads((folder / "calibration.json").read_text())
    for taxel in calibration["taxels"]:
        taxel.update(change)
    (folder / "calibration.json").write_text(json.dumps(calibration))
    recording = load(folder)
    lines: list[str] = []
    observed([recording], list(recording.feet), None, lines.append, ())
    assert [line.startswith(said) for line in lines[1:]] == [True] * bool(said)
