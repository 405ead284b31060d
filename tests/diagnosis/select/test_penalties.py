"""What a term has to explain beside others, where the load is known on every taxel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad, LoadEstimate
from insole_daemon.diagnosis.model.blocks import BlockDesign, block_design
from insole_daemon.diagnosis.model.design import design as wrench_design
from insole_daemon.diagnosis.model.solve import solve_companions
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.select.block_penalties import BlockPenalties
from insole_daemon.diagnosis.select.wrench_penalties import WrenchPenalties

from ..chamber import Array, relaxing, write
from ..foot.shoe import write as write_walk


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> BlockDesign:
    def warm(t_s: Array) -> Array:
        return 25.0 + 5.0 * np.sin(2 * np.pi * t_s / 30.0)

    folder = write(tmp_path_factory.mktemp("penalties") / "bag", relaxing(0.2, 2.0), seconds=40.0, temperature=warm)
    recording = insole_daemon.load(folder)
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    return block_design(KnownLoad(seen), seen.weight_variance**-0.5)


def number(design: BlockDesign, word: str, scope: str = "insole") -> int:
    return next(k for k, each in enumerate(design.candidates) if each.word == word and each.where.scope == scope)


def penalty(design: BlockDesign, shares: dict[int, Array], left: float = np.inf) -> float:
    chosen = sorted(shares)
    return BlockPenalties(design).set_penalty(
        chosen, [design.candidates[k] for k in chosen], [shares[k] for k in chosen], left
    )


def full(design: BlockDesign, k: int, share: float) -> Array:
    return np.full(len(design.candidates[k].columns), share)


@pytest.mark.parametrize(("counts", "is_possible"), [(0.5, False), (8.0, True)])
def test_a_static_effect_beside_a_large_one_needs_a_minimum_size(design, counts, is_possible):
    gain, baseline = number(design, "gain"), number(design, "baseline")
    beside = {gain: full(design, gain, 0.3), baseline: full(design, baseline, counts)}
    far_off = replace(design, y=100.0 * design.y)
    assert np.isfinite(penalty(far_off, {baseline: full(design, baseline, counts)}))
    assert np.isfinite(penalty(far_off, beside)) == is_possible


@pytest.mark.parametrize(("share", "is_possible"), [(0.3, True), (0.4, False)])
def test_a_static_effect_beside_a_memory_is_not_larger_than_what_the_calibration_leaves(design, share, is_possible):
    """Companions of the memory would cancel it."""
    gain, memory = number(design, "gain"), number(design, "viscoelasticity")
    own = full(design, memory, 0.01)
    left = replace(design, y=design.contribution(design.candidates[gain], full(design, gain, 0.3)))
    assert np.isfinite(penalty(left, {gain: full(design, gain, share), memory: own})) == is_possible
    assert np.isfinite(penalty(left, {gain: full(design, gain, share)}))
    assert not np.isfinite(penalty(left, {gain: full(design, gain, 0.7)}))


def test_the_misfit_of_a_memory_resembles_drift_more_than_temperature(design):
    memory = number(design, "viscoelasticity")
    own = full(design, memory, 0.3)

    def raised_by(word: str) -> float:
        k = number(design, word)
        tiny = full(design, k, 1e-6)
        return penalty(design, {memory: own, k: tiny}) - penalty(design, {memory: own}) - penalty(design, {k: tiny})

    assert 0.0 < raised_by("temperature") == pytest.approx(0.3 * raised_by("drift"), rel=1e-3)


def test_what_a_set_leaves_limits_the_misfit_beside_a_memory(design):
    """A second memory that leaves little beside the first is no part of what the law of the first does not describe."""
    memory = number(design, "viscoelasticity")
    noise = float(np.count_nonzero(design.weights))

    def raised_by(word: str, left: float) -> float:
        k = number(design, word)
        both = {memory: full(design, memory, 1.5), k: full(design, k, 1e-6)}
        return penalty(design, both, left) - sum(penalty(design, {j: own}) for j, own in both.items())

    assert raised_by("creep", noise) == pytest.approx(0.2 * noise, rel=1e-3)
    assert raised_by("creep", 1.5 * noise) == pytest.approx(1.0 * noise, rel=1e-3)
    assert raised_by("creep", np.inf) > 2.0 * noise
    assert raised_by("drift", noise) == pytest.approx(raised_by("drift", np.inf))


def test_a_local_term_may_explain_only_a_part_of_a_memorys_misfit(design):
    memory, on_all = number(design, "viscoelasticity"), number(design, "drift")
    own = full(design, memory, 0.3)
    places = [number(design, "drift", "triangle"), on_all]
    raised = []
    for k in places:
        tiny = full(design, k, 1e-6)
        raised.append(
            penalty(design, {memory: own, k: tiny}) - penalty(design, {memory: own}) - penalty(design, {k: tiny})
        )
    there = design.mask[design.candidates[places[0]].columns[0]]
    size = design.overlap(design.candidates[places[0]], design.candidates[memory], own)
    whole = design.overlap(design.candidates[on_all], design.candidates[memory], own)
    assert there.sum() == 1
    assert raised[0] / size == pytest.approx(0.25 * raised[1] / whole, rel=1e-3)


@pytest.mark.parametrize(("counts", "is_possible"), [(8.0, True), (-8.0, False)])
def test_two_effects_that_cancel_each_other_are_no_model(design, counts, is_possible):
    baseline, drift = number(design, "baseline"), number(design, "drift")
    shares = {baseline: full(design, baseline, 8.0), drift: full(design, drift, counts)}
    assert np.isfinite(penalty(replace(design, y=100.0 * design.y), shares)) == is_possible


def test_drifts_of_all_boards_may_explain_as_little_of_a_memorys_misfit_as_one_of_the_insole(design):
    memory = number(design, "viscoelasticity")
    own = full(design, memory, 0.3)
    boards = [k for k, each in enumerate(design.candidates) if (each.word, each.where.scope) == ("drift", "board")]

    def raised_by(places: list[int]) -> float:
        tiny = {k: full(design, k, 1e-6) for k in places}
        return penalty(design, {memory: own, **tiny}) - penalty(design, {memory: own}) - penalty(design, tiny)

    assert len(boards) == 3
    assert raised_by(boards) == pytest.approx(raised_by([number(design, "drift")]), rel=1e-3)
    assert sum(raised_by([k]) for k in boards) == pytest.approx(0.25 * raised_by(boards), rel=1e-3)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    recording = insole_daemon.load(write_walk(tmp_path_factory.mktemp("walk") / "walk", seconds=20.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    return seen


def test_a_term_of_a_walk_exceeds_the_misfit_of_the_memories_that_were_undone(walk):
    weights, substituted = walk.weight_variance**-0.5, np.zeros(len(walk.arms), bool)
    undone = replace(walk, undone=frozenset({"creep"}), undone_change=0.2 * walk.wrench)
    plain, read = (wrench_design(LoadEstimate(each), weights, substituted) for each in (walk, undone))
    k = next(k for k, one in enumerate(plain.candidates) if one.word == "crosstalk")
    crosstalk, columns = plain.candidates[k], plain.candidates[k].columns

    def raised_by(share: float) -> float:
        shares = np.full(len(columns), share)
        of_read, of_plain = (
            WrenchPenalties(each).set_penalty([k], [crosstalk], [shares], 0.0) for each in (read, plain)
        )
        return float(of_read - of_plain)

    assert read.undone > 0.0 == plain.undone
    assert raised_by(1e3) == pytest.approx(0.05 * read.undone)
    small = np.full(len(columns), 1e-3)
    assert raised_by(1e-3) == pytest.approx(float(small @ plain.gram[np.ix_(columns, columns)] @ small))
    timing_alone, timing = (WrenchPenalties(each).timing_penalty((), (), np.inf) for each in (plain, read))
    assert timing - timing_alone == pytest.approx(0.05 * read.undone)


def test_what_the_companions_of_a_term_explain_may_be_a_misfit_too(walk):
    undone = replace(walk, undone=frozenset({"creep"}), undone_change=100.0 * walk.wrench)
    plain, read = (
        wrench_design(
            LoadEstimate(each), each.weight_variance**-0.5, np.zeros(len(each.arms), bool)
        ).without_companions(("mean_curve",))
        for each in (walk, undone)
    )
    k = next(k for k, one in enumerate(plain.candidates) if one.word == "creep")
    creep = plain.candidates[k]
    shares = [np.full(len(creep.columns), 1e-3)]
    of_read, of_plain = (WrenchPenalties(each).set_penalty([k], [creep], shares, 0.0) for each in (read, plain))
    companions, coefficients = solve_companions(plain, [creep], shares)
    columns = np.concatenate([creep.columns, companions])
    coefficient = np.concatenate([*shares, coefficients])
    assert np.abs(coefficients).max() > 0.0
    assert of_read - of_plain == pytest.approx(coefficient @ plain.gram[np.ix_(columns, columns)] @ coefficient)


def test_a_delay_of_a_walk_describes_at_most_half_of_a_misfit(walk):
    design = wrench_design(LoadEstimate(walk), walk.weight_variance**-0.5, np.zeros(len(walk.arms), bool))
    crosstalk = next(one for one in design.candidates if one.word == "crosstalk")
    columns = crosstalk.columns
    shares = np.full(len(columns), np.sqrt(100.0 * design.noise / design.gram[np.ix_(columns, columns)].sum()))
    penalties = WrenchPenalties(design)

    def raised_by(left: float) -> float:
        return penalties.timing_penalty([crosstalk], [shares], left) - penalties.timing_penalty((), (), left)

    misfit = crosstalk.term.misfit * 100.0 * design.noise
    assert raised_by(10.0 * design.noise) == pytest.approx(misfit)
    assert raised_by(1.5 * design.noise) == pytest.approx(0.5 * design.noise)
    assert raised_by(0.5 * design.noise) == pytest.approx(0.1 * design.noise)


def test_a_lag_of_a_walk_exceeds_the_whole_misfit_of_a_viscoelasticity(walk):
    design = wrench_design(LoadEstimate(walk), walk.weight_variance**-0.5, np.zeros(len(walk.arms), bool))
    memory = next(one for one in design.candidates if one.word == "viscoelasticity")
    size = design.gram[np.ix_(memory.columns, memory.columns)].sum()
    shares = np.full(len(memory.columns), np.sqrt(100.0 * design.noise / size))
    penalties = WrenchPenalties(design)
    alone = penalties.timing_penalty((), (), design.noise)
    misfit = memory.term.misfit * 100.0 * design.noise
    assert penalties.timing_penalty([memory], [shares], design.noise) - alone == pytest.approx(misfit)
