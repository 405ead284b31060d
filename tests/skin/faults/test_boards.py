"""Boards that fall silent, come back, pause, or send too much: each by itself, to the nanosecond and to the half."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import permutations

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.config import Board
from insole_daemon.skin.faults.boards import (
    CLASH_RATE,
    CROWDED_NS,
    HANDED_ON_NS,
    LATE_PERIODS,
    PAUSE_PERIODS,
    SILENT_NS,
    SILENT_PERIODS,
    SINGLE_NS,
    SINGLE_RATE,
    STEADY_NS,
    WINDOW_NS,
    WINDOW_PERIODS,
    BoardStreams,
)
from insole_daemon.skin.faults.places import Places
from insole_daemon.skin.layout import Triangle, of

BOARD_OF_ROW = np.array([9, 5, 9, 7, 5])
ADDRESSES = np.array([9, 5, 7])  # in the layout's order
LAYOUT = of(
    "left",
    32.4e-6,
    None,
    tuple(
        Triangle(board=board, triangle=row, patch="sole", x_mm=20.0 * row, y_mm=0.0, rotation_deg=0.0)
        for row, board in enumerate(BOARD_OF_ROW.tolist())
    ),
)
START_NS = 5_000_000_000_000
MS = 1_000_000
PERIOD_NS = 20 * MS
WINDOW_CYCLES = WINDOW_NS // PERIOD_NS
NOMINAL = 2 * WINDOW_CYCLES  # halves of a triangle in a window
TO_CLASH = round(CLASH_RATE * NOMINAL) - NOMINAL  # halves above the nominal ones that make a rate of CLASH_RATE
TO_STAY = round(SINGLE_RATE * NOMINAL) - NOMINAL
ALL = {9: 2, 5: 2, 7: 2}
every_board = pytest.mark.parametrize("board", ADDRESSES.tolist())
every_row = pytest.mark.parametrize("row", range(len(LAYOUT)))
every_period = pytest.mark.parametrize("period_ms", [20, 30, 50])


class Foot:
    """Three boards, and the cycles that close with what comes from them."""

    def __init__(self, periods_ms: Mapping[int, int] | int = 20, start_ns: int = START_NS) -> None:
        if isinstance(periods_ms, int):
            periods_ms = dict.fromkeys(ADDRESSES.tolist(), periods_ms)
        boards = {a: Board(address=a, interface="can0", period_ms=period) for a, period in periods_ms.items()}
        self.streams = BoardStreams(Places(LAYOUT, boards))
        self._t_ns = start_ns
        self._arrivals = np.zeros(len(LAYOUT), np.int64)

    def close(self, after_ns: int, halves: Mapping[int, int] | NDArray[np.int64]) -> bool:
        """A cycle, `after_ns` the one before: so many `halves` came of each triangle, or of those of each board."""
        if isinstance(halves, Mapping):
            halves = np.array([halves.get(board, 0) for board in BOARD_OF_ROW.tolist()])
        self._t_ns += after_ns
        self._arrivals = self._arrivals + halves
        return self.streams.update(self._t_ns, self._arrivals)

    def stream(self, cycles: int, halves: Mapping[int, int] | None = None, period_ns: int = PERIOD_NS) -> list[bool]:
        """So many cycles; in which of them something changed."""
        return [self.close(period_ns, halves or ALL) for _ in range(cycles)]

    @property
    def wrong(self) -> dict[str, list[int]]:
        """The boards that are silent, restarted, or two."""
        states = {"silent": self.streams.silent, "reset": self.streams.reset, "clash": self.streams.clash}
        return {name: addresses(there) for name, there in states.items() if there.any()}

    @property
    def seen(self) -> list[int]:
        return addresses(self.streams.seen)

    @property
    def crowded(self) -> list[int]:
        return addresses(self.streams.crowded)

    @property
    def paused(self) -> list[int]:
        return addresses(self.streams.paused)


def addresses(there: NDArray[np.bool_]) -> list[int]:
    return [int(address) for address in ADDRESSES[there]]


def streaming(period_ms: int = 20, cycles: int = WINDOW_CYCLES + 1, start_ns: int = START_NS) -> Foot:
    """Boards that have sent all they should, and nothing else."""
    foot = Foot(period_ms, start_ns)
    foot.stream(cycles, period_ns=period_ms * MS)
    return foot


def but(board: int, halves: int = 0) -> dict[int, int]:
    """All boards send as they should but this one."""
    return ALL | {board: halves}


def silent_ns(period_ms: int) -> int:
    return max(SILENT_PERIODS * period_ms * MS, SILENT_NS)


# ---- seen


def test_nothing_is_known_of_boards_before_the_first_cycle() -> None:
    foot = Foot()
    assert (foot.seen, foot.wrong, foot.crowded, foot.paused) == ([], {}, [], [])


@every_board
@pytest.mark.parametrize("first", [True, False])
def test_a_board_is_seen_from_its_first_half_on(board: int, first: bool) -> None:
    foot = Foot()
    if not first:
        assert not foot.close(0, {})
    assert foot.close(PERIOD_NS, {board: 1})
    assert foot.seen == [board]
    assert not foot.close(PERIOD_NS, {board: 1}), "it has been reported"
    assert (foot.seen, foot.wrong, foot.crowded, foot.paused) == ([board], {}, [], [])


@every_row
def test_one_triangle_is_enough_for_a_board_to_be_heard(row: int) -> None:
    foot = Foot()
    assert foot.close(0, np.eye(len(LAYOUT), dtype=np.int64)[row])
    assert foot.seen == [BOARD_OF_ROW[row]]


def test_a_board_that_keeps_its_period_changes_nothing() -> None:
    foot = streaming()
    assert not any(foot.stream(3 * WINDOW_CYCLES))
    assert (foot.seen, foot.wrong, foot.crowded, foot.paused) == (ADDRESSES.tolist(), {}, [], [])


# ---- silent


@every_board
@every_period
def test_a_board_is_silent_once_nothing_came_for_longer_than_its_limit(board: int, period_ms: int) -> None:
    foot = streaming(period_ms)
    assert not foot.close(silent_ns(period_ms), but(board))
    assert foot.wrong == {}
    assert foot.close(1, but(board))
    assert foot.wrong == {"silent": [board]}
    assert not foot.close(PERIOD_NS, but(board)), "it has been reported"
    assert foot.wrong == {"silent": [board]}


def test_each_board_has_the_limit_of_its_own_period() -> None:
    foot = Foot({9: 50, 5: 20, 7: 100})
    foot.close(0, ALL)
    assert foot.close(silent_ns(20) + 1, {})
    assert foot.wrong == {"silent": [5]}
    assert foot.close(silent_ns(50) - silent_ns(20), {})
    assert foot.wrong == {"silent": [9, 5]}
    assert foot.close(silent_ns(100) - silent_ns(50), {})
    assert foot.wrong == {"silent": [9, 5, 7]}


def test_a_board_that_never_sent_becomes_silent_as_long_after_the_first_cycle() -> None:
    foot = Foot()
    foot.close(0, {9: 2})
    assert not foot.close(SILENT_NS, {9: 2})
    assert foot.close(1, {9: 2})
    assert foot.wrong == {"silent": [5, 7]}
    assert foot.close(PERIOD_NS, {9: 2, 7: 2})
    assert foot.wrong == {"silent": [5]}, "7 did not come back: it came"
    assert foot.seen == [9, 7]


# ---- reset


@every_board
@every_period
def test_a_board_that_comes_back_counts_as_restarted_until_it_is_steady(board: int, period_ms: int) -> None:
    foot = streaming(period_ms)
    foot.close(silent_ns(period_ms) + 1, but(board))
    assert foot.close(PERIOD_NS, but(board, 1))
    assert foot.wrong == {"reset": [board]}
    assert not foot.close(STEADY_NS, ALL)
    assert foot.wrong == {"reset": [board]}
    assert foot.close(1, ALL)
    assert foot.wrong == {}
    assert not foot.close(PERIOD_NS, ALL)


@every_board
def test_a_board_that_comes_back_in_time_did_not_restart(board: int) -> None:
    foot = streaming()
    foot.close(SILENT_NS, but(board))
    assert not foot.close(PERIOD_NS, ALL)
    assert foot.wrong == {}


@every_board
def test_a_board_that_restarts_and_stays_away_is_only_silent(board: int) -> None:
    foot = streaming()
    foot.close(SILENT_NS + 1, but(board))
    foot.close(PERIOD_NS, ALL)
    foot.close(SILENT_NS, but(board))
    assert foot.wrong == {"reset": [board]}
    assert foot.close(1, but(board))
    assert foot.wrong == {"silent": [board]}
    assert not foot.close(STEADY_NS, but(board))
    assert foot.wrong == {"silent": [board]}
    foot.close(PERIOD_NS, ALL)
    foot.close(STEADY_NS, ALL)
    assert foot.wrong == {"reset": [board]}, "steady is counted from its last return"


def test_boards_that_come_back_one_after_the_other_are_steady_one_after_the_other() -> None:
    foot = streaming()
    foot.close(SILENT_NS + 1, {7: 2})
    foot.close(PERIOD_NS, {7: 2, 5: 2})
    foot.close(PERIOD_NS, ALL)
    assert foot.wrong == {"reset": [9, 5]}
    assert foot.close(STEADY_NS, ALL)
    assert foot.wrong == {"reset": [9]}
    assert foot.close(1, ALL)
    assert foot.wrong == {}


# ---- paused


@every_board
@every_period
@pytest.mark.parametrize(("longer_ns", "paused"), [(0, False), (1, True)])
def test_a_board_paused_that_sent_nothing_for_longer_than_jitter_explains(
    board: int, period_ms: int, longer_ns: int, paused: bool
) -> None:
    foot = streaming(period_ms)
    assert not foot.close(PERIOD_NS, but(board))
    assert not foot.close(round(PAUSE_PERIODS * period_ms * MS) - PERIOD_NS + longer_ns, ALL)
    assert foot.paused == ([board] if paused else [])


@every_board
def test_a_pause_is_kept_until_it_was_read(board: int) -> None:
    foot = streaming()
    foot.stream(round(PAUSE_PERIODS) + 1, but(board))
    foot.stream(WINDOW_CYCLES)
    assert foot.paused == [board]
    foot.streams.paused[:] = False
    foot.stream(WINDOW_CYCLES)
    assert foot.paused == []


# ---- crowded


@every_board
@pytest.mark.parametrize("period_ms", [20, 40])
@pytest.mark.parametrize("periods", [1, 2, 10])
@pytest.mark.parametrize("more", [0, 1])
def test_crowded_is_more_at_once_than_one_board_sends_if_late(
    board: int, period_ms: int, periods: int, more: int
) -> None:
    foot = streaming(period_ms)
    assert not foot.close(periods * period_ms * MS, but(board, round(2 * (periods + LATE_PERIODS)) + more))
    assert foot.crowded == ([board] if more else [])
    assert foot.wrong == {}


@every_row
@pytest.mark.parametrize("start_ns", [0, START_NS])
def test_one_triangle_is_enough_to_be_crowded(row: int, start_ns: int) -> None:
    foot = streaming(cycles=2, start_ns=start_ns)
    foot.close(PERIOD_NS, np.where(np.arange(len(LAYOUT)) == row, 4, 2))
    assert foot.crowded == [BOARD_OF_ROW[row]]


@every_board
def test_the_first_frames_of_a_board_are_no_crowding(board: int) -> None:
    foot = Foot()
    foot.close(0, but(board))
    foot.close(PERIOD_NS, but(board, 10))
    assert foot.crowded == []


@every_board
def test_crowded_ends_when_no_address_clash_was_detected(board: int) -> None:
    foot = streaming()
    foot.close(PERIOD_NS, but(board, 4))
    assert not foot.close(PERIOD_NS, but(board, 4))
    foot.close(CROWDED_NS - 1, ALL)
    assert foot.crowded == [board], "counted from the last time"
    assert not foot.close(1, {})
    assert foot.crowded == []
    assert not foot.close(PERIOD_NS, but(board, 4))
    assert foot.crowded == [board], "again"


def test_boards_are_crowded_each_for_its_own_time() -> None:
    foot = streaming()
    foot.close(PERIOD_NS, but(5, 4))
    foot.close(PERIOD_NS, but(7, 4))
    assert foot.crowded == [5, 7]
    foot.close(CROWDED_NS - PERIOD_NS, ALL)
    assert foot.crowded == [7]
    foot.close(PERIOD_NS, ALL)
    assert foot.crowded == []


# ---- clash


@every_row
@pytest.mark.parametrize(("above", "clash"), [(TO_CLASH - 1, False), (TO_CLASH, True)])
def test_a_clash_is_a_rate_of_one_triangle_that_no_board_alone_has(row: int, above: int, clash: bool) -> None:
    foot = streaming()
    assert foot.close(PERIOD_NS, np.where(np.arange(len(LAYOUT)) == row, 2 + above, 2)) == clash
    assert foot.wrong == ({"clash": [BOARD_OF_ROW[row]]} if clash else {})


@every_board
def test_twice_the_rate_is_an_address_clash_after_one_window(board: int) -> None:
    foot = streaming()
    changed = foot.stream(WINDOW_CYCLES, but(board, 4))
    assert changed.index(True) + 1 == TO_CLASH // 2
    assert sum(changed) == 1, "it has been reported"
    assert foot.wrong == {"clash": [board]}


@pytest.mark.parametrize("start_ns", [0, START_NS])
@every_board
def test_a_window_that_has_only_begun_counts_as_a_whole_one(board: int, start_ns: int) -> None:
    foot = streaming(cycles=1, start_ns=start_ns)
    changed = foot.stream(WINDOW_CYCLES, but(board, 4))
    assert (changed.index(True) + 1) * 4 == NOMINAL + TO_CLASH
    assert foot.wrong == {"clash": [board]}


@every_board
def test_delayed_frames_in_one_batch_are_no_address_clash(board: int) -> None:
    foot = streaming()
    held_up = 2 * WINDOW_CYCLES
    assert not foot.close(held_up * PERIOD_NS, {a: 2 * held_up + 2 * (a == board) for a in ADDRESSES.tolist()})
    assert foot.crowded == [board]
    assert foot.wrong == {}


@every_board
@pytest.mark.parametrize("pause_cycles", [5, 25, 100])
def test_frames_delayed_by_a_pause_are_no_address_clash(board: int, pause_cycles: int) -> None:
    """A host that was held up: one board's readings come after the others'."""
    foot = streaming()
    foot.stream(pause_cycles, but(board))
    foot.stream(2, but(board, 2 + pause_cycles))
    for _ in range(2 * WINDOW_CYCLES):
        foot.close(PERIOD_NS, ALL)
        assert "clash" not in foot.wrong


@every_board
def test_an_address_clash_after_a_pause_is_detected_a_window_later(board: int) -> None:
    foot = streaming()
    foot.stream(25, but(board))
    cycles_to_detect = (WINDOW_NS + HANDED_ON_NS) // PERIOD_NS
    foot.stream(cycles_to_detect, but(board, 4))
    assert "clash" not in foot.wrong
    foot.close(PERIOD_NS, but(board, 4))
    assert foot.wrong["clash"] == [board]


@pytest.mark.parametrize(("board", "period_ms"), [(9, 80), (5, 20), (7, 40)])
@pytest.mark.parametrize("clash", [False, True])
def test_halves_are_counted_for_as_long_as_the_slowest_board_needs(board: int, period_ms: int, clash: bool) -> None:
    foot = Foot({9: 80, 5: 20, 7: 40})
    every_fourth = [{5: 2}, {5: 2, 7: 2}, {5: 2}, ALL]
    window_ms = WINDOW_PERIODS * 80
    foot.close(0, ALL)
    for at in range(window_ms // 20 - 1):
        foot.close(PERIOD_NS, every_fourth[at % 4])
    assert (foot.wrong, foot.crowded) == ({}, [])
    nominal = 2 * window_ms // period_ms
    enough = math.ceil(CLASH_RATE * nominal) - nominal
    assert foot.close(PERIOD_NS, but(board, 2 + enough - (not clash))) == clash
    assert foot.crowded == [board]
    assert foot.wrong == ({"clash": [board]} if clash else {})


@every_board
def test_a_clash_is_over_when_the_rate_was_that_of_one_board_for_long_enough(board: int) -> None:
    foot = streaming()
    foot.close(PERIOD_NS, but(board, 2 + TO_CLASH))
    foot.stream(WINDOW_CYCLES - 1)  # what came too much is still in the window
    assert not any(foot.stream(SINGLE_NS // PERIOD_NS - 1))
    assert foot.wrong == {"clash": [board]}
    assert foot.close(PERIOD_NS, ALL)
    assert foot.wrong == {}
    assert not any(foot.stream(WINDOW_CYCLES))
    assert foot.wrong == {}


@every_board
@pytest.mark.parametrize(("above", "stays"), [(TO_STAY - 1, False), (TO_STAY, True)])
def test_an_address_clash_lasts_while_the_rate_exceeds_the_jitter_of_one_board(
    board: int, above: int, stays: bool
) -> None:
    foot = streaming()
    foot.close(PERIOD_NS, but(board, 2 + TO_CLASH))
    for _ in range(2 * SINGLE_NS // WINDOW_NS):
        foot.stream(WINDOW_CYCLES - 1)
        foot.close(PERIOD_NS, but(board, 2 + above))
    assert foot.wrong == ({"clash": [board]} if stays else {})


def test_each_address_clash_ends_independently() -> None:
    foot = streaming()
    foot.close(PERIOD_NS, but(7, 2 + TO_CLASH))
    foot.close(PERIOD_NS, but(9, 2 + TO_CLASH))
    assert foot.wrong == {"clash": [9, 7]}
    foot.stream((WINDOW_NS + SINGLE_NS) // PERIOD_NS - 2)
    assert foot.wrong == {"clash": [9]}
    foot.stream(1)
    assert foot.wrong == {}


@pytest.mark.parametrize("above", [TO_CLASH, NOMINAL])
def test_boards_that_all_send_too_much_do_not_clash(above: int) -> None:
    foot = streaming()
    assert not foot.close(PERIOD_NS, dict.fromkeys(ALL, 2 + above))
    assert foot.crowded == ADDRESSES.tolist()
    assert foot.wrong == {}


@every_board
@pytest.mark.parametrize("above", [0, TO_CLASH - 1])
def test_all_boards_but_one_may_clash(board: int, above: int) -> None:
    foot = streaming()
    assert foot.close(PERIOD_NS, dict.fromkeys(ALL, 2 + TO_CLASH) | {board: 2 + above})
    assert foot.wrong == {"clash": [a for a in ADDRESSES.tolist() if a != board]}


@every_board
def test_a_silent_board_does_not_count_among_all(board: int) -> None:
    foot = streaming()
    foot.stream(WINDOW_CYCLES, but(board))
    assert not foot.close(PERIOD_NS, dict.fromkeys(ALL, 2 + TO_CLASH) | {board: 0})
    assert foot.wrong == {"silent": [board]}


# ---- events


@pytest.mark.parametrize(("board", "other"), [*permutations(ALL, 2)])
def test_the_state_of_a_board_is_reported_while_another_is_crowded(board: int, other: int) -> None:
    foot = streaming()
    assert not foot.close(SILENT_NS, but(board))
    assert foot.close(PERIOD_NS, but(board) | {other: 4})
    assert (foot.wrong, foot.crowded) == ({"silent": [board]}, [other])
    assert foot.close(PERIOD_NS, ALL)
    assert (foot.wrong, foot.crowded) == ({"reset": [board]}, [other])
    assert not foot.close(PERIOD_NS, ALL)
