"""Rest levels: where they begin, what is learned of them and what not, and how far from them each board is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from insole_daemon.config import Board
from insole_daemon.skin.faults.places import Places
from insole_daemon.skin.faults.rest import (
    CLIP_COUNT,
    ENOUGH_LEARNED,
    FIRST_UNLOADED_COUNT,
    GAIN,
    NEAR_NO_LOAD_COUNT,
    TOP_MARGIN,
    UNLOADED_COUNT,
    Rest,
)
from insole_daemon.skin.layout import Triangle, of

TRIANGLES = (7, 5, 7, 6)  # whose they are: 20 taxels of board 7, 10 of 5 and of 6
OF = {address: np.repeat(np.array(TRIANGLES) == address, 10) for address in (7, 5, 6)}  # (40,) of each board
ALL = np.ones(40, np.bool_)
EVERY_BOARD = np.ones(3, np.bool_)
LOWEST, HIGHEST = CLIP_COUNT
NO_LOAD = 200  # of all boards but where a test says so: at shift 0 they rest exactly there


def rest_of(no_load: int = NO_LOAD, shift: int = 0) -> Rest:
    """A foot of three boards, of which number 5 has these settings."""
    boards = {address: Board(address=address, interface="can0", no_load=NO_LOAD, shift=0) for address in (5, 6, 7)}
    boards[5] = Board(address=5, interface="can0", no_load=no_load, shift=shift)
    triangles = tuple(
        Triangle(board=board, triangle=number, patch="line", x_mm=20.0 * number, y_mm=0.0, rotation_deg=0.0)
        for number, board in enumerate(TRIANGLES)
    )
    return Rest(Places(of("left", 32e-6, None, triangles), boards))


def counts_of(of_board: dict[int, ArrayLike]) -> NDArray[np.float32]:
    """Counts of all taxels; on boards that are not named they are the no-load."""
    counts = np.full(40, NO_LOAD, np.float32)
    for address, values in of_board.items():
        counts[OF[address]] = values
    return counts


def learn(rest: Rest, of_board: dict[int, ArrayLike], looks: int = 1, fresh: ArrayLike = EVERY_BOARD) -> None:
    for _ in range(looks):
        rest.update(counts_of(of_board))
        rest.learn(ALL, np.array(fresh))


def first(n: int, value: float, rest: float = 0.0, of_all: int = 10) -> NDArray[np.float64]:
    """`n` times `value`, then `rest`."""
    return np.where(np.arange(of_all) < n, value, rest)


@pytest.mark.parametrize(
    ("no_load", "shift", "level"), [(200, 0, 200.0), (240, 1, 240.25), (240, 3, 240.4375), (255, 3, 255.0)]
)
def test_a_level_begins_at_the_mean_of_what_is_rounded_to_the_no_load(no_load: int, shift: int, level: float) -> None:
    rest = rest_of(no_load, shift)
    assert (rest.level[OF[5]] == level).all()
    assert (rest.level[~OF[5]] == NO_LOAD).all()


def test_at_first_every_taxel_is_usable_and_nothing_is_known() -> None:
    rest = rest_of()
    assert rest.activation[rest.usable].tolist() == rest.activation[~rest.known].tolist() == [0] * 40
    assert rest.at_top.tolist() == [False] * 40
    assert rest.any_at_top is False
    assert rest.n_usable.tolist() == [20, 10, 10]
    assert rest.learned.tolist() == rest.total.tolist() == rest.mean.tolist() == rest.n_at_top.tolist() == [0, 0, 0]


def test_activation_is_how_far_the_count_lies_below_the_level() -> None:
    rest = rest_of()
    rest.update(np.arange(180, 220, dtype=np.float32))
    assert rest.activation.tolist() == list(range(20, -20, -1))


def test_total_and_mean_are_each_boards_own() -> None:
    rest = rest_of()
    rest.update(counts_of({7: 198, 5: 197, 6: 201}))
    assert rest.total.tolist() == [40, 30, -10]
    assert rest.mean.tolist() == [2, 3, -1]


@pytest.mark.parametrize(
    ("activation", "counted"),
    [
        (-55, LOWEST), (LOWEST - 1, LOWEST), (LOWEST, LOWEST), (LOWEST + 1, LOWEST + 1),
        (HIGHEST - 1, HIGHEST - 1), (HIGHEST, HIGHEST), (HIGHEST + 1, HIGHEST), (200, HIGHEST),
    ],
)  # fmt: skip
def test_no_single_taxel_moves_the_mean_of_its_board_by_more_than_the_clip(activation: float, counted: float) -> None:
    rest = rest_of()
    rest.update(counts_of({5: NO_LOAD - first(1, activation)}))
    assert rest.activation[OF[5]].tolist() == [activation] + [0] * 9
    assert rest.total.tolist() == [0, counted, 0]
    assert rest.mean.tolist() == pytest.approx([0, counted / 10, 0])


def test_only_usable_taxels_count() -> None:
    rest = rest_of()
    usable = OF[7] | (np.arange(40) == 12)  # one of board 5 alone, none of board 6
    usable[0] = False
    rest.use(usable)
    rest.update(counts_of({7: NO_LOAD - first(1, 9, 2, of_all=20), 5: NO_LOAD - np.arange(10), 6: 190}))
    assert rest.usable.tolist() == usable.tolist()
    assert rest.n_usable.tolist() == [19, 1, 0]
    assert rest.total.tolist() == [38, 2, 0]
    assert rest.mean.tolist() == [2, 2, 0]


@pytest.mark.parametrize(
    ("no_load", "count", "pinned"),
    [
        (NO_LOAD, 255, True),
        (NO_LOAD, 254, False),
        (255 - TOP_MARGIN, 255, True),
        (256 - TOP_MARGIN, 255, False),
        (255, 255, False),
    ],
)
def test_255_is_the_end_of_the_range_unless_it_is_a_possible_baseline(no_load: int, count: int, pinned: bool) -> None:
    rest = rest_of(no_load)
    rest.update(counts_of({5: count}))
    assert rest.at_top.tolist() == (OF[5] & pinned).tolist()
    assert rest.any_at_top is pinned
    assert rest.n_at_top.tolist() == [0, 10 * pinned, 0]


def test_the_usable_ones_of_each_board_at_255_are_counted_anew_in_every_cycle() -> None:
    rest = rest_of()
    usable = ALL.copy()
    usable[10] = False
    rest.use(usable)
    rest.update(counts_of({7: first(2, 255.0, 200.0, of_all=20), 5: first(4, 255.0, 254.0)}))
    assert rest.at_top.sum() == 6
    assert rest.n_at_top.tolist() == [2, 3, 0]
    rest.update(counts_of({}))
    assert not rest.at_top.any()
    assert rest.any_at_top is False
    assert rest.n_at_top.tolist() == [0, 0, 0]


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("address", [7, 5, 6])
def test_one_board_that_is_pressed_or_below_its_rest_is_enough_to_be_loaded(address: int, sign: int) -> None:
    rest = rest_of()
    rest.update(counts_of({}))
    assert rest.unloaded()
    rest.update(counts_of({address: NO_LOAD - sign * FIRST_UNLOADED_COUNT}))
    assert not rest.unloaded()
    rest.update(counts_of({address: NO_LOAD - sign * (FIRST_UNLOADED_COUNT - 0.05)}))
    assert rest.unloaded()


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_board_that_is_learned_is_held_to_a_closer_bound(sign: int) -> None:
    rest = rest_of()
    learn(rest, {}, ENOUGH_LEARNED - 1)
    learn(rest, {}, fresh=[False, True, False])
    just_below, just_above = NO_LOAD - sign * (UNLOADED_COUNT - 0.05), NO_LOAD - sign * (UNLOADED_COUNT + 0.05)
    rest.update(counts_of({5: just_below, 7: just_above, 6: just_above}))
    assert rest.unloaded(), "boards 7 and 6 lack a look"
    rest.update(counts_of({5: just_above}))
    assert not rest.unloaded()


@pytest.mark.parametrize("looks", [1, 2, 10, 49])
def test_a_level_is_the_mean_of_where_it_began_and_of_every_look_so_far(looks: int) -> None:
    rest = rest_of()
    learn(rest, {7: 202, 5: 196}, looks)
    assert rest.level[OF[7]] == pytest.approx(200 + 2 * looks / (looks + 1), abs=1e-3)
    assert rest.level[OF[5]] == pytest.approx(200 - 4 * looks / (looks + 1), abs=1e-3)
    assert (rest.level[OF[6]] == NO_LOAD).all()
    assert rest.learned.tolist() == [looks] * 3


def test_later_it_is_a_running_mean_that_drift_does_not_escape() -> None:
    rest = rest_of()
    learn(rest, {}, 200)
    learn(rest, {5: 210})
    assert rest.level[OF[5]] == pytest.approx(200 + 10 * GAIN, abs=1e-3)


def test_nothing_is_learned_of_a_board_that_is_not_fresh() -> None:
    rest = rest_of()
    learn(rest, {7: 202, 5: 202, 6: 202}, 2, fresh=[True, False, True])
    assert rest.learned.tolist() == [2, 0, 2]
    assert (rest.level != NO_LOAD).tolist() == (~OF[5]).tolist()


def test_only_taxels_that_are_believed_are_learned() -> None:
    rest = rest_of()
    believed = np.arange(40) % 3 > 0
    rest.update(counts_of({7: 202, 5: 202, 6: 202}))
    rest.learn(believed, EVERY_BOARD)
    assert rest.level.tolist() == np.where(believed, 201, 200).tolist()


def test_faulty_taxels_that_are_believed_are_learned_too() -> None:
    rest = rest_of()
    rest.use(~ALL)
    learn(rest, {7: 202, 5: 202, 6: 202})
    assert rest.level.tolist() == [201] * 40


@pytest.mark.parametrize("sign", [-1, 1])
def test_counts_far_from_the_level_are_no_baseline(sign: int) -> None:
    rest = rest_of()
    away = NEAR_NO_LOAD_COUNT + np.array([-1, 0, 0.25, 1, 30, -1, 0, 0.25, 1, 30])
    learn(rest, {5: NO_LOAD + sign * away})
    expected = NO_LOAD + sign * np.where(away <= NEAR_NO_LOAD_COUNT, away / 2, 0)
    assert rest.level[OF[5]].tolist() == expected.tolist()


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_rest_level_stays_near_the_no_load_however_it_is_approached(sign: int) -> None:
    rest = rest_of()
    levels = []
    for away in (12, 18, 22, 24):  # always 12 from the level: half of it is learned, a third, a quarter, a fifth
        learn(rest, {5: NO_LOAD + sign * away})
        levels.append(sign * (rest.level[OF[5]] - NO_LOAD))
    assert [set(level.tolist()) for level in levels] == [{6}, {10}, {NEAR_NO_LOAD_COUNT}, {NEAR_NO_LOAD_COUNT}]


def test_the_levels_of_a_board_are_known_once_it_was_looked_at_often_enough() -> None:
    rest = rest_of()
    learn(rest, {}, ENOUGH_LEARNED - 1)
    assert not rest.known.any()
    learn(rest, {}, fresh=[False, True, True])
    assert rest.known.tolist() == (~OF[7]).tolist()
    learn(rest, {}, fresh=[True, False, False])
    assert rest.known.all()


def test_of_a_board_that_is_forgotten_all_is_learned_anew() -> None:
    rest = rest_of(no_load=210)
    learn(rest, {7: 204, 5: 214, 6: 204}, ENOUGH_LEARNED)
    assert rest.known.all()
    learned = rest.level[OF[7]].tolist()
    rest.forget(np.array([False, True, False]))
    assert rest.known.tolist() == (~OF[5]).tolist()
    assert rest.learned.tolist() == [ENOUGH_LEARNED, 0, ENOUGH_LEARNED]
    assert rest.level[OF[5]].tolist() == [210] * 10
    assert rest.level[OF[7]].tolist() == learned
    learn(rest, {5: 214}, fresh=[False, True, False])
    assert rest.level[OF[5]].tolist() == [212] * 10
    assert rest.level[OF[6]].tolist() == learned[:10]
    learn(rest, {5: 214}, ENOUGH_LEARNED - 1)
    assert rest.known.all()
