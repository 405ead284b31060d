"""The search for the set of terms with the highest score."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad, LoadEstimate
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.design import design
from insole_daemon.diagnosis.model.regression import PlacedTerm, Regression
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.select.search import SubsetSearch, _is_a_model
from insole_daemon.diagnosis.terms import TERMS
from insole_daemon.physics.effect import Where

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


@pytest.mark.parametrize(("words", "is_model"), [(("delay", "delay"), True), (("viscoelasticity",) * 3, True),
                                                 (("delay", "lag", "viscoelasticity"), False)])  # fmt: skip
def test_boards_that_are_all_late_are_no_model_if_one_of_them_is_so_by_a_delay_or_lag(words, is_model):
    """That is a timing of the whole insole."""
    boards = [Where("board", ((address,),)) for address in (5, 6, 7)]
    by_word = {term.word: term for term in TERMS}
    terms = [
        PlacedTerm(by_word[word], where, ({},), np.array([k]), len(boards), np.empty(0, np.intp))
        for k, (word, where) in enumerate(zip(words, boards, strict=False))
    ]
    assert _is_a_model(terms) == is_model
