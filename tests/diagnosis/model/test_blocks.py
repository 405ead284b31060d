"""Designs that are derived from others without computing all columns again."""

from __future__ import annotations

import gc
import weakref
from dataclasses import fields, replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.nuisance import Priors
from insole_daemon.diagnosis.observations.wrench import CLOCK_INDEPENDENT
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.terms import hysteresis

from ..chamber import write


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("chamber") / "bag", seconds=40.0))
    (found,) = observed([recording], recording.feet, None, lambda text: None, ())
    return found


@pytest.fixture(scope="module")
def design(seen):
    return block_design(KnownLoad(seen), seen.weight_variance**-0.5)


def assert_like(one, other) -> None:
    """Asserts that two designs of the same candidates have the same inner products, to single precision."""
    grams, crosses = [], []
    size = np.sqrt(other.gram.diagonal()[columns_of(other)])
    for each in (one, other):
        columns = columns_of(each)
        grams.append(each.gram[np.ix_(columns, columns)] / size / size[:, None])
        crosses.append(each.cross[columns] / size / np.sqrt(each.total))
    assert grams[0] == pytest.approx(grams[1], abs=1e-3)
    assert crosses[0] == pytest.approx(crosses[1], abs=1e-3)
    assert one.total == pytest.approx(other.total, rel=1e-6)


def columns_of(design):
    """Return the columns of all candidates and their companions, in the order of the candidates."""
    return np.concatenate([[*each.columns, *each.companions] for each in design.candidates]).astype(int)


def number(design, word: str) -> int:
    """Return the number of the first candidate of the whole insole with this word."""
    return next(k for k, c in enumerate(design.candidates) if c.word == word and c.where.scope == "insole")


def test_changing_priors_equals_a_new_design_with_them(design, seen):
    priors = Priors(0.015, 0.06)
    again = design.under(priors)
    made = block_design(KnownLoad(seen), seen.weight_variance**-0.5, priors)
    assert again.nuisance.log_determinant == pytest.approx(made.nuisance.log_determinant)
    chosen = [number(design, word) for word in ("hysteresis", "gain", "drift")]
    assert_like(again.subset(chosen), made.subset(chosen))


def test_a_subset_has_the_inner_products_of_the_whole_design(design):
    chosen = [number(design, word) for word in ("viscoelasticity", "baseline")]
    assert_like(design.subset(chosen), replace(design, candidates=tuple(design.candidates[k] for k in chosen)))


def test_an_exchanged_setting_equals_an_added_one(design):
    k = number(design, "snap")
    setting = {"up_pa": 90e3, "down_pa": 55e3}
    exchanged = design.subset([number(design, "hysteresis"), k]).exchanged(1, setting)
    added = design.with_settings([(k, setting)])
    assert_like(exchanged, added.subset([number(design, "hysteresis"), len(added.candidates) - 1]))


def test_amplitudes_scale_the_columns_of_memories_in_each_triangle_and_laws_have_none(design):
    chosen = [number(design, word) for word in ("hysteresis", "gain", "creep")]
    amplitudes = np.linspace(0.8, 1.3, len(design.seen.layout))
    alike = design.subset(chosen)
    uneven = design.with_amplitudes(amplitudes).subset(chosen)
    for one, other in zip(alike.candidates, uneven.candidates, strict=True):
        shares = np.ones(len(one.columns))
        factor = amplitudes[:, None] if one.term.is_memory else 1.0
        expected = factor * alike.contribution(one, shares)
        assert uneven.contribution(other, shares) == pytest.approx(expected, rel=1e-4)
    creep = uneven.candidates[chosen.index(number(design, "creep"))]
    rows = uneven.rows_of(creep.columns).astype(float)
    by_rows = np.einsum("tkn,tn->k", rows, uneven.nuisance.residual_of(uneven.y))
    shared = uneven._with_shared[creep.columns] @ uneven.nuisance.shared_inverse @ uneven._y_with_shared
    assert uneven.cross[creep.columns] == pytest.approx(by_rows - shared, rel=1e-3, abs=1e-3 * np.abs(by_rows).max())
    assert_like(uneven.of_laws(), alike.of_laws())


def test_a_design_that_forgot_its_load_has_few_arrays_of_it_and_makes_the_same_columns(seen):
    own = replace(seen)
    design = block_design(KnownLoad(own), own.weight_variance**-0.5)
    k, setting = number(design, "gain"), {"more": 0.05}
    before = design.subset([k]).exchanged(0, setting)
    assert "usual_slope_pa" in vars(own)
    design.forget_load()
    assert vars(own).keys() - {field.name for field in fields(own)} <= set(CLOCK_INDEPENDENT)
    assert vars(design.load).keys() == {field.name for field in fields(design.load)}
    assert_like(design.subset([k]).exchanged(0, setting), before)


def test_loads_along_the_signal_path_share_the_slopes_of_the_curves(seen):
    changes = tuple((order, np.full((len(seen.t_s), len(seen.layout), 1), 1e3)) for order in (2, 5))
    load = KnownLoad(seen, changes)
    assert load.before(4).slope_pa is load.slope_pa
    predicted = replace(load, predicted_count=seen.activation_count + 5.0)
    assert not np.allclose(predicted.slope_pa, load.slope_pa)


def test_a_design_frees_the_loads_along_the_signal_path_after_their_last_term(seen):
    changes = tuple((order, np.full((len(seen.t_s), len(seen.layout), 1), 1e3)) for order in (2, 5))
    load = KnownLoad(seen, changes)
    changed = weakref.ref(load.before(hysteresis.TERM.order))
    block_design(load, seen.weight_variance**-0.5)
    assert changed() is None


def test_a_load_is_freed_with_its_last_reference(seen):
    load = KnownLoad(seen)
    assert load.before(3) is load.unchanged
    known = weakref.ref(load)
    gc.disable()
    try:
        del load
        assert known() is None
    finally:
        gc.enable()


def test_what_the_rows_leave_without_a_term_is_that_of_a_design_of_the_same_curves(seen, design):
    """Curves of a fifth less pressure leave more."""
    flatter = seen.with_curves(0.8 * seen.calibration.coefficients_pa)
    assert design.unexplained(seen) == pytest.approx(design.total, rel=1e-6)
    expected = block_design(KnownLoad(flatter), design.weights).total
    assert design.unexplained(flatter) == pytest.approx(expected, rel=1e-6)
    assert design.unexplained(flatter) > 1.5 * design.total
