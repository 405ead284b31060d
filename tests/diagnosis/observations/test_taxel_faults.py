"""Single taxels with another gain or baseline than the rest of their triangle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.observations.taxel_faults import correct_taxels
from insole_daemon.diagnosis.observing import observed
from tests.diagnosis import chamber

SHIFT_COUNT = 15.0


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    recording = insole_daemon.load(chamber.write(tmp_path_factory.mktemp("chamber") / "bag"))
    (observation,) = observed([recording], list(recording.feet), None, lambda text: None, ())
    return observation


def shifted(seen):
    """Return the observation with the readings of a board shifted, and the pressure that the curves then read."""
    board = seen.layout.identities[0, 0]
    shift = np.where((seen.layout.identities[:, 0] == board)[:, None] & seen.usable, SHIFT_COUNT, 0.0)
    return replace(seen, activation_count=seen.activation_count + shift), seen.static_pa(seen.expected_count + shift)


def test_taxels_on_steeper_curves_are_not_odd_beside_a_baseline_of_their_board(seen):
    with_baseline, model_pa = shifted(seen)
    odd = correct_taxels(with_baseline, seen.usable)[1]
    assert odd.findings, "their readings differ from those of their triangle"
    assert odd.beside(model_pa) == []


def test_a_taxel_with_another_gain_is_odd_beside_a_baseline_of_its_board(seen):
    with_baseline, model_pa = shifted(seen)
    activation = with_baseline.activation_count.copy()
    activation[:, 2, 4] *= 1.3
    odd = correct_taxels(replace(with_baseline, activation_count=activation), seen.usable)[1]
    (finding,) = odd.beside(model_pa)
    assert (finding.effect, finding.where.ids) == ("gain", ((*seen.layout.identities[2].tolist(), 4),))
    assert finding.parameters["gain"].value == pytest.approx(1.3, abs=0.05)
