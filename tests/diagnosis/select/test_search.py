"""The search for the set of terms with the highest score."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad, LoadEstimate
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.design import design
from insole_daemon.diagnosis.model.regression import Regression
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.select.search import SubsetSearch

from ..chamber import relaxing
from ..chamber import write as write_chamber
from ..foot.shoe import late
from ..foot.shoe import write as write_walk


def regression_of(folder) -> Regression:
    recording = insole_daemon.load(folder)
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    weights = seen.weight_variance**-0.5
    if not seen.load_is_known:
        return design(LoadEstimate(seen), weights, np.zeros(len(seen.layout), bool))
    return block_design(KnownLoad(seen), weights)


@pytest.mark.parametrize("kind", ["chamber", "walk"])
def test_no_set_scores_more_than_the_bound_by_which_the_search_leaves_it_out(tmp_path, kind):
    if kind == "chamber":
        folder = write_chamber(tmp_path / "bag", relaxing(0.25, 1.5), seconds=40.0)
    else:
        folder = write_walk(tmp_path / "walk", lambda p: late(p, 0.05), seconds=10.0)
    search = SubsetSearch(regression_of(folder))
    best = search.run()[0].chosen
    assert best
    n_finite = 0
    for rest in {(), best, *((k,) for k in best)}:
        added = [k for k in range(0, len(search.design.candidates), 7) if k not in rest]
        for k, bound in search._by_bound(rest, added):
            score = search.fit([*rest, k]).score
            n_finite += np.isfinite(score)
            assert score <= bound + 1e-9 * search.design.total
    assert n_finite > 20
