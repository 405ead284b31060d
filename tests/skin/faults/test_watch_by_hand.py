"""A foot of three boards whose counts are written down here: what its watch masks and tells, cycle by cycle."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.config import Board
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.faults import HEALED, KINDS, Change, Fault, FaultWatch
from insole_daemon.skin.faults.boards import CROWDED_NS, SILENT_NS, SINGLE_NS, STEADY_NS, WINDOW_NS
from insole_daemon.skin.faults.rest import ENOUGH_LEARNED
from insole_daemon.skin.faults.rezero import HEALED_NS, NEGATIVE_NS
from insole_daemon.skin.faults.taxels import EVIDENCE_COUNT, ONE_LOOK_COUNT, SATURATED_NS, UNSATURATED_NS
from insole_daemon.skin.faults.triangles import DEAF_LOOKS, GOOD_NS
from insole_daemon.skin.faults.watch import LOOK_CYCLES, STALE_NS
from insole_daemon.skin.layout import Triangle, of

BOARD_OF_ROW = (9, 4, 9, 4, 9, 4, 9, 4, 2)  # board 2 has too few triangles to be judged as a whole
N = len(BOARD_OF_ROW)
LAYOUT = of(
    "left",
    32.4e-6,
    None,
    tuple(
        Triangle(board=board, triangle=15 - row, patch="", x_mm=60.0 * row, y_mm=0.0, rotation_deg=0.0)
        for row, board in enumerate(BOARD_OF_ROW)
    ),
)
NO_LOAD = 240
BOARDS = {address: Board(address=address, interface="can0", no_load=NO_LOAD) for address in (2, 4, 9)}
PERIOD_NS = 20_000_000
SILENT_CYCLES = SILENT_NS // PERIOD_NS + 1
REALTIME_NS = 1_700_000_000_000_000_000
FAR = 8  # counts off its rest, which no healthy taxel among idle ones stands
FEW_LOOKS = math.ceil(EVIDENCE_COUNT / ONE_LOOK_COUNT)  # in which such a taxel is found
MOST_LOOKS = math.ceil(EVIDENCE_COUNT)  # in which one is found or heals

Reported = tuple[str, int, int | None, int | None]


def rows_of(board: int) -> NDArray[np.bool_]:
    return np.array([address == board for address in BOARD_OF_ROW])


def cycles_in(duration_ns: int) -> int:
    return -(-duration_ns // PERIOD_NS)


class Foot:
    """All boards send all halves every cycle, with the noise of one count, until the fields say otherwise."""

    def __init__(self) -> None:
        self.watch = FaultWatch(LAYOUT, BOARDS)
        self.halves = np.full(N, 2)  # that come of each triangle in a cycle
        self.off = np.zeros((N, 12), np.int64)  # counts from the rest: negative under load
        self.noise = np.ones(N, np.int64)
        self.older_ns = np.zeros(N, np.int64)  # that the older half is older than the newer one
        self.masked_when_screened = np.zeros((N, 12), np.bool_)
        self.changes: list[Change] = []
        self.n_cycles = 0
        self._counts = np.zeros((N, 12), np.uint8)
        self._arrivals = np.zeros(N, np.int64)
        self._came = np.full(N, -1)

    @property
    def t_ns(self) -> int:
        """CLOCK_REALTIME of the last cycle."""
        return REALTIME_NS + self.n_cycles * PERIOD_NS

    def run(self, n_cycles: int = 1) -> list[Reported]:
        """The changes that the next cycles report."""
        changes = [change for _ in range(n_cycles) for change in self._cycle()]
        self.changes += changes
        return [(change.event, change.board, change.triangle, change.taxel) for change in changes]

    def look(self, n_looks: int = 1) -> list[Reported]:
        return self.run(n_looks * LOOK_CYCLES)

    def _cycle(self) -> list[Change]:
        self.n_cycles += 1
        came = self.halves > 0
        noise = (self.n_cycles // LOOK_CYCLES + np.arange(12)) % 2 * self.noise[:, None]
        self._counts = np.where(came[:, None], NO_LOAD + noise + self.off, self._counts).clip(0, 255).astype(np.uint8)
        self._arrivals = self._arrivals + self.halves
        self._came[came] = self.n_cycles
        age_ns = (self.n_cycles - self._came) * PERIOD_NS + self.older_ns
        t_mono_ns = np.array([self.n_cycles * PERIOD_NS])
        cycles = Cycles(
            t_mono_ns=t_mono_ns,
            t_ns=t_mono_ns + REALTIME_NS,
            counts=self._counts[None],
            status=np.zeros((1, N), np.uint16),
            triangle_t_ns=np.zeros((1, N), np.int64),
            age_ns=np.where(self._came < 0, -1, age_ns)[None],
            arrivals=self._arrivals[None],
            missing=~came[None],
            late=np.array([not came.all()]),
            repeated=np.array([not came.any()]),
        )
        self.watch.screen(cycles, 0)
        self.masked_when_screened = self.watch.masked.copy()
        return self.watch.update(cycles, 0)


@pytest.fixture
def foot() -> Foot:
    """All boards were heard, and their rest levels are known."""
    foot = Foot()
    assert len(foot.look(2 * ENOUGH_LEARNED)) == 3
    foot.changes.clear()
    assert foot.watch.faults == []
    assert not foot.watch.masked.any()
    return foot


def reported(kind: str, row: int | None = None, taxel: int | None = None, board: int = 9) -> Reported:
    """A change as `Foot.run` returns it, of the triangle in `row` or of `board`."""
    if row is None:
        return kind, board, None, None
    return kind, BOARD_OF_ROW[row], 15 - row, taxel


# ---- boards


def test_a_board_is_reported_once_when_it_first_sends() -> None:
    foot = Foot()
    foot.halves[:] = 2 * rows_of(9)
    assert foot.run() == [reported("board_streaming", board=9)]
    foot.halves[:] = 2
    assert foot.run() == [reported("board_streaming", board=4), reported("board_streaming", board=2)]
    assert foot.run(20) == []
    assert [change.text for change in foot.changes] == ["board 9 sends", "board 4 sends", "board 2 sends"]
    assert [change.began for change in foot.changes] == [False] * 3
    assert [change.t_ns for change in foot.changes] == [REALTIME_NS + n * PERIOD_NS for n in (1, 2, 2)]


def test_nothing_is_wrong_before_the_first_cycle() -> None:
    assert Foot().watch.faults == []
    assert (~Foot().watch.masked).all()


def test_a_board_that_was_silent_from_the_start_is_reported_once_when_it_sends() -> None:
    foot = Foot()
    foot.halves[rows_of(4)] = 0
    foot.run()
    assert foot.run(SILENT_CYCLES - 1) == []
    assert foot.run() == [reported("board_silent", board=4)]
    assert (foot.watch.masked == rows_of(4)[:, None]).all()
    foot.halves[:] = 2
    assert foot.run() == [reported("board_streaming", board=4)]
    assert not foot.watch.masked.any()
    assert re.fullmatch("board 4 sends again, after .* s", foot.changes[-1].text)


def test_another_board_that_sends_again_does_not_hide_one_that_is_first_heard() -> None:
    foot = Foot()
    foot.halves[rows_of(4)] = 0
    foot.run(9)
    foot.halves[rows_of(2)] = 0
    foot.run(20)
    assert {(fault.kind, fault.board) for fault in foot.watch.faults} == {("board_silent", 4), ("board_silent", 2)}
    foot.halves[:] = 2
    assert foot.run() == [
        reported("board_streaming", board=4), reported("board_streaming", board=2), reported("board_reset", board=2)
    ]  # fmt: skip


def test_a_silent_board_is_masked_and_one_that_restarted_is_believed(foot: Foot) -> None:
    foot.halves[rows_of(9)] = 0
    assert foot.run(SILENT_CYCLES - 1) == []
    assert foot.run() == [reported("board_silent")]
    since_ns = foot.t_ns
    assert (foot.watch.masked == rows_of(9)[:, None]).all()
    assert foot.watch.faults == [Fault("board_silent", 9, None, None, since_ns)]
    foot.halves[:] = 2
    assert foot.run() == [reported("board_streaming"), reported("board_reset")]
    assert not foot.watch.masked.any()
    assert foot.watch.faults == [Fault("board_reset", 9, None, None, foot.t_ns)]
    assert foot.run(cycles_in(STEADY_NS)) == []
    assert foot.run() == [reported("board_reset_over")]
    assert foot.watch.faults == []


def test_all_boards_fall_silent_while_cycles_only_repeat(foot: Foot) -> None:
    foot.halves[:] = 0
    changes = foot.run(SILENT_CYCLES)
    assert changes == [reported("board_silent", board=address) for address in (9, 4, 2)]
    assert foot.watch.masked.all()


def test_two_boards_on_one_address_are_masked_until_one_is_gone(foot: Foot) -> None:
    foot.halves[rows_of(9)] = 4
    assert foot.run(cycles_in(2 * WINDOW_NS)) == [reported("board_address_clash")]
    assert (foot.watch.masked == rows_of(9)[:, None]).all()
    foot.halves[:] = 2
    changes = foot.run(cycles_in(WINDOW_NS + SINGLE_NS))
    assert changes == [reported("board_address_clash_over")]
    assert not foot.watch.masked.any()


# ---- boards that were zeroed under load


def above_rest(foot: Foot, board: int = 9, counts: int = 2) -> None:
    """As after a zero under that load, once the load is gone."""
    foot.off[rows_of(board)] = counts


def rezero(foot: Foot) -> None:
    above_rest(foot)
    assert foot.run(cycles_in(NEGATIVE_NS) + 2 * LOOK_CYCLES) == [reported("board_rezeroed")]


def heal(foot: Foot) -> list[Reported]:
    foot.off[rows_of(9)] = 0
    return foot.run(cycles_in(HEALED_NS) + 2 * LOOK_CYCLES)


def test_a_board_above_its_rest_levels_is_masked_until_it_stands_at_them(foot: Foot) -> None:
    rezero(foot)
    assert (foot.watch.masked == rows_of(9)[:, None]).all()
    assert heal(foot) == [reported("board_rezeroed_over")]
    assert not foot.watch.masked.any()


def test_a_new_zero_by_a_person_ends_the_mask_at_once(foot: Foot) -> None:
    rezero(foot)
    foot.watch.zeroed()
    assert not foot.watch.masked.any()


def test_a_new_zero_is_reported_as_the_end_of_a_rezero(foot: Foot) -> None:
    """Protocol, keys.md: board_rezeroed_over, or a person took a new zero."""
    rezero(foot)
    foot.off[:] = 0
    foot.watch.zeroed()
    assert foot.look(2) == [reported("board_rezeroed_over")]
    assert foot.watch.faults == []


def test_with_a_new_zero_by_a_person_rest_levels_are_learned_anew(foot: Foot) -> None:
    foot.watch.zeroed()
    foot.off[[0, 3], [1, 2]] = -FAR
    assert foot.look(2 * MOST_LOOKS) == []
    foot.off[[0, 3], [1, 2]] = 0
    assert sorted(foot.look(FEW_LOOKS)) == [reported("taxel_stuck", 3, 2), reported("taxel_stuck", 0, 1)]


def test_a_board_with_missing_triangles_is_not_judged(foot: Foot) -> None:
    foot.halves[4] = 0
    foot.look(2)
    above_rest(foot)
    assert foot.run(2 * cycles_in(NEGATIVE_NS)) == []
    foot.halves[4] = 2
    assert foot.run(cycles_in(NEGATIVE_NS) + 2 * LOOK_CYCLES) == [reported("board_rezeroed")]


def test_a_triangle_that_is_stale_is_no_longer_waited_for(foot: Foot) -> None:
    foot.halves[4] = 0
    assert foot.run(cycles_in(int(STALE_NS)) + LOOK_CYCLES) == []
    above_rest(foot)
    assert foot.run(cycles_in(NEGATIVE_NS) + 2 * LOOK_CYCLES) == [reported("board_rezeroed")]


def test_a_board_whose_triangles_come_in_turns_is_judged_when_all_have_come(foot: Foot) -> None:
    above_rest(foot)
    changes = []
    for _ in range(4 * cycles_in(NEGATIVE_NS) // LOOK_CYCLES):
        foot.halves[[0, 2, 4, 6]] = 2, 2, 0, 0
        changes += foot.look()
        foot.halves[[0, 2, 4, 6]] = 0, 0, 2, 2
        changes += foot.look()
    assert changes == [reported("board_rezeroed")]


@pytest.mark.parametrize("taxel", [0, 11])
def test_a_saturated_taxel_does_not_keep_a_board_from_being_believed_again(foot: Foot, taxel: int) -> None:
    rezero(foot)
    foot.off[3, taxel] = -NO_LOAD - 1
    assert foot.look(4) == [reported("taxel_saturated", 3, taxel)]
    assert heal(foot) == [reported("board_rezeroed_over")]


def test_a_loose_triangle_does_not_keep_a_board_from_being_believed_again(foot: Foot) -> None:
    rezero(foot)
    foot.off[3] = -NO_LOAD - 1
    assert foot.run() == [reported("triangle_loose", 3)]
    assert heal(foot) == [reported("board_rezeroed_over")]


def test_a_silent_board_does_not_keep_another_from_being_believed_again(foot: Foot) -> None:
    rezero(foot)
    foot.off[8] = -20
    foot.run()
    foot.halves[8] = 0
    foot.run(SILENT_CYCLES)
    assert heal(foot) == [reported("board_rezeroed_over")]


def test_a_triangle_that_stopped_under_load_keeps_others_from_being_believed_until_it_is_stale(foot: Foot) -> None:
    rezero(foot)
    foot.off[3] = -20
    foot.run()
    foot.halves[3] = 0
    assert heal(foot) == []
    assert foot.run(cycles_in(int(STALE_NS))) == [reported("board_rezeroed_over")]


def test_a_healed_board_learns_its_rest_levels_anew(foot: Foot) -> None:
    rezero(foot)
    foot.off[rows_of(9)] = 0
    foot.off[2, 8] = -FAR
    assert foot.run(2 * cycles_in(HEALED_NS)) == [reported("board_rezeroed_over")]
    foot.off[2, 8] = 0
    assert foot.look(FEW_LOOKS) == [reported("taxel_stuck", 2, 8)]


def test_a_board_is_believed_again_when_it_stands_at_the_rest_levels_it_had_learned() -> None:
    foot = Foot()
    own = np.tile([-3, 3], 6)  # further from the no-load than a board that is believed again may stand from its rest
    foot.off[rows_of(9)] = own
    assert len(foot.look(4 * ENOUGH_LEARNED)) == 3
    foot.off[rows_of(9)] = own + 2
    assert foot.run(cycles_in(NEGATIVE_NS) + 2 * LOOK_CYCLES) == [reported("board_rezeroed")]
    foot.off[rows_of(9)] = own
    assert foot.run(cycles_in(HEALED_NS) + 2 * LOOK_CYCLES) == [reported("board_rezeroed_over")]


def test_after_a_pause_a_board_learns_its_rest_levels_anew_and_others_do_not(foot: Foot) -> None:
    foot.halves[rows_of(9)] = 0
    foot.run(3)
    foot.halves[:] = 2
    foot.off[[2, 3], [8, 9]] = -FAR
    assert foot.look(MOST_LOOKS) == [reported("taxel_stuck", 3, 9)]
    foot.off[2, 8] = 0
    assert foot.look(FEW_LOOKS) == [reported("taxel_stuck", 2, 8)]


# ---- rest levels


def test_nothing_is_learned_of_any_board_while_one_is_in_doubt() -> None:
    foot = Foot()
    above_rest(foot, counts=1)
    foot.off[3, 2] = -FAR
    foot.look(4 * ENOUGH_LEARNED)
    foot.off[:] = 0
    assert foot.look(4 * ENOUGH_LEARNED) == []


def test_nothing_is_learned_under_load() -> None:
    foot = Foot()
    foot.off[:] = -3
    foot.look(4 * ENOUGH_LEARNED)
    foot.off[:] = 0
    assert foot.look(4 * ENOUGH_LEARNED) == []


def test_rest_levels_of_a_loose_triangle_are_not_learned() -> None:
    foot = Foot()
    foot.off[3] = -NO_LOAD - 1
    foot.run()
    foot.off[3] = 0
    foot.off[3, 2] = -FAR
    foot.look(4 * ENOUGH_LEARNED)
    foot.off[3, 2] = 0
    assert foot.run(cycles_in(GOOD_NS) + 2 * MOST_LOOKS * LOOK_CYCLES) == [reported("triangle_loose_over", 3)]


# ---- triangles


@pytest.mark.parametrize("row", [0, 5, N - 1])
def test_a_loose_triangle_is_masked_before_anybody_reads_the_cycle(foot: Foot, row: int) -> None:
    expected = np.arange(N)[:, None] == row
    foot.off[row] = -NO_LOAD - 1
    assert foot.run() == [reported("triangle_loose", row)]
    assert (foot.masked_when_screened == expected).all()
    assert (foot.watch.masked == expected).all()
    assert foot.watch.faults == [Fault("triangle_loose", BOARD_OF_ROW[row], 15 - row, None, foot.t_ns)]
    foot.off[row] = 0
    assert foot.run(cycles_in(GOOD_NS) - 1) == []
    assert (foot.watch.masked == expected).all()
    assert foot.run() == [reported("triangle_loose_over", row)]
    assert not foot.masked_when_screened.any()
    assert foot.watch.faults == []
    began, over = (change.text for change in foot.changes)
    who = f"board {BOARD_OF_ROW[row]} triangle {15 - row}"
    assert began.startswith(f"{who} came loose: its 10 taxels are left out, {100 / N:.1f} % of the area")
    assert over == f"{who} is connected again, after {GOOD_NS * 1e-9:.1f} s"


def test_two_triangles_that_come_loose_in_turn_are_reported_once_each(foot: Foot) -> None:
    foot.off[2] = -NO_LOAD - 1
    assert foot.run() == [reported("triangle_loose", 2)]
    foot.off[7] = -NO_LOAD - 1
    assert foot.run() == [reported("triangle_loose", 7)]
    assert foot.run(10) == []
    assert [fault.triangle for fault in foot.watch.faults] == [13, 8], "the longest first"


@pytest.mark.parametrize(("older_ns", "is_judged"), [(int(STALE_NS) - 1, True), (int(STALE_NS), False)])
def test_stale_taxels_are_not_judged(foot: Foot, older_ns: int, is_judged: bool) -> None:
    foot.halves[3], foot.older_ns[3] = 1, older_ns
    foot.off[3] = -NO_LOAD - 1
    assert foot.run(4) == ([reported("triangle_loose", 3)] if is_judged else [])


def test_taxels_that_were_never_received_are_not_judged() -> None:
    foot = Foot()
    foot.halves[3] = 0
    assert len(foot.run(LOOK_CYCLES)) == 3, "its counts are zeros"
    assert foot.run(100) == []


def test_a_triangle_without_noise_is_loose(foot: Foot) -> None:
    foot.noise[5] = 0
    assert foot.look(DEAF_LOOKS + 1) == [], "it stands still from the second on"
    assert foot.run() == [reported("triangle_loose", 5)]


def test_a_silent_triangle_does_not_count_as_one_without_noise(foot: Foot) -> None:
    foot.halves[5] = 0
    assert foot.look(DEAF_LOOKS + 3) == []


def test_halves_in_the_cycle_of_a_check_count_in_that_check(foot: Foot) -> None:
    foot.noise[5] = 0
    assert foot.look(DEAF_LOOKS) == []
    foot.halves[5] = 0
    assert foot.look(3) == []
    foot.halves[5] = 2
    assert foot.look() == []
    assert foot.run() == [reported("triangle_loose", 5)]


def test_what_came_in_the_first_cycle_of_a_look_counts_while_another_triangle_is_loose(foot: Foot) -> None:
    foot.off[2] = -NO_LOAD - 1
    foot.noise[5] = 0
    changes = []
    for _ in range(DEAF_LOOKS + 2):
        foot.halves[5] = 2
        changes += foot.run()
        foot.halves[5] = 0
        changes += foot.run()
    assert changes == [reported("triangle_loose", 2), reported("triangle_loose", 5)]


# ---- taxels


@pytest.mark.parametrize(("row", "taxel"), [(0, 0), (3, 5), (6, 8), (8, 11)])
def test_a_taxel_far_from_its_rest_is_stuck_and_masked_alone(foot: Foot, row: int, taxel: int) -> None:
    foot.off[row, taxel] = -FAR
    assert foot.look(FEW_LOOKS) == [reported("taxel_stuck", row, taxel)]
    assert np.argwhere(foot.watch.masked).tolist() == [[row, taxel]]
    foot.off[row, taxel] = 0
    assert foot.look(MOST_LOOKS) == [reported("taxel_stuck_over", row, taxel)]
    assert not foot.watch.masked.any()


@pytest.mark.parametrize(("row", "taxel"), [(0, 0), (3, 5), (6, 8), (8, 11)])
def test_a_taxel_that_bears_nothing_among_loaded_ones_is_dead_and_masked_alone(
    foot: Foot, row: int, taxel: int
) -> None:
    foot.off[row] = -20
    foot.off[row, taxel] = 0
    assert foot.look(FEW_LOOKS) == [reported("taxel_dead", row, taxel)]
    assert np.argwhere(foot.watch.masked).tolist() == [[row, taxel]]
    foot.off[row, taxel] = -20
    assert foot.look(MOST_LOOKS) == [reported("taxel_dead_over", row, taxel)]
    assert not foot.watch.masked.any()


@pytest.mark.parametrize(("row", "taxel"), [(0, 0), (3, 5), (6, 8), (8, 11)])
def test_a_saturated_taxel_is_reported_and_not_masked(foot: Foot, row: int, taxel: int) -> None:
    foot.off[row, taxel] = -NO_LOAD - 1
    assert foot.run(cycles_in(SATURATED_NS) + LOOK_CYCLES) == [reported("taxel_saturated", row, taxel)]
    assert not foot.watch.masked.any()
    foot.off[row, taxel] = 0
    assert foot.run(cycles_in(UNSATURATED_NS) + LOOK_CYCLES) == [reported("taxel_saturated_over", row, taxel)]


def test_constant_counts_of_a_triangle_are_no_evidence_about_its_taxels(foot: Foot) -> None:
    foot.noise[3] = 0
    foot.look()
    foot.off[3, 2] = -FAR
    assert foot.look(MOST_LOOKS) == []
    foot.noise[3] = 1
    assert foot.look(FEW_LOOKS) == [reported("taxel_stuck", 3, 2)]


def test_taxels_are_checked_in_every_second_cycle(foot: Foot) -> None:
    for at in range(MOST_LOOKS * LOOK_CYCLES):
        foot.off[3, 2] = -FAR if at % LOOK_CYCLES == 0 else 0
        assert foot.run() == []


def test_repeats_do_not_count_between_two_looks(foot: Foot) -> None:
    halves = foot.halves.copy()
    for at in range(MOST_LOOKS * LOOK_CYCLES):
        foot.off[3, 2] = -FAR if at % LOOK_CYCLES == 0 else 0
        assert foot.run() == []
        foot.halves[:] = 0
        assert foot.run() == []
        foot.halves = halves.copy()


def not_in_doubt(foot: Foot) -> None:
    foot.look()


def in_doubt_below_its_rest(foot: Foot) -> None:
    above_rest(foot)
    assert foot.look() == []


def in_doubt_by_too_many_halves(foot: Foot) -> None:
    foot.halves[rows_of(9)] = 4
    assert foot.run() == []
    foot.halves[:] = 2
    assert foot.run(cycles_in(CROWDED_NS) // 4) == []


def after_a_restart(foot: Foot) -> None:
    foot.halves[rows_of(9)] = 0
    foot.run(SILENT_CYCLES)
    foot.halves[:] = 2
    foot.look(2 * ENOUGH_LEARNED)


def after_a_clash(foot: Foot) -> None:
    foot.halves[rows_of(9)] = 4
    assert foot.run(cycles_in(2 * WINDOW_NS)) == [reported("board_address_clash")]
    foot.halves[:] = 2
    assert foot.run(cycles_in(CROWDED_NS) + LOOK_CYCLES) == []


@pytest.mark.parametrize(
    ("happens", "is_judged"),
    [
        (not_in_doubt, True),
        (in_doubt_below_its_rest, False),
        (in_doubt_by_too_many_halves, False),
        (after_a_restart, False),
        (after_a_clash, False),
        (rezero, False),
    ],
)
def test_no_taxel_is_judged_by_a_board_in_doubt(foot: Foot, happens: Callable[[Foot], None], is_judged: bool) -> None:
    happens(foot)
    foot.off[2, 8] = foot.off[3, 5] = -NO_LOAD - 3
    expected = [reported("taxel_saturated", 2, 8)] if is_judged else []
    assert foot.run(cycles_in(SATURATED_NS) + LOOK_CYCLES) == [*expected, reported("taxel_saturated", 3, 5)]


def test_no_taxel_is_judged_on_a_loose_triangle(foot: Foot) -> None:
    foot.off[3] = -NO_LOAD - 1
    foot.run()
    foot.off[3] = 0
    foot.off[3, 5] = -NO_LOAD - 1
    foot.off[5, 5] = -NO_LOAD - 1
    assert foot.look(FEW_LOOKS) == [reported("taxel_saturated", 5, 5)]


# ---- events


def test_boards_come_before_triangles_and_triangles_before_taxels(foot: Foot) -> None:
    foot.halves[rows_of(2)] = 0
    assert foot.run(SILENT_CYCLES - FEW_LOOKS * LOOK_CYCLES) == []
    foot.off[7, 9] = -FAR
    assert foot.run(FEW_LOOKS * LOOK_CYCLES - 1) == []
    foot.off[0] = -NO_LOAD - 1
    assert foot.run() == [
        reported("board_silent", board=2), reported("triangle_loose", 0), reported("taxel_stuck", 7, 9)
    ]  # fmt: skip


def test_ended_faults_are_reported_before_new_ones(foot: Foot) -> None:
    foot.off[0] = -NO_LOAD - 1
    foot.run()
    foot.off[0] = 0
    foot.run(cycles_in(GOOD_NS) - 1)
    foot.off[4] = -NO_LOAD - 1
    assert foot.run() == [reported("triangle_loose_over", 0), reported("triangle_loose", 4)]
    assert [change.began for change in foot.changes[-2:]] == [False, True]


def test_every_kind_has_an_event_for_its_end() -> None:
    assert set(HEALED) == set(KINDS)
    assert len({*HEALED.values(), *KINDS}) == 2 * len(KINDS)
