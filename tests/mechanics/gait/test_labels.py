"""Labels of planned walks, through insoles without a flaw but for noise."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.mechanics.gait.labels import LABELS
from insole_daemon.simulation.planned_walk import PlannedWalk, plan_walk

from .walked import LAYOUTS, steps_of

PLANS = {
    "turns": ["stand 4", "walk 16", "turn left 5", "walk 16", "turn right 5", "walk 16", "stand 3"],
    "stumble": ["stand 4", "walk 22", "stumble", "walk 22", "stand 3"],
    "standing": ["stand 5", "walk 12", "stand 5", "walk 12", "stand 3"],
    "one leg": ["lift left 5", "walk 16", "lift right 5", "walk 16", "stand 3"],
}


def labelled(kinds, seed):
    """(planned label, found label) of every stance."""
    plan = list(plan_walk(kinds, seed))
    steps = steps_of(PlannedWalk(list(LAYOUTS.values()), plan, seed=seed), plan[-1].toe_off_s + 2.0, noise_pa=6000.0)
    pairs = []
    for stance in plan:
        same = (steps["foot"] == stance.foot) & (np.abs(steps["contact_s"] - stance.contact_s) < 0.2)
        pairs.append((stance.label, str(steps["label"][same][0]) if same.any() else "none"))
    return pairs, len(steps)


@pytest.mark.parametrize("name", PLANS)
def test_labels_of_a_planned_walk_are_right(name):
    pairs, n_steps = zip(*(labelled(PLANS[name], seed) for seed in range(3)), strict=True)
    all_pairs = [pair for walk in pairs for pair in walk]
    assert sum(n_steps) == len(all_pairs), "no stance that is not there"
    assert np.mean([planned == assigned for planned, assigned in all_pairs]) >= 0.95, [
        p for p in all_pairs if p[0] != p[1]
    ]
    assert {assigned for _, assigned in all_pairs} <= set(LABELS)


def test_means_use_only_steady_steps():
    plan = list(plan_walk(PLANS["turns"], 1))
    steps = steps_of(PlannedWalk(list(LAYOUTS.values()), plan, seed=1), plan[-1].toe_off_s + 2.0)
    planned = sum(stance.label == "steady" for stance in plan)
    assert len(steps.steady) == pytest.approx(planned, abs=3)
    assert len(steps.steady) < len(steps)
