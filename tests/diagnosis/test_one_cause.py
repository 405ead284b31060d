"""What two groups are off by in the same way has one name."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.candidates import candidates
from insole_daemon.diagnosis.evidence import Taxels, gather
from insole_daemon.diagnosis.excitation import excitation
from insole_daemon.diagnosis.groups import Named
from insole_daemon.diagnosis.naming import name
from insole_daemon.diagnosis.observing import observe
from insole_daemon.diagnosis.one_cause import of_one_cause
from insole_daemon.skin.geometry import N_TAXELS

from .chamber import LAYOUT, relaxing, write


@pytest.fixture
def late(tmp_path):
    """What the data show, the taxels of two boards, and those of a third, each off by the same lag."""
    recording = insole_daemon.load(write(tmp_path / "late", relaxing(1.0, 0.2), seconds=60.0))
    (foot,) = recording.feet
    audited = audit(foot, "trial")
    seen, _ = observe(recording, foot, audited.kept, audited)
    excited = excitation([seen])
    asked = {word: each for word, each in candidates(excited).items() if word in ("lag", "delay")}
    third = LAYOUT.identities[:, 0][seen.slots // N_TAXELS] == 6
    groups = [
        gather(Taxels((seen,), seen.slots, seen.noise_count).some(own), np.empty((len(seen.first), 0)))
        for own in (~third, third)
    ]
    many, few = (Named(group, name(group.evidence, asked, group.floor, math.inf)) for group in groups)
    return excited, many, few


def called(named: Named, word: str) -> Named:
    (best,) = [tried for tried in named.naming.tried if tried.words == (word,)]
    return replace(named, naming=replace(named.naming, best=best))


def test_a_group_that_could_be_called_either_has_the_name_of_a_larger_one(late):
    excited, many, few = late
    assert many.naming.best.words == ("lag",)
    found = of_one_cause([many, called(few, "delay")], excited)
    assert [each.naming.best.words for each in found] == [("lag",), ("lag",)]


def test_a_larger_group_that_could_be_called_either_decides_nothing(late):
    excited, many, few = late
    found = of_one_cause([called(many, "delay"), few], excited)
    assert [each.naming.best.words for each in found] == [("delay",), ("lag",)]
