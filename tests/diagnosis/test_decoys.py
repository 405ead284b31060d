"""What is no better than its own copies without physics is not named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.candidate import Candidate
from insole_daemon.diagnosis.candidates.viscoelasticity import candidate
from insole_daemon.diagnosis.decoys import challenged
from insole_daemon.diagnosis.evidence import Taxels
from insole_daemon.diagnosis.excitation import excitation
from insole_daemon.diagnosis.groups import Named, locate
from insole_daemon.diagnosis.observing import observe

from .chamber import relaxing, write


def backwards(effect):
    return lambda t_s, p: effect(t_s, p[::-1])[::-1]


def explained(folder, change=lambda found: found) -> Named:
    """All taxels, with viscoelasticity as the one candidate, changed."""
    recording = insole_daemon.load(folder)
    (foot,) = recording.feet
    audited = audit(foot, "trial")
    seen, _ = observe(recording, foot, audited.kept, audited)
    found: Candidate = change(candidate(excitation([seen])))
    nothing = np.empty((len(seen.first), 0))
    located = locate(
        Taxels((seen,), seen.slots, seen.noise_count), {found.word: found}, nothing, math.inf, lambda text: None
    )
    (named,) = located.named
    return named


def test_an_effect_of_the_load_is_better_than_its_decoys(tmp_path):
    found = challenged(explained(write(tmp_path / "solid", relaxing(0.3, 0.8), seconds=60.0)))
    assert found.naming.best.words == ("viscoelasticity",)
    assert [each.kind for each in found.naming.decoys] == ["time-reversed", "symmetric in time", "phase-scrambled"]
    for each in found.naming.decoys:
        assert not each.as_good
        assert each.left > 5 * each.effect_left_heldout


def test_a_smoother_that_knows_the_future_is_named_by_nothing(tmp_path):
    solid = relaxing(0.5, 0.8)

    def both_ways(t_s, p):
        return (solid(t_s, p) + backwards(solid)(t_s, p)) / 2

    def smoother(found: Candidate) -> Candidate:
        forwards = found.act
        assert forwards is not None

        def act(x, step_s, theta):
            return (forwards(x, step_s, theta) + forwards(x[::-1], step_s, theta)[::-1]) / 2

        return replace(found, act=act)

    named = explained(write(tmp_path / "smooth", both_ways, seconds=60.0), smoother)
    assert named.naming.best.words == ("viscoelasticity",)
    assert named.naming.best.left_heldout == pytest.approx(0.0, abs=0.05)
    found = challenged(named)
    assert found.naming.best.words == ()
    assert {each.kind for each in found.naming.decoys if each.as_good} >= {"time-reversed", "symmetric in time"}
