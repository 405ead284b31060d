"""A triangle without working taxels on a walk: its load may equal that of a neighbour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import LoadEstimate
from insole_daemon.diagnosis.model.wrench_nuisance import apply_weights, nuisance_columns, project
from insole_daemon.diagnosis.observing import observed

from ..foot.shoe import write

LOST = 3


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("walk") / "walk"))
    (each,) = observed([recording], recording.feet, None, lambda text: None, ())
    return each


def kept(seen, is_wholly_substituted) -> float:
    """Return the share of a neighbour's load on the dead triangle that the nuisance columns leave."""
    load = LoadEstimate(replace(seen, is_wholly_substituted=is_wholly_substituted))
    weights = np.where(np.isfinite(seen.weight_variance), seen.weight_variance, np.inf) ** -0.5
    substituted = np.arange(len(seen.layout)) == LOST
    base = nuisance_columns(load, weights, substituted)
    neighbour_pa = load.read_pa[:, 0, seen.usable[0]].mean(axis=1)
    column = apply_weights((neighbour_pa[:, None] * seen.arms[LOST].sum(axis=0))[..., None], weights)
    return float(np.sum(project(base, column) ** 2) / np.sum(column**2))


def test_the_load_of_a_dead_triangle_may_equal_a_neighbours(seen):
    none, lost = np.zeros(len(seen.layout), bool), np.arange(len(seen.layout)) == LOST
    assert kept(seen, lost) < 0.01
    assert kept(seen, none) > 0.05
