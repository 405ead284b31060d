"""Single taxels against their neighbours: what is dead, stuck or saturated, from which look on, and when it heals."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import ceil

import numpy as np
import pytest

from insole_daemon.compiled import kernel
from insole_daemon.config import Board
from insole_daemon.skin.faults import taxels
from insole_daemon.skin.faults.places import Places
from insole_daemon.skin.faults.rest import ENOUGH_LEARNED, TOP_MARGIN, Rest
from insole_daemon.skin.faults.taxels import (
    CONTRAST_COUNT,
    EVIDENCE_COUNT,
    IDLE_COUNT,
    LOADED_COUNT,
    ONE_LOOK_COUNT,
    SATURATED_NS,
    SHARE,
    SHARP,
    UNSATURATED_NS,
    TaxelFaults,
    TaxelState,
)
from insole_daemon.skin.layout import Triangle, of

from ...implementations import numpy_and_compiled

implementation = numpy_and_compiled(taxels)

DEAD, STUCK, SATURATED = TaxelState.DEAD, TaxelState.STUCK, TaxelState.SATURATED

Taxel = tuple[int, int]  # row of the layout, pad
Counts = Mapping[Taxel, float]

NO_LOAD = 240
BOTTOM, TOP = float(NO_LOAD), float(NO_LOAD - 255)  # activations on the rails
LOOK_NS = 40_000_000
YEAR_NS = 365 * 86_400_000_000_000 + 1  # more than a float tells to the nanosecond
LOAD = 20.0
A_BIT = 1 / 16  # which a float says exactly

BOARDS = (7, 5, 7, 5)  # by row; the last two stand base to base, the others far from all
TRIANGLES = tuple(
    Triangle(board=board, triangle=row, patch="any", x_mm=x, y_mm=y, rotation_deg=turn)
    for row, (board, x, y, turn) in enumerate(
        zip(BOARDS, (200, 200, 50, 50), (-60, 60, 0, -19.32), (30, 250, 0, 180), strict=True)
    )
)
PADS = (0, 1, 2, 3, 4, 5, 7, 8, 9, 11)
AROUND = {0: (1, 2, 3, 11), 2: (0, 1, 3, 4), 4: (2, 3, 5, 7), 7: (3, 4, 5, 8), 8: (3, 7, 9, 11), 11: (0, 3, 8, 9)}
PLACES = {(row, pad): len(PADS) * row + n for row in range(len(BOARDS)) for n, pad in enumerate(PADS)}
FAR = (1, 4)  # on another board and another triangle than what is examined
ONE = (0, 2)
ITS_NEIGHBOURS = [(0, pad) for pad in AROUND[2]]

whenever_it_began = pytest.mark.parametrize("t_ns", [0, YEAR_NS])
# The same must come out whether all taxels are there to be judged by, or one far away is not.
somebody_missing = pytest.mark.parametrize("missing", [(), (FAR,)], ids=["all live", "one not live"])


class Foot:
    """Two boards at rest on NO_LOAD, looked at from `t_ns` on; the levels of the boards in `learned` are learned."""

    def __init__(self, learned: Collection[int] = (7, 5), no_load: int = NO_LOAD, t_ns: int = 0) -> None:
        boards = {a: Board(address=a, interface="can0", no_load=no_load, shift=0) for a in (5, 7)}
        places = Places(of("left", 32.4e-6, None, TRIANGLES), boards)
        self.rest = Rest(places)
        self.faults = TaxelFaults(places, self.rest)
        self.no_load = no_load
        self.t_ns = t_ns
        self.rest.update(np.full(len(PLACES), no_load, np.float32))
        for _ in range(ENOUGH_LEARNED):
            self.rest.learn(np.ones(len(PLACES), bool), np.isin(places.addresses, list(learned)))

    def look(self, activation: Counts, missing: Collection[Taxel] = (), after_ns: int = LOOK_NS) -> bool:
        """Look at `activation` in counts, 0 elsewhere, all live but `missing`; whether a state changed."""
        counts = np.full(len(PLACES), self.no_load, np.float32)
        live = np.ones(len(PLACES), bool)
        for taxel, count in activation.items():
            counts[PLACES[taxel]] -= count
        for taxel in missing:
            live[PLACES[taxel]] = False
        self.t_ns += after_ns
        self.rest.update(counts)
        return self.faults.update(counts, live, self.t_ns)

    def looks(self, n: int, activation: Counts, missing: Collection[Taxel] = ()) -> list[bool]:
        return [self.look(activation, missing) for _ in range(n)]

    @property
    def states(self) -> dict[Taxel, TaxelState]:
        """Of those that are not well."""
        return {
            taxel: TaxelState(state) for taxel, state in zip(PLACES, self.faults.state.tolist(), strict=True) if state
        }


def pressed(*rows: int, by: float = LOAD) -> dict[Taxel, float]:
    return {(row, pad): by for row in rows for pad in PADS}


def changes_at(look: int, of_looks: int) -> list[bool]:
    """What `looks` says if a state changes at look number `look` alone."""
    return [n == look for n in range(1, of_looks + 1)]


def looks_for(says: float, evidence: float = EVIDENCE_COUNT) -> int:
    """How many looks that say so much each it takes."""
    return ceil(evidence / says)


DEAD_UNDER_LOAD = {**pressed(0), ONE: 0.0}
STUCK_ALONE = {ONE: CONTRAST_COUNT + ONE_LOOK_COUNT}
FULL = looks_for(ONE_LOOK_COUNT)


# ---- of all


@pytest.mark.parametrize("load", [0, 1, LOADED_COUNT, LOAD, NO_LOAD - 1, TOP + 1])
@somebody_missing
def test_an_even_load_of_any_size_is_no_fault(load: float, missing: Collection[Taxel]) -> None:
    foot = Foot()
    assert not any(foot.looks(30, pressed(0, 1, 2, 3, by=load), missing))
    assert foot.states == {}


@pytest.mark.parametrize("activation", [DEAD_UNDER_LOAD, STUCK_ALONE, {ONE: BOTTOM}, {ONE: TOP}])
def test_taxels_that_are_not_live_are_not_judged(activation: Counts) -> None:
    foot = Foot()
    assert foot.looks(30, activation, missing=[ONE]) == [False] * 30
    assert foot.states == {}


@pytest.mark.parametrize("state", [DEAD, STUCK])
def test_only_taxels_of_known_rest_level_are_compared(state: TaxelState) -> None:
    foot = Foot(learned=[7])
    both = {DEAD: {**pressed(0, 1), ONE: 0.0, FAR: 0.0}, STUCK: {ONE: 10.0, FAR: 10.0}}[state]
    foot.looks(30, both)
    assert foot.states == {ONE: state}


def test_a_taxel_of_unknown_rest_level_can_be_saturated() -> None:
    foot = Foot(learned=[7])
    foot.looks(2, {FAR: BOTTOM})
    assert foot.states == {FAR: SATURATED}


@pytest.mark.parametrize("pad", AROUND)
@pytest.mark.parametrize("row", [0, 1])
def test_the_four_nearest_are_its_neighbours(row: int, pad: int) -> None:
    around = {(row, near): LOAD for near in AROUND[pad]}
    for unloaded in around:
        foot = Foot()
        foot.looks(FULL, {**around, unloaded: 0.0})
        assert (row, pad) not in foot.states
    foot = Foot()
    foot.looks(FULL, around)
    assert foot.states == {(row, pad): DEAD}


def test_neighbours_may_be_on_another_triangle_and_board() -> None:
    foot = Foot()
    foot.looks(FULL, {(2, 0): LOAD, (2, 2): LOAD, (3, 4): LOAD, (3, 5): LOAD})
    assert foot.states == {(2, 1): DEAD}


# ---- dead


@pytest.mark.parametrize(
    ("load", "own", "says"),
    [
        (LOAD, 0, ONE_LOOK_COUNT),
        (LOAD, -10, ONE_LOOK_COUNT),
        (LOAD, SHARE * LOAD - 2.25, 2.25),
        (LOAD, SHARE * LOAD - 0.75, 0.75),
        (LOADED_COUNT, 0, SHARE * LOADED_COUNT),
    ],
)
@somebody_missing
def test_a_taxel_with_less_than_a_share_of_its_neighbours_load_is_dead(
    load: float, own: float, says: float, missing: Collection[Taxel]
) -> None:
    foot = Foot()
    assert foot.looks(20, {**pressed(0, by=load), ONE: own}, missing) == changes_at(looks_for(says), 20)
    assert foot.states == {ONE: DEAD}


@pytest.mark.parametrize(("load", "own"), [(LOAD, SHARE * LOAD + A_BIT), (LOADED_COUNT - A_BIT, 0)])
@somebody_missing
def test_a_share_or_neighbours_hardly_loaded_make_no_dead_taxel(
    load: float, own: float, missing: Collection[Taxel]
) -> None:
    foot = Foot()
    assert not any(foot.looks(60, {**pressed(0, by=load), ONE: own}, missing))


@pytest.mark.parametrize("least", ITS_NEIGHBOURS)
@somebody_missing
def test_the_least_loaded_neighbour_decides(least: Taxel, missing: Collection[Taxel]) -> None:
    foot = Foot()
    foot.looks(30, {**DEAD_UNDER_LOAD, least: LOADED_COUNT - A_BIT}, missing)
    assert foot.states == {}
    activation = {**DEAD_UNDER_LOAD, least: LOADED_COUNT}
    assert foot.looks(10, activation, missing) == changes_at(looks_for(SHARE * LOADED_COUNT), 10)


def test_dead_taxels_are_detected_one_by_one() -> None:
    foot = Foot()
    foot.looks(FULL, {**pressed(0, 1), ONE: 0.0, FAR: 0.0})
    assert foot.states == {ONE: DEAD, FAR: DEAD}


def test_evidence_for_a_dead_taxel_is_kept_while_its_neighbours_are_unloaded() -> None:
    foot = Foot()
    foot.looks(FULL - 1, DEAD_UNDER_LOAD)
    foot.looks(10, {})
    foot.looks(10, pressed(1))
    assert foot.states == {}
    assert foot.look(DEAD_UNDER_LOAD)


def test_a_dead_taxel_is_healthy_again_once_the_evidence_is_gone() -> None:
    foot = Foot()
    foot.looks(20, DEAD_UNDER_LOAD)
    bears = {**pressed(0), ONE: SHARE * LOAD + 2.5}
    assert foot.looks(10, bears) == changes_at(looks_for(2.5), 10)
    assert foot.states == {}


def test_a_dead_taxel_stays_dead_while_nothing_loads_its_neighbours() -> None:
    foot = Foot()
    foot.looks(FULL, DEAD_UNDER_LOAD)
    foot.looks(50, {})
    assert foot.states == {ONE: DEAD}


# ---- stuck


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("beside", "contrast", "says"),
    [
        (0, CONTRAST_COUNT + 0.5, 0.5),
        (0, CONTRAST_COUNT + 2, 2),
        (0, 100, ONE_LOOK_COUNT),
        (IDLE_COUNT / 2, CONTRAST_COUNT + 2, 2),
        (IDLE_COUNT, CONTRAST_COUNT + 2, 2),
        (IDLE_COUNT + 1, CONTRAST_COUNT + SHARP + 2, 2),
        (-IDLE_COUNT - 1, CONTRAST_COUNT + SHARP + 2, 2),
    ],
)
@somebody_missing
def test_a_taxel_far_above_or_below_its_neighbours_is_stuck(
    sign: int, beside: float, contrast: float, says: float, missing: Collection[Taxel]
) -> None:
    foot = Foot()
    stuck = {**pressed(1), **pressed(0, by=beside), ONE: beside + sign * contrast}
    assert foot.looks(20, stuck, missing) == changes_at(looks_for(says), 20)
    assert foot.states == {ONE: STUCK}


@pytest.mark.parametrize(
    ("beside", "contrast"),
    [
        (0, CONTRAST_COUNT),
        (IDLE_COUNT, CONTRAST_COUNT),
        (IDLE_COUNT + A_BIT, CONTRAST_COUNT + SHARP * A_BIT),
        (IDLE_COUNT + 2, CONTRAST_COUNT + 2 * SHARP),
    ],
)
@somebody_missing
def test_a_contrast_that_a_cover_permits_is_not_stuck(
    beside: float, contrast: float, missing: Collection[Taxel]
) -> None:
    foot = Foot()
    assert not any(foot.looks(60, {**pressed(0, by=beside), ONE: beside + contrast}, missing))


@pytest.mark.parametrize("highest", ITS_NEIGHBOURS)
@pytest.mark.parametrize("sign", [1, -1])
@somebody_missing
def test_the_contrast_is_to_the_mean_of_the_neighbours_and_the_highest_says_how_sharp_a_load_is(
    highest: Taxel, sign: int, missing: Collection[Taxel]
) -> None:
    foot = Foot()
    around = {**pressed(1), highest: sign * (IDLE_COUNT + 0.25)}
    no_more = around[highest] / 4 + CONTRAST_COUNT + SHARP * 0.25
    assert not any(foot.looks(60, {**around, ONE: no_more}, missing))
    assert foot.looks(10, {**around, ONE: no_more + 2}, missing) == changes_at(looks_for(2), 10)


def test_stuck_taxels_are_detected_one_by_one() -> None:
    foot = Foot()
    foot.looks(FULL, {ONE: 10.0, FAR: -10.0})
    assert foot.states == {ONE: STUCK, FAR: STUCK}


def test_one_wrong_frame_now_and_then_is_not_stuck() -> None:
    foot = Foot()
    for _ in range(20):
        assert not foot.look({ONE: 200.0})
        foot.looks(looks_for(CONTRAST_COUNT, ONE_LOOK_COUNT), {})
    assert foot.states == {}


@pytest.mark.parametrize("own", [0, CONTRAST_COUNT - 2])
def test_a_stuck_taxel_heals_once_it_rests_with_its_neighbours(own: float) -> None:
    foot = Foot()
    foot.looks(20, STUCK_ALONE)
    assert foot.looks(10, {ONE: own}) == changes_at(looks_for(CONTRAST_COUNT - own), 10)
    assert foot.states == {}


@pytest.mark.parametrize("load", [IDLE_COUNT + A_BIT, LOAD])
def test_under_load_a_stuck_taxel_does_not_heal_among_the_counts_of_its_neighbours(load: float) -> None:
    foot = Foot()
    foot.looks(FULL, STUCK_ALONE)
    healing = looks_for(CONTRAST_COUNT)
    foot.looks(healing - 1, {})
    assert not any(foot.looks(50, pressed(0, by=load)))
    assert foot.states == {ONE: STUCK}
    assert foot.look({})


def test_under_load_evidence_for_a_stuck_taxel_accumulates() -> None:
    foot = Foot()
    foot.looks(FULL, STUCK_ALONE)
    healing = looks_for(CONTRAST_COUNT)
    foot.looks(healing - 1, {})
    foot.looks(looks_for(0.5), {**pressed(0, by=IDLE_COUNT + 1), ONE: IDLE_COUNT + 1 + CONTRAST_COUNT + SHARP + 0.5})
    assert foot.looks(10, {}) == changes_at(healing, 10)


def test_under_load_evidence_for_a_taxel_not_yet_stuck_decays() -> None:
    foot = Foot()
    foot.looks(FULL - 1, STUCK_ALONE)
    foot.look(pressed(0))
    assert foot.looks(10, STUCK_ALONE) == changes_at(FULL, 10)


def test_a_stuck_taxel_heals_beside_neighbours_that_are_just_idle() -> None:
    foot = Foot()
    foot.looks(FULL, STUCK_ALONE)
    foot.looks(looks_for(CONTRAST_COUNT), pressed(0, by=IDLE_COUNT))
    assert foot.states == {}


def test_a_distant_fault_does_not_keep_the_evidence_for_a_stuck_taxel() -> None:
    foot = Foot()
    foot.looks(FULL, {FAR: 10.0})
    foot.looks(FULL - 1, {FAR: 10.0, **STUCK_ALONE})
    foot.look({FAR: 10.0, **pressed(0)})
    assert foot.looks(10, {FAR: 10.0, **STUCK_ALONE}) == changes_at(FULL, 10)


@pytest.mark.parametrize(("fault", "well"), [(DEAD_UNDER_LOAD, pressed(0)), (STUCK_ALONE, {})])
def test_taxels_that_are_not_live_do_not_become_healthy(fault: Counts, well: Counts) -> None:
    foot = Foot()
    foot.looks(FULL, fault)
    assert not any(foot.looks(20, well, missing=[ONE]))
    assert [*foot.states] == [ONE]
    assert any(foot.looks(10, well))


@pytest.mark.parametrize("fault", [DEAD_UNDER_LOAD, STUCK_ALONE])
def test_evidence_for_a_fault_is_kept_while_the_taxel_is_not_live(fault: Counts) -> None:
    foot = Foot()
    foot.looks(FULL - 1, fault)
    foot.looks(10, fault, missing=[ONE])
    foot.looks(10, pressed(0, by=1), missing=[ONE])
    assert foot.look(fault)


# ---- which neighbours count


@pytest.mark.parametrize("there", [4, 3, 2, 1, 0])
@pytest.mark.parametrize("fault", [DEAD_UNDER_LOAD, STUCK_ALONE], ids=["dead", "stuck"])
def test_two_live_neighbours_will_do(there: int, fault: Counts) -> None:
    foot = Foot()
    says = changes_at(FULL, 10) if there >= 2 else [False] * 10
    assert foot.looks(10, fault, missing=ITS_NEIGHBOURS[there:]) == says


@pytest.mark.parametrize("one", ITS_NEIGHBOURS)
@pytest.mark.parametrize("of_it", [LOAD, -LOAD / 2])
@pytest.mark.parametrize("beside", [0, IDLE_COUNT])
def test_a_neighbour_that_is_not_live_does_not_keep_a_taxel_from_being_stuck(
    one: Taxel, of_it: float, beside: float
) -> None:
    stuck = {**pressed(0, by=beside), one: of_it, ONE: beside + CONTRAST_COUNT + 0.5}
    assert Foot().looks(20, stuck, missing=[one]) == changes_at(looks_for(0.5), 20)


@pytest.mark.parametrize("one", ITS_NEIGHBOURS)
def test_a_neighbour_that_is_not_live_does_not_keep_a_taxel_from_being_dead(one: Taxel) -> None:
    assert Foot().looks(10, {**DEAD_UNDER_LOAD, one: 0.0}, missing=[one]) == changes_at(FULL, 10)


def test_a_dead_neighbour_does_not_keep_a_taxel_from_being_dead() -> None:
    foot, one = Foot(), ITS_NEIGHBOURS[0]
    foot.looks(FULL, {**pressed(0), one: 0.0})
    assert foot.looks(10, {**DEAD_UNDER_LOAD, one: 0.0}) == changes_at(FULL, 10)
    assert foot.states == {one: DEAD, ONE: DEAD}


@pytest.mark.parametrize(("level", "state"), [(LOAD, STUCK), (BOTTOM, SATURATED)])
def test_a_stuck_or_saturated_neighbour_does_not_keep_a_taxel_from_being_stuck(level: float, state: TaxelState) -> None:
    foot, one = Foot(), ITS_NEIGHBOURS[0]
    foot.looks(FULL, {one: level})
    assert foot.looks(20, {one: LOAD, ONE: CONTRAST_COUNT + 0.5}) == changes_at(looks_for(0.5), 20)
    assert foot.states == {one: state, ONE: STUCK}


# ---- saturated


@pytest.mark.parametrize("rail", [BOTTOM, TOP])
def test_a_taxel_that_stays_at_an_end_of_its_range_is_saturated(rail: float) -> None:
    foot = Foot()
    assert not foot.look({ONE: rail}, after_ns=0)
    assert not foot.look({ONE: rail}, after_ns=SATURATED_NS - 1)
    assert foot.states == {}
    assert foot.look({ONE: rail}, after_ns=1)
    assert foot.looks(20, {ONE: rail}) == [False] * 20
    assert foot.states == {ONE: SATURATED}


@pytest.mark.parametrize("near", [BOTTOM - 1, TOP + 1])
def test_a_count_before_the_rail_is_not_saturated(near: float) -> None:
    foot = Foot()
    foot.looks(10, {ONE: near})
    assert foot.states == {ONE: STUCK}


@pytest.mark.parametrize(("no_load", "states"), [(255 - TOP_MARGIN, {SATURATED}), (256 - TOP_MARGIN, set())])
def test_the_top_is_a_rail_only_where_it_is_not_the_rest_level(no_load: int, states: set[TaxelState]) -> None:
    foot = Foot(no_load=no_load)
    foot.looks(10, pressed(0, 1, 2, 3, by=no_load - 255))
    assert {*foot.states.values()} == states


@whenever_it_began
def test_saturated_taxels_are_detected_one_by_one(t_ns: int) -> None:
    foot = Foot(t_ns=t_ns)
    assert any(foot.looks(2, {ONE: BOTTOM}))
    assert not foot.look({ONE: BOTTOM, FAR: TOP}, after_ns=1)
    assert not foot.look({ONE: BOTTOM, FAR: TOP}, after_ns=SATURATED_NS - 2)
    assert foot.states == {ONE: SATURATED}
    assert foot.look({ONE: BOTTOM, FAR: TOP}, after_ns=2)
    assert foot.states == {ONE: SATURATED, FAR: SATURATED}


def test_a_taxel_that_leaves_its_rail_begins_anew() -> None:
    foot = Foot()
    foot.look({ONE: BOTTOM}, after_ns=0)
    foot.look({}, after_ns=SATURATED_NS - 1)
    assert not foot.look({ONE: BOTTOM}, after_ns=1)
    assert not foot.look({ONE: BOTTOM}, after_ns=SATURATED_NS - 2)
    assert foot.look({ONE: BOTTOM}, after_ns=2)


def test_on_a_rail_a_taxel_is_neither_stuck_nor_anybodys_neighbour() -> None:
    foot, one = Foot(), ITS_NEIGHBOURS[0]
    on_rail_soon = SATURATED_NS // 20
    for _ in range(looks_for(2)):
        foot.look({one: BOTTOM, ONE: CONTRAST_COUNT + 2}, after_ns=on_rail_soon)
    assert foot.states == {ONE: STUCK}


def test_time_on_a_rail_while_not_live_does_not_count() -> None:
    foot = Foot()
    both = {ONE: BOTTOM, FAR: BOTTOM}
    for _ in range(10):
        foot.look(both, missing=[ONE])
    assert not foot.look(both, after_ns=1)
    assert not foot.look(both, after_ns=SATURATED_NS - 2)
    assert foot.look(both, after_ns=2)


@pytest.mark.parametrize("before", [[], [ONE]], ids=["off the rail", "not live"])
def test_one_look_on_a_rail_is_not_saturated(before: Collection[Taxel]) -> None:
    foot = Foot()
    for _ in range(5):
        foot.look(dict.fromkeys(before, BOTTOM), missing=before)
    assert not foot.look({ONE: BOTTOM}, after_ns=1)


@whenever_it_began
def test_a_saturated_taxel_heals_long_after_it_was_last_on_a_rail(t_ns: int) -> None:
    foot = Foot(t_ns=t_ns)
    foot.looks(2, {ONE: BOTTOM, FAR: TOP})
    assert not foot.look({ONE: BOTTOM}, after_ns=1)
    assert not foot.look({}, after_ns=UNSATURATED_NS - 2)
    assert foot.states == {ONE: SATURATED, FAR: SATURATED}
    assert foot.look({}, after_ns=1)
    assert foot.states == {ONE: SATURATED}
    assert foot.look({}, after_ns=1)
    assert foot.states == {}
    assert not foot.look({}, after_ns=UNSATURATED_NS)


def test_a_saturated_taxel_heals_only_when_it_is_live() -> None:
    foot = Foot()
    foot.looks(2, {ONE: BOTTOM})
    assert not foot.look({}, missing=[ONE], after_ns=2 * UNSATURATED_NS)
    assert foot.states == {ONE: SATURATED}
    assert foot.look({})


@pytest.mark.parametrize("seen", [DEAD_UNDER_LOAD, STUCK_ALONE, pressed(0)])
def test_a_saturated_taxel_is_not_compared(seen: Counts) -> None:
    foot = Foot()
    foot.looks(2, {ONE: BOTTOM})
    assert foot.looks(10, seen) == [False] * 10
    assert foot.states == {ONE: SATURATED}


# ---- one after the other


@pytest.mark.parametrize(("fault", "state"), [(DEAD_UNDER_LOAD, DEAD), (STUCK_ALONE, STUCK)])
def test_a_dead_or_stuck_taxel_can_come_to_be_saturated(fault: Counts, state: TaxelState) -> None:
    foot = Foot()
    foot.looks(FULL, fault)
    assert foot.states == {ONE: state}
    foot.looks(2, {ONE: BOTTOM})
    assert foot.states == {ONE: SATURATED}


def test_a_dead_taxel_that_stands_out_is_stuck() -> None:
    foot = Foot()
    foot.looks(FULL, DEAD_UNDER_LOAD)
    assert foot.looks(10, STUCK_ALONE) == changes_at(FULL, 10)
    assert foot.states == {ONE: STUCK}


def test_a_stuck_taxel_that_bears_little_of_a_load_stays_stuck() -> None:
    foot = Foot()
    foot.looks(FULL, STUCK_ALONE)
    assert not any(foot.looks(10, {**pressed(0, by=2 * LOAD), **STUCK_ALONE}))
    assert foot.states == {ONE: STUCK}


@pytest.mark.parametrize(
    ("fault", "weakly"),
    [(DEAD_UNDER_LOAD, {**pressed(0), ONE: SHARE * LOAD - 2.4}), (STUCK_ALONE, {ONE: CONTRAST_COUNT + 2.4})],
    ids=["dead", "stuck"],
)
def test_a_recovered_triangle_is_detected_again_no_sooner_than_the_first_time(fault: Counts, weakly: Counts) -> None:
    foot = Foot()
    foot.looks(FULL - 1, fault)
    foot.looks(2, {ONE: BOTTOM})
    assert foot.look({}, after_ns=UNSATURATED_NS)
    assert foot.states == {}
    assert foot.looks(10, weakly) == changes_at(looks_for(2.4), 10)


# ---- the kernel


@pytest.mark.skipif(kernel is None, reason="this installation has no compiled kernel: tests/test_compiled.py")
@pytest.mark.parametrize("seed", range(20))
def test_the_kernel_finds_the_same_evidence_to_the_bit(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    by_numpy, by_kernel = Foot(), Foot()
    for _ in range(60):
        activation = {taxel: float(rng.normal(0, 1) + LOAD * (rng.random() < 0.6)) for taxel in PLACES}
        missing = [taxel for taxel in PLACES if rng.random() < 0.02] if rng.random() < 0.5 else []
        results = []
        for foot, implementation in ((by_numpy, None), (by_kernel, kernel)):
            with monkeypatch.context() as patch:
                patch.setattr(taxels, "kernel", implementation)
                results.append((foot.look(activation, missing), foot.states))
        assert results[0] == results[1]
        assert by_kernel.faults._for_dead.tobytes() == by_numpy.faults._for_dead.tobytes()
        assert by_kernel.faults._for_stuck.tobytes() == by_numpy.faults._for_stuck.tobytes()
