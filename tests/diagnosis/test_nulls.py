"""Nulls that are made of a recording: what chance gives, and what it does not."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.candidates import candidates
from insole_daemon.diagnosis.diagnosing import Diagnosis, diagnose
from insole_daemon.diagnosis.evidence import Taxels, gather
from insole_daemon.diagnosis.fit import Hypothesis
from insole_daemon.diagnosis.nulls import N_NULLS, Nulls, nulls

from .chamber import relaxing, write


def found(folder) -> tuple[Diagnosis, Nulls]:
    diagnosis = diagnose([insole_daemon.load(folder)], None, None, lambda text: None)
    insole = diagnosis.insole
    group = gather(Taxels(diagnosis.observed, insole.slots, insole.noise_count), diagnosis.located.taxels.jumps)
    static = Hypothesis(group.evidence, ()).fit()
    every = candidates(insole.excitation)
    return diagnosis, nulls(group.evidence, static, every)


def test_what_is_there_stands_far_outside(tmp_path):
    _, made = found(write(tmp_path / "solid", relaxing(0.3, 0.8), seconds=60.0))
    assert len(made.gains) == N_NULLS
    assert made.gains.max() < 0.1 < 0.9 < made.observed
    assert made.p_value == pytest.approx(1 / (1 + N_NULLS))


def test_what_is_not_there_gives_no_more_than_noise_does(tmp_path):
    _, made = found(write(tmp_path / "null", seconds=60.0))
    assert made.observed < 3 * made.gains.max()
    assert made.gains.max() < 0.05


def test_nulls_are_the_same_each_time_and_as_often_beyond_as_they_should_be(tmp_path):
    diagnosis, _ = found(write(tmp_path / "null", seconds=60.0))
    insole = diagnosis.insole
    group = gather(Taxels(diagnosis.observed, insole.slots, insole.noise_count), diagnosis.located.taxels.jumps)
    evidence, every = group.evidence, candidates(insole.excitation)
    clean = Hypothesis(evidence, ()).fit()
    std = np.sqrt(np.mean(clean.residual**2, axis=0))
    rng = np.random.default_rng(3)
    p_values = []
    for _ in range(20):
        drawn = evidence.of(evidence.y - clean.residual + std * rng.standard_normal(evidence.y.shape))
        p_values.append(nulls(drawn, Hypothesis(drawn, ()).fit(), every).p_value)
    assert nulls(drawn, Hypothesis(drawn, ()).fit(), every).p_value == p_values[-1]
    assert min(p_values) > 0.005
    assert 0.2 < np.mean(p_values) < 0.8
