"""Terms act on the load as the terms before them on the signal path have changed it."""

from __future__ import annotations

import weakref
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad, TaxelLoad
from insole_daemon.diagnosis.model.atoms import make_atoms
from insole_daemon.diagnosis.model.blocks import BlockDesign, block_design
from insole_daemon.diagnosis.model.regression import Timing
from insole_daemon.diagnosis.model.signal_path import Changes, load_changes, pressure_removed
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.operators import low_pass, relay
from insole_daemon.diagnosis.select.ordered_search import on_signal_path
from insole_daemon.diagnosis.select.search import FittedSet, SubsetSearch
from insole_daemon.diagnosis.select.timing_search import TimingFit
from insole_daemon.physics.law import Array

from ..chamber import relaxing, write

UP_PA, DOWN_PA, STEP_PA = 120e3, 60e3, 25e3


@pytest.fixture(scope="module")
def design(tmp_path_factory):
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("chamber") / "bag", seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    return block_design(KnownLoad(seen), seen.weight_variance**-0.5)


def candidate(design, word: str):
    """Return the first candidate of the whole insole with this word."""
    return next(c for c in design.candidates if c.word == word and c.where.scope == "insole")


def test_a_memory_acts_on_the_load_that_a_snap_before_it_has_changed(design):
    snap = candidate(design, "snap")
    snap = replace(snap, settings=({"up_pa": UP_PA, "down_pa": DOWN_PA},))
    changes = load_changes(design, [(snap, np.array([STEP_PA / 1e3]))])
    load = KnownLoad(design.seen, changes)
    pressure = design.load.courses_pa[:, 0]
    felt = pressure + STEP_PA * relay(pressure, UP_PA, DOWN_PA)
    viscoelasticity = candidate(design, "viscoelasticity").term
    block = next(iter(viscoelasticity.placed_columns(load)))
    late = felt - low_pass(felt, design.seen.step_s, block.settings[0]["tau_s"])
    assert block.by_triangle[:, 0, 0, 0] == pytest.approx(late[:, 0], abs=1.0)


def test_a_snap_acts_on_the_load_before_the_memory_behind_it(design):
    viscoelasticity = candidate(design, "viscoelasticity")
    changes = load_changes(design, [(viscoelasticity, np.array([0.2, 0.2]))])
    load = KnownLoad(design.seen, changes)
    assert load.before(candidate(design, "snap").term.order) is load.unchanged
    assert load.before(candidate(design, "stiffening").term.order) is not load.unchanged


def test_a_term_that_the_set_under_the_changed_load_lacks_changes_no_load(tmp_path):
    """A set with a false snap: under the load as this would change it, the search finds a set without it."""
    recording = insole_daemon.load(write(tmp_path / "bag", lambda t_s, p: 0.8 * p, seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())

    def make(timing: Timing, changes: Changes) -> BlockDesign:
        return block_design(KnownLoad(seen, changes), seen.weight_variance**-0.5)

    search = SubsetSearch(make(Timing(), ()))
    candidates = search.design.candidates
    k = next(k for k, term in enumerate(candidates) if term.word == "snap" and term.where.scope == "insole")
    best = FittedSet((k,), (np.array([STEP_PA / 1e3]),), gain=0.0, score=-1e12)
    first = TimingFit((), Timing(), criterion=1e12, left=1e12, n_terms=1, search=search, best=best)
    assert on_signal_path(first, first, make) is None


def test_a_design_is_freed_before_that_without_the_terms_that_its_set_lacks_is_made(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", relaxing(0.3, 0.8), seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    made: list[weakref.ref[Array]] = []

    def make(timing: Timing, changes: Changes) -> BlockDesign:
        assert all(columns() is None for columns in made)
        design = block_design(KnownLoad(seen, changes), seen.weight_variance**-0.5)
        made.append(weakref.ref(design.nuisance.own))
        return design

    search = SubsetSearch(block_design(KnownLoad(seen), seen.weight_variance**-0.5))
    candidates = search.design.candidates
    at_insole = [k for k, term in enumerate(candidates) if term.where.scope == "insole"]
    k, other = (next(k for k in at_insole if candidates[k].word == word) for word in ("snap", "viscoelasticity"))
    shares = (np.array([STEP_PA / 1e3]), np.full(len(candidates[other].columns), 0.1))
    best = FittedSet((k, other), shares, gain=0.0, score=-1e12)
    first = TimingFit((), Timing(), criterion=1e12, left=1e12, n_terms=2, search=search, best=best)
    assert on_signal_path(first, first, make) is not None
    assert len(made) == 2


def test_columns_joined_to_others_have_the_inner_products_of_all_together(design):
    term = candidate(design, "hysteresis").term
    first = term.columns(design.load)
    second = list(islice(candidate(design, "viscoelasticity").term.columns(design.load), 2))
    joined = make_atoms(second, design.weights, design.nuisance, make_atoms(first, design.weights, design.nuisance))
    whole = make_atoms([*first, *second], design.weights, design.nuisance)
    every = np.arange(whole.product.shape[1])
    assert np.array_equal(joined.columns(every), whole.columns(every))
    for name in ("with_own", "gram", "shared"):
        expected = getattr(whole, name)
        assert getattr(joined, name) == pytest.approx(expected, rel=1e-3, abs=1e-5 * float(np.abs(expected).max()))


@pytest.mark.parametrize("word", ["hysteresis", "creep", "viscoelasticity"])
def test_of_single_taxels_only_the_columns_with_a_share_are_computed(design, word):
    of_taxels, term = TaxelLoad(design.seen), candidate(design, word)
    (every,) = [block for block in term.term.columns(of_taxels) if block.settings == term.settings]
    shares = np.zeros(len(term.settings))
    shares[[1, -1]] = 0.3, 0.2
    expected = every.by_triangle @ shares
    assert np.abs(expected).max() > 0.0
    assert pressure_removed(design, of_taxels, term, shares) == pytest.approx(expected, rel=1e-5, abs=1e-2)
    few = list(term.term.columns(replace(of_taxels, only=(term.settings[1],))))
    assert {len(block.settings) for block in few} == {1}
