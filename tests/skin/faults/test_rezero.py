"""Detection of boards that were zeroed under load, from the load on three boards, one check after the other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from insole_daemon.config import Board
from insole_daemon.skin.faults.boards import BoardStreams
from insole_daemon.skin.faults.places import Places
from insole_daemon.skin.faults.rest import Rest
from insole_daemon.skin.faults.rezero import (
    CONFIRM_NS,
    HEALED_NS,
    HELD_UP_PERIODS,
    MIN_TAXELS,
    NEGATIVE_NS,
    PAUSE_NS,
    Rezeroed,
)
from insole_daemon.skin.layout import Triangle, of

ADDRESSES = (7, 5, 6)  # in the order of the layout, and of all that is said of boards
N_TAXELS = 40  # of each
LOOK_NS = 20_000_000
START_NS = 86_400_000_000_000
HELD_UP_NS = round(HELD_UP_PERIODS * Board(address=1, interface="can0").period_ms * 1e6)
STANDING = 8.0  # counts on every taxel
NOBODY = dict.fromkeys(ADDRESSES, 0.0)

each_board = pytest.mark.parametrize("address", ADDRESSES)


class Foot:
    """Three boards that rest at their no-load, with a triangle of each in turn."""

    def __init__(self, no_load: int = 200) -> None:
        settings = {a: Board(address=a, interface="can0", no_load=no_load, shift=0) for a in ADDRESSES}
        triangles = tuple(
            Triangle(board=address, triangle=number, patch="line", x_mm=20.0 * number, y_mm=0.0, rotation_deg=0.0)
            for number, address in enumerate(ADDRESSES * (N_TAXELS // 10))
        )
        places = Places(of("left", 32e-6, None, triangles), settings)
        self._of = {address: np.repeat([t.board == address for t in triangles], 10) for address in ADDRESSES}
        self.rest = Rest(places)
        self.streams = BoardStreams(places)
        self.watch = Rezeroed(places, self.rest)
        self.t_ns = START_NS

    @property
    def rezeroed(self) -> list[int]:
        return [address for address, is_rezeroed in zip(ADDRESSES, self.watch.rezeroed, strict=True) if is_rezeroed]

    def use(self, address: int, n: int) -> None:
        """Believe the first `n` taxels of a board alone."""
        usable = self.rest.usable.copy()
        usable[self._of[address]] = np.arange(N_TAXELS) < n
        self.rest.use(usable)

    def look(
        self, loads: Mapping[int, ArrayLike] | None = None, after_ns: int = LOOK_NS, stale: Collection[int] = ()
    ) -> bool:
        """Somebody stands there, but on the boards in `loads` it is these counts; of `stale` ones nothing came."""
        counts = self.rest.level - np.float32(STANDING)
        for address, load in (loads or {}).items():
            counts[self._of[address]] = self.rest.level[self._of[address]] - load
        self.t_ns += after_ns
        self.rest.update(counts)
        return self.watch.update(self.streams, np.array([a not in stale for a in ADDRESSES]), self.t_ns)

    def stand(self, loads: Mapping[int, ArrayLike] | None = None) -> None:
        for _ in range(2):
            self.look(loads)

    def jumps(self, loads: Mapping[int, ArrayLike], after_ns: int = LOOK_NS) -> bool:
        """Whether the step to these loads, which stay, makes a board a re-zeroed one."""
        return self.look(loads, after_ns) or self.look(loads, CONFIRM_NS)

    def stays(self, loads: Mapping[int, ArrayLike]) -> bool:
        """Whether a board is a re-zeroed one after so long at these loads."""
        return self.look(loads) or self.look(loads, NEGATIVE_NS)


def taxels(*groups: tuple[int, float]) -> NDArray[np.float32]:
    """So many taxels with so many counts each, and so on; the rest bears nothing."""
    loads = np.repeat([value for _, value in groups], [n for n, _ in groups])
    return np.pad(loads, (0, N_TAXELS - len(loads))).astype(np.float32)


def total(counts: int) -> NDArray[np.float32]:
    """Whole counts that add up to this, as even as can be."""
    all_bear, more = divmod(counts, N_TAXELS)
    return taxels((more, all_bear + 1), (N_TAXELS - more, all_bear))


def rezeroed(*addresses: int) -> Foot:
    """A foot on which these boards were found to be re-zeroed."""
    foot = Foot()
    assert foot.stays(dict.fromkeys(addresses, -3.0))
    assert sorted(foot.rezeroed) == sorted(addresses)
    return foot


def test_every_board_is_used_at_first() -> None:
    watch = Foot().watch
    assert (~watch.rezeroed).tolist() == [True, True, True]
    assert watch.suspect == [False, False, False]


@each_board
def test_a_board_whose_load_vanishes_while_the_others_are_loaded_was_rezeroed(address: int) -> None:
    foot = Foot()
    foot.stand()
    assert not foot.look({address: 0})
    assert not foot.look({address: 0}, CONFIRM_NS - 1)
    assert foot.rezeroed == []
    assert foot.look({address: 0}, 1)
    assert foot.rezeroed == [address]
    assert not foot.look({address: 0})
    assert foot.rezeroed == [address]


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        pytest.param(taxels((5, 12)), 0, False, id="its mean is at the bound"),
        pytest.param(taxels((5, 12), (1, 1)), 0, True, id="its mean is above the bound"),
        pytest.param(taxels((5, 16)), 1, False, id="half of it is left in all"),
        pytest.param(taxels((5, 16)), taxels((39, 1)), True, id="less than half is left in all"),
        pytest.param(taxels((5, 4), (35, 2)), 0, True, id="five taxels are loaded"),
        pytest.param(taxels((4, 4), (1, 3.75), (35, 2)), 0, False, id="a fifth one hardly is"),
        pytest.param(STANDING, taxels((32, 2), (8, 1)), True, id="above the rest by the bound"),
        pytest.param(STANDING, taxels((33, 2), (7, 1)), False, id="above the rest by more"),
        pytest.param(STANDING, taxels((18, 2), (18, -2)), True, id="around the rest by the bound"),
        pytest.param(STANDING, taxels((18, 2), (18, -2), (1, 1)), False, id="around the rest by more"),
        pytest.param(taxels((5, 8), (35, 2)), taxels((4, 3)), True, id="three tenths are left of the loaded ones"),
        pytest.param(taxels((5, 8), (35, 2)), taxels((4, 3), (1, 1)), False, id="more is left of the loaded ones"),
    ],
)
def test_a_jump_is_of_loaded_taxels_to_their_rest(before: ArrayLike, after: ArrayLike, expected: bool) -> None:
    foot = Foot()
    foot.stand({5: before})
    assert foot.jumps({5: after}) is expected


@pytest.mark.parametrize(
    ("earlier", "before", "expected"),
    [
        (245, 320, True), (244, 320, False), (395, 320, True), (396, 320, False),  # by the noise
        (480, 600, True), (479, 600, False), (720, 600, True), (721, 600, False),  # by a fifth
    ],
)  # fmt: skip
def test_a_load_that_was_changing_already_does_not_jump(earlier: int, before: int, expected: bool) -> None:
    foot = Foot()
    foot.look({5: total(earlier)})
    foot.look({5: total(before)})
    assert foot.jumps({5: 0}) is expected


@pytest.mark.parametrize(("load", "expected"), [(taxels((5, 15)), True), (taxels((5, 15), (1, 1)), False)])
def test_before_the_first_check_a_board_has_no_load(load: ArrayLike, expected: bool) -> None:
    foot = Foot()
    foot.look({5: load})
    assert foot.jumps({5: 0}) is expected


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ((50, 50), (50, 50), True), ((50, 50), (100, 0), True), ((50, 50), (50, 49), False),
        ((250, 250), (150, 150), True), ((250, 250), (150, 149), False),
        ((250, 250), (350, 350), True), ((250, 250), (350, 351), False),
    ],
)  # fmt: skip
def test_a_jump_counts_only_if_the_other_boards_keep_their_load(
    before: tuple[int, int], after: tuple[int, int], expected: bool
) -> None:
    foot = Foot()
    foot.stand({7: total(before[0]), 6: total(before[1])})
    assert foot.jumps({7: total(after[0]), 5: total(20), 6: total(after[1])}) is expected


def test_without_load_on_the_others_a_board_that_jumps_was_left() -> None:
    foot = Foot()
    foot.stand(NOBODY | {5: STANDING})
    assert not foot.jumps(NOBODY)


@pytest.mark.parametrize(("pause_ns", "expected"), [(PAUSE_NS, True), (PAUSE_NS + 1, False)])
def test_a_jump_over_a_pause_is_seen_if_that_is_short(pause_ns: int, expected: bool) -> None:
    foot = Foot()
    foot.stand()
    foot.look(after_ns=pause_ns - LOOK_NS, stale=[5])
    assert foot.jumps({5: 0}) is expected


@pytest.mark.parametrize(("pause_ns", "expected"), [(HELD_UP_NS, True), (HELD_UP_NS + 1, False)])
def test_a_jump_over_a_pause_of_all_boards_may_be_the_gait(pause_ns: int, expected: bool) -> None:
    foot = Foot()
    foot.stand()
    assert foot.jumps({5: 0}, after_ns=pause_ns) is expected


@pytest.mark.parametrize(("rest_ns", "expected"), [(PAUSE_NS - 2 * LOOK_NS, True), (PAUSE_NS - 2 * LOOK_NS + 1, False)])
def test_looks_at_half_of_a_board_are_part_of_the_pause(rest_ns: int, expected: bool) -> None:
    foot = Foot()
    foot.stand()
    for _ in range(2):
        foot.look({5: taxels((20, STANDING))}, stale=[5])
    foot.look({5: taxels((20, STANDING))}, rest_ns - LOOK_NS, stale=[5])
    assert foot.jumps({5: 0}) is expected


def test_no_rezero_is_concluded_before_the_board_sends_again() -> None:
    foot = Foot()
    foot.stand()
    foot.look({5: 0})
    assert not foot.look({5: 0}, CONFIRM_NS, stale=[5])
    assert foot.look({5: 0}, 1)


@pytest.mark.parametrize(("n", "expected"), [(MIN_TAXELS, True), (MIN_TAXELS - 1, False)])
def test_a_board_is_judged_by_its_usable_taxels_if_they_are_many(n: int, expected: bool) -> None:
    foot = Foot()
    foot.use(5, n)
    foot.stand({5: taxels((n, STANDING))})
    assert foot.jumps({5: taxels((n, 0), (N_TAXELS - n, 30))}) is expected


def test_a_change_of_the_usable_taxels_is_no_jump() -> None:
    foot = Foot()
    foot.stand()
    foot.use(5, N_TAXELS - 1)
    assert not foot.jumps({5: 0})


def loses_taxels(foot: Foot) -> None:
    foot.use(5, MIN_TAXELS - 1)


def becomes(state: str) -> Callable[[Foot], None]:
    def spoil(foot: Foot) -> None:
        getattr(foot.streams, state)[ADDRESSES.index(5)] = True

    return spoil


spoilt = pytest.mark.parametrize("spoil", [becomes("silent"), becomes("crowded"), becomes("clash"), loses_taxels])


def well_again(foot: Foot) -> None:
    foot.use(5, N_TAXELS)
    for state in (foot.streams.silent, foot.streams.crowded, foot.streams.clash):
        state[:] = False


@spoilt
def test_a_jump_is_no_evidence_if_the_board_turns_out_to_lose_frames(spoil: Callable[[Foot], None]) -> None:
    foot = Foot()
    foot.stand()
    foot.look({5: 0})
    spoil(foot)
    assert not foot.look({5: 0}, CONFIRM_NS)
    well_again(foot)
    assert not foot.look({5: 0})
    assert not foot.look({5: 0}, CONFIRM_NS)


@spoilt
def test_a_negative_load_counts_only_while_the_board_loses_no_frames(spoil: Callable[[Foot], None]) -> None:
    foot = Foot()
    foot.look({5: -3})
    spoil(foot)
    assert not foot.look({5: -3}, NEGATIVE_NS)
    well_again(foot)
    assert not foot.look({5: -3})
    assert foot.look({5: -3}, NEGATIVE_NS)


@pytest.mark.parametrize("state", ["silent", "crowded", "clash"])
def test_a_board_with_lost_frames_is_no_evidence_about_the_others(state: str) -> None:
    foot = Foot()
    getattr(foot.streams, state)[:] = [True, False, True]
    foot.stand()
    assert foot.jumps({5: 0})


def test_a_board_that_is_late_does_not_keep_the_next_from_being_judged() -> None:
    foot = Foot()
    foot.stand()
    foot.look({5: 0}, stale=[7])
    assert foot.look({5: 0}, CONFIRM_NS, stale=[7])
    assert foot.rezeroed == [5]


def test_a_rezero_of_a_second_board_is_detected_after_the_first() -> None:
    foot = rezeroed(7)
    foot.stand()
    assert foot.jumps({5: 0})
    assert foot.rezeroed == [7, 5]


@each_board
def test_a_board_that_stands_above_its_rest_for_some_time_was_zeroed(address: int) -> None:
    foot = Foot()
    assert not foot.look({address: total(-51)})
    assert not foot.look({address: total(-51)}, NEGATIVE_NS - 1)
    assert foot.look({address: total(-51)}, 1)
    assert foot.rezeroed == [address]
    assert not foot.look({address: total(-51)})


def test_at_the_bound_nothing_is_missing_and_it_must_be_missing_without_a_break() -> None:
    foot = Foot()
    assert not foot.stays({5: total(-50)})
    foot.look({5: total(-51)})
    foot.look({5: total(-50)}, NEGATIVE_NS - 1)
    assert not foot.look({5: total(-51)}, 1)
    assert foot.look({5: total(-51)}, NEGATIVE_NS)


@pytest.mark.parametrize(("n", "expected"), [(5, True), (4, False)])
def test_some_taxels_at_255_are_enough_even_if_the_mean_is_not(n: int, expected: bool) -> None:
    foot = Foot(no_load=245)
    assert foot.stays({5: taxels((n, -10), (N_TAXELS - n, 0))}) is expected


def test_with_a_no_load_of_255_constant_readings_there_are_no_evidence() -> None:
    foot = Foot(no_load=255)
    assert not foot.stays(NOBODY)
    assert foot.watch.suspect == [False, False, False]


@pytest.mark.parametrize(
    ("loads", "then", "expected"),
    [
        ([total(-40), STANDING, STANDING], -63, False),
        ([total(-40), STANDING, STANDING], -65, True),
        ([total(-40), total(-20), STANDING], -63, False),
        ([total(-20), total(-40), STANDING], -63, False),
        ([total(-40), total(60)], -63, True),  # not loaded in between
        ([total(-40), total(61)], -63, False),
        ([total(-40), STANDING, total(-10), STANDING], -63, True),
        ([total(-10), STANDING, total(-40), STANDING], -63, False),
        ([STANDING], -51, True),
    ],
)
def test_a_rest_that_creeps_up_from_one_step_to_the_next_is_none_of_a_new_zero(
    loads: list[ArrayLike], then: int, expected: bool
) -> None:
    foot = Foot()
    for load in loads:
        foot.look(NOBODY | {5: load})
    assert foot.stays(NOBODY | {5: total(then)}) is expected


@pytest.mark.parametrize(("stood_at", "expected"), [(-20, True), (-28, False)])
def test_creeping_pins_taxels_at_255_too(stood_at: int, expected: bool) -> None:
    foot = Foot(no_load=245)
    for load in (total(stood_at), STANDING):
        foot.look({5: load})
    assert foot.stays({5: taxels((5, -10))}) is expected


@pytest.mark.parametrize(
    ("load", "suspect"),
    [
        (total(-25), False), (total(-26), True), (STANDING, False),
        (taxels((4, -10), (8, 5)), False), (taxels((5, -10), (10, 5)), True),
    ],
)  # fmt: skip
@each_board
def test_a_board_is_suspect_while_it_is_below_its_rest(load: ArrayLike, suspect: bool, address: int) -> None:
    foot = Foot(no_load=245)
    foot.look({address: load})
    assert foot.watch.suspect == [suspect and address == a for a in ADDRESSES]
    foot.look()
    assert foot.watch.suspect == [False, False, False]


@spoilt
def test_a_board_that_is_not_judged_may_be_suspect_all_the_same(spoil: Callable[[Foot], None]) -> None:
    foot = Foot()
    spoil(foot)
    foot.look({5: -3}, stale=[5])
    assert foot.watch.suspect == [False, True, False]


@each_board
def test_a_board_is_believed_again_after_it_rested_for_some_time_without_load(address: int) -> None:
    foot = rezeroed(address)
    assert not foot.look(NOBODY)
    assert not foot.look(NOBODY, HEALED_NS - 1)
    assert foot.rezeroed == [address]
    assert foot.look(NOBODY, 1)
    assert foot.rezeroed == []


@pytest.mark.parametrize(
    ("loads", "counts"),
    [
        pytest.param({7: total(60)}, False, id="another board is loaded"),
        pytest.param({7: total(59)}, True, id="another board nearly is"),
        pytest.param({5: taxels((18, 2), (18, -2), (1, 1))}, False, id="its taxels are not at rest"),
        pytest.param({5: taxels((18, 2), (18, -2))}, True, id="its taxels just are"),
        pytest.param({5: total(-26)}, False, id="it is suspect"),
        pytest.param({5: total(-25)}, True, id="it nearly is"),
        pytest.param({6: total(-26)}, True, id="another one is suspect"),
    ],
)
def test_only_rest_of_the_whole_foot_counts_and_without_a_break(loads: dict[int, ArrayLike], counts: bool) -> None:
    foot = rezeroed(5)
    foot.look(NOBODY)
    foot.look(NOBODY | loads, HEALED_NS - 1)
    assert foot.look(NOBODY, 1) is counts
    if not counts:
        assert not foot.look(NOBODY, HEALED_NS - 1)
        assert foot.look(NOBODY, 1)


@spoilt
def test_a_board_does_not_heal_while_it_is_not_heard_well(spoil: Callable[[Foot], None]) -> None:
    foot = rezeroed(5)
    foot.look(NOBODY)
    spoil(foot)
    assert not foot.look(NOBODY, HEALED_NS)
    well_again(foot)
    assert not foot.look(NOBODY, 1)
    assert foot.look(NOBODY, HEALED_NS)


def test_a_board_heals_when_it_is_heard() -> None:
    foot = rezeroed(5)
    foot.look(NOBODY)
    assert not foot.look(NOBODY, HEALED_NS, stale=[5])
    assert foot.look(NOBODY, 1)


def test_a_faulty_taxel_does_not_keep_its_board_from_healing() -> None:
    foot = rezeroed(5)
    foot.use(5, N_TAXELS - 2)
    loads = NOBODY | {5: taxels((N_TAXELS - 2, 0), (2, 40))}
    foot.look(loads)
    assert foot.look(loads, HEALED_NS)


def test_boards_become_healthy_independently() -> None:
    foot = rezeroed(7, 5)
    foot.look(NOBODY | {5: taxels((20, 2), (20, -2))})
    foot.look(NOBODY, 1)
    assert foot.look(NOBODY, HEALED_NS - 1)
    assert foot.rezeroed == [5]
    assert foot.look(NOBODY, 1)
    assert foot.rezeroed == []


def test_a_board_that_has_healed_may_be_zeroed_under_load_again_and_takes_as_long_to_heal() -> None:
    foot = rezeroed(5)
    for _ in range(2):
        foot.look(NOBODY)
        assert foot.look(NOBODY, HEALED_NS)
        foot.stand()
        assert foot.jumps({5: 0})
        assert not foot.look(NOBODY, HEALED_NS)


def test_negative_readings_during_a_fault_do_not_prevent_later_detection() -> None:
    foot = rezeroed(5)
    foot.look(NOBODY)
    assert foot.look(NOBODY, HEALED_NS)
    foot.stand()
    assert foot.stays(NOBODY | {5: -3})
    assert foot.rezeroed == [5]


def test_all_boards_are_believed_again_after_a_person_took_a_new_zero() -> None:
    foot = rezeroed(*ADDRESSES)
    foot.watch.forget()
    assert foot.rezeroed == []
    assert not foot.look(NOBODY)


def test_a_new_zero_ends_evidence_for_a_rezero() -> None:
    foot = Foot()
    foot.stand()
    foot.look({5: 0, 6: -3})
    foot.watch.forget()
    assert not foot.look({5: 0, 6: -3}, NEGATIVE_NS)
    assert foot.look({5: 0, 6: -3}, NEGATIVE_NS)
    assert foot.rezeroed == [6]


@pytest.mark.parametrize("loaded_before", [False, True])
def test_after_a_new_zero_earlier_creep_does_not_prevent_detection(loaded_before: bool) -> None:
    foot = Foot()
    foot.look({5: total(-40)})
    if loaded_before:
        foot.look()
    foot.watch.forget()
    foot.look()
    assert foot.stays({5: total(-51)})
