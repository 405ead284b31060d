"""A board that is re-zeroed on a walk in which the person also stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.observations.rezeros import correct_rezeros
from insole_daemon.diagnosis.observing import observed

from ..foot import shoe

BOARD = 6
STANDS_S, STANDING_COUNT = (6.0, 18.0), 12.0
ZEROED_S = (17.0, 17.5)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Foot and observation of a walk with a stand of 12 s."""
    recording = insole_daemon.load(shoe.write(tmp_path_factory.mktemp("walk") / "walk", seconds=40.0))
    (foot,) = recording.feet
    (seen,) = observed([recording], [foot], None, lambda text: None, ())
    activation = seen.activation_count.copy()
    stands = (seen.t_s > STANDS_S[0]) & (seen.t_s < STANDS_S[1])
    activation[stands] = np.where(seen.usable, STANDING_COUNT, 0.0)
    return foot, replace(seen, activation_count=activation)


def test_rezero_under_a_standing_foot_is_detected_when_it_happened(walk):
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    activation = seen.activation_count.copy()
    step = np.flatnonzero((seen.t_s > ZEROED_S[0]) & (seen.t_s < ZEROED_S[1]))
    at = int(step[np.argmax(activation[step][:, own].mean(axis=1))])
    activation[at:] -= np.where(own, activation[at], 0.0)
    _, findings = correct_rezeros(foot, replace(seen, activation_count=activation))
    (finding,) = findings
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=0.2)


def test_standing_is_no_rezero(walk):
    assert correct_rezeros(*walk)[1] == []


def test_undershoot_of_cubics_at_edges_is_no_rezero(walk):
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    activation, after = seen.activation_count.copy(), np.flatnonzero(seen.t_s > STANDS_S[1])
    for k in (0, 1):  # two rows of a step of 50
        activation[after[k::50]] -= np.where(own, 8.0, 0.0)
    assert correct_rezeros(foot, replace(seen, activation_count=activation))[1] == []
