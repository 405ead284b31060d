"""The fingerprint of a loose triangle, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from insole_daemon.config import Board
from insole_daemon.skin.faults import triangles
from insole_daemon.skin.faults.places import Places
from insole_daemon.skin.faults.rest import TOP_MARGIN
from insole_daemon.skin.faults.triangles import (
    DEAF_LOOKS,
    GOOD_NS,
    LIVELY_LOOKS,
    NOISY_SHIFT,
    ON_RAILS,
    LooseTriangles,
)
from insole_daemon.skin.geometry import THERMAL_PADS
from insole_daemon.skin.layout import Triangle, builtin, of

from ...implementations import numpy_and_compiled

implementation = numpy_and_compiled(triangles)

LAYOUT = builtin("left", (5, 6, 7))
N = len(LAYOUT)
OPEN_OR_DEAD = [
    [0] * 9 + [255, 0, 0], [0] * 12, [255] * 12, [255] * 9 + [0, 255, 255],
]  # fmt: skip

ALL_AT_255, ALL_BUT_TAXEL_9_AT_255 = OPEN_OR_DEAD[2:]

BOARD_OF_ROW = (9, 4, 9, 2, 4)  # in no order, as a file may have it
SMALL = of(
    "left",
    32.4e-6,
    None,
    tuple(
        Triangle(board=board, triangle=row, patch="", x_mm=30.0 * row, y_mm=0.0, rotation_deg=0.0)
        for row, board in enumerate(BOARD_OF_ROW)
    ),
)
ROWS = len(SMALL)
START_NS = 5 * GOOD_NS


def loose_of(counts: np.ndarray, no_load: int = 240) -> np.ndarray:
    boards = {address: Board(address=address, interface="can0", no_load=no_load) for address in (5, 6, 7)}
    watched = LooseTriangles(Places(LAYOUT, boards))
    if watched.must_update(counts):
        watched.update(counts, np.ones(N, bool), 1)
    return watched.loose


every_counts = arrays(np.uint8, (N, 12), elements=st.sampled_from([0, 1, 17, 239, 240, 241, 254, 255]))


@given(every_counts, st.integers(0, N - 1), st.sampled_from(OPEN_OR_DEAD))
def test_the_firmwares_counts_of_an_open_line_are_loose(counts, row, fingerprint):
    counts[row] = fingerprint
    assert loose_of(counts)[row]


@given(every_counts, st.integers(0, N - 1), st.sampled_from(OPEN_OR_DEAD), st.booleans())
def test_one_half_that_is_newer_than_the_fault_is_enough(counts, row, fingerprint, half_a):
    half = slice(0, 7) if half_a else slice(7, 12)
    counts[row, half] = fingerprint[half]
    assert loose_of(counts)[row]


@given(every_counts)
def test_no_load_on_the_taxels_is_loose_while_the_pads_are_in_range(counts):
    counts[:, THERMAL_PADS] = 230
    assert not loose_of(counts).any()


@given(every_counts)
def test_at_rest_on_a_no_load_of_255_is_not_loose(counts):
    counts[:] = np.where(counts < 128, 254, 255)
    assert not loose_of(counts, no_load=255).any()


def small_foot(no_load: dict[int, int] | None = None, shift: dict[int, int] | None = None) -> LooseTriangles:
    """Of five triangles on three boards; settings by address."""
    boards = {
        address: Board(
            address=address,
            interface="can0",
            no_load=(no_load or {}).get(address, 240),
            shift=(shift or {}).get(address, NOISY_SHIFT),
        )
        for address in set(BOARD_OF_ROW)
    }
    return LooseTriangles(Places(SMALL, boards))


def only(*rows: int) -> np.ndarray:
    return np.isin(np.arange(ROWS), rows)


def counts_with(row: int = 0, triangle: list[int] | None = None) -> np.ndarray:
    """Five triangles in the middle of their range, but for the one in `row`."""
    counts = np.full((ROWS, 12), 128, np.uint8)
    if triangle is not None:
        counts[row] = triangle
    return counts


def with_on_rails(on_rails: list[int], rail: int = 0) -> list[int]:
    return [rail if taxel in on_rails else 128 for taxel in range(12)]


def loose_rows(watched: LooseTriangles, counts: np.ndarray, t_ns: int = START_NS) -> list[int]:
    watched.update(counts, only(*range(ROWS)), t_ns)
    return np.flatnonzero(watched.loose).tolist()


AT_REST, NO_CONTACT = counts_with(), [0] * 12
ALL = only(*range(ROWS))
NONE = only()


def test_nothing_is_loose_before_anything_came():
    assert not small_foot().loose.any()


@pytest.mark.parametrize("row", range(ROWS))
@pytest.mark.parametrize("fingerprint", OPEN_OR_DEAD)
def test_only_the_triangle_that_came_loose_is_loose(row, fingerprint):
    assert loose_rows(small_foot(), counts_with(row, fingerprint)) == [row]


@pytest.mark.parametrize("half", [range(7), range(7, 12)], ids="ab")
@pytest.mark.parametrize("rail", [0, 255])
def test_a_half_with_one_count_in_range_is_connected(half, rail):
    assert loose_rows(small_foot(), counts_with(1, with_on_rails([*half], rail))) == [1]
    for word in half:
        assert loose_rows(small_foot(), counts_with(1, with_on_rails([*set(half) - {word}], rail))) == []


@pytest.mark.parametrize("of_a", range(7))
@pytest.mark.parametrize("of_b", range(7, 12))
def test_one_word_of_each_half_may_be_in_range_but_not_both_pads(of_a, of_b):
    on_rails = [word for word in range(12) if word not in (of_a, of_b)]
    assert len(on_rails) == ON_RAILS
    for rail in (0, 255):
        rows = loose_rows(small_foot(), counts_with(2, with_on_rails(on_rails, rail)))
        assert rows == ([] if (of_a, of_b) == THERMAL_PADS else [2])


@pytest.mark.parametrize("in_range", [(0, 1, 11), (5, 8, 9), (0, 6, 7), (3, 10, 11)])
def test_three_counts_in_range_are_a_connected_triangle(in_range):
    on_rails = [word for word in range(12) if word not in in_range]
    assert len(on_rails) == ON_RAILS - 1
    assert loose_rows(small_foot(), counts_with(2, with_on_rails(on_rails))) == []


@pytest.mark.parametrize("pads", [[pad] for pad in THERMAL_PADS] + [list(THERMAL_PADS)])
def test_a_pad_on_a_rail_alone_is_not_loose(pads):
    assert loose_rows(small_foot(), counts_with(3, with_on_rails(pads))) == []


def test_a_mixture_of_both_rails_is_loose():
    assert loose_rows(small_foot(), counts_with(4, [0, 255] * 6)) == [4]


@pytest.mark.parametrize("almost", [1, 254])
def test_next_to_a_rail_is_not_on_it(almost):
    assert loose_rows(small_foot(), counts_with(4, [almost] * 12)) == []


@pytest.mark.parametrize(("no_load", "is_loose"), [(255 - TOP_MARGIN, True), (256 - TOP_MARGIN, False), (255, False)])
def test_255_is_not_the_end_of_the_range_for_a_triangle_with_that_baseline(no_load, is_loose):
    watched = small_foot(no_load={4: no_load})
    assert loose_rows(watched, counts_with(1, ALL_AT_255)) == ([1] if is_loose else [])
    assert loose_rows(watched, counts_with(0, ALL_AT_255)) == ([0, 1] if is_loose else [0]), "another board"


def test_zero_is_a_rail_wherever_a_triangle_rests():
    assert loose_rows(small_foot(no_load={4: 255}), counts_with(4, NO_CONTACT)) == [4]


@pytest.mark.parametrize("row", range(ROWS))
@pytest.mark.parametrize("no_load", [{}, {4: 255}, {2: 255, 4: 255, 9: 255}])
def test_a_chip_that_reads_0_is_loose_wherever_a_triangle_rests(row, no_load):
    assert loose_rows(small_foot(no_load), counts_with(row, ALL_BUT_TAXEL_9_AT_255)) == [row]


def test_a_chip_that_reads_0_is_loose_also_while_others_rest_at_255():
    counts = counts_with(1, ALL_BUT_TAXEL_9_AT_255)
    counts[4] = ALL_AT_255
    assert loose_rows(small_foot(no_load={4: 255}), counts) == [1]


@pytest.mark.parametrize(
    "triangle",
    [
        [255] * 8 + [0] + [255] * 3,
        [255] * 10 + [0] + [255],
        [255] * 9 + [1] + [255] * 2,
        [254] + [255] * 8 + [0] + [255] * 2,
        [128] * 9 + [0] + [128] * 2,
    ],
    ids=["taxel 8", "taxel 10", "at 1", "another below 255", "the others in range"],
)
def test_a_chip_that_reads_0_needs_eleven_taxels_at_255(triangle):
    assert loose_rows(small_foot(no_load={4: 255}), counts_with(1, triangle)) == []


@pytest.mark.parametrize("word", range(12))
@pytest.mark.parametrize(("count", "on_rail"), [(0, True), (1, False), (254, False), (255, True)])
def test_counts_need_a_look_where_a_pad_is_on_a_rail(word, count, on_rail):
    for row in range(ROWS):
        counts = counts_with()
        counts[row, word] = count
        assert small_foot().must_update(counts) == (on_rail and word in THERMAL_PADS)


def test_taxels_without_a_new_reading_are_not_judged():
    watched = small_foot()
    both = counts_with(1, NO_CONTACT)
    both[3] = NO_CONTACT
    assert watched.update(both, only(0, 2, 3, 4), START_NS)
    assert watched.loose.tolist() == only(3).tolist()


def test_deferred_watch_reports_every_change_and_nothing_else():
    watched = small_foot()
    other = counts_with(2, NO_CONTACT)
    assert not watched.update(AT_REST, ALL, START_NS)
    assert watched.update(counts_with(1, NO_CONTACT), ALL, START_NS)
    assert not watched.update(counts_with(1, NO_CONTACT), ALL, START_NS + 1)
    assert watched.update(other, ALL, START_NS + 1 + GOOD_NS), "one heals, another comes loose"
    assert watched.loose.tolist() == only(2).tolist()
    assert not watched.update(other, ALL, START_NS + 2 + GOOD_NS)


def test_a_loose_triangle_is_used_again_after_it_was_good_for_good_ns():
    watched = small_foot()
    assert loose_rows(watched, counts_with(1, NO_CONTACT), START_NS) == [1]
    assert loose_rows(watched, counts_with(1, NO_CONTACT), START_NS + GOOD_NS - 1) == [1]
    assert loose_rows(watched, AT_REST, START_NS + GOOD_NS) == [1]
    assert watched.must_update(AT_REST)
    assert loose_rows(watched, AT_REST, START_NS + 2 * GOOD_NS - 2) == [1]
    assert loose_rows(watched, AT_REST, START_NS + 2 * GOOD_NS - 1) == []
    assert not watched.must_update(AT_REST)


def test_each_triangle_heals_in_its_own_time():
    watched = small_foot()
    loose_rows(watched, counts_with(4, NO_CONTACT), START_NS)
    loose_rows(watched, counts_with(0, NO_CONTACT), START_NS + 10)
    assert loose_rows(watched, AT_REST, START_NS + GOOD_NS) == [0]
    assert watched.must_update(AT_REST)
    assert loose_rows(watched, AT_REST, START_NS + GOOD_NS + 10) == []


def test_a_loose_triangle_does_not_heal_without_frames():
    watched = small_foot()
    loose_rows(watched, counts_with(1, NO_CONTACT))
    assert not watched.update(AT_REST, only(0, 2, 3, 4), START_NS + 3 * GOOD_NS)
    assert watched.loose[1]
    assert watched.update(AT_REST, only(1), START_NS + 3 * GOOD_NS)
    assert not watched.loose[1]


def test_a_triangle_may_be_loose_in_the_first_nanosecond():
    watched = small_foot()
    assert loose_rows(watched, counts_with(1, NO_CONTACT), 0) == [1]
    assert loose_rows(watched, AT_REST, GOOD_NS - 1) == [1]
    assert loose_rows(watched, AT_REST, GOOD_NS) == []


def listen(
    watched: LooseTriangles, looks: int, quiet: np.ndarray, fresh: np.ndarray = ALL, t_ns: int = START_NS
) -> list[int]:
    """Rows that are loose after so many looks in which all but the `quiet` ones changed."""
    for _ in range(looks):
        watched.listen(fresh, ~quiet)
    if watched.must_update(AT_REST):
        watched.update(AT_REST, fresh, t_ns)
    return np.flatnonzero(watched.loose).tolist()


@pytest.mark.parametrize("row", range(ROWS))
def test_a_triangle_without_noise_is_loose_where_others_have_it(row):
    watched = small_foot()
    assert listen(watched, DEAF_LOOKS - 1, only(row)) == []
    assert listen(watched, 1, only(row)) == [row]


def test_only_looks_in_which_something_came_count():
    watched = small_foot()
    assert listen(watched, DEAF_LOOKS - 1, only(2)) == []
    assert listen(watched, 5, only(2), fresh=only(0, 1, 3, 4)) == []
    assert listen(watched, 1, only(2)) == [2]


def test_one_change_begins_the_count_anew():
    watched = small_foot()
    assert listen(watched, DEAF_LOOKS - 1, only(2)) == []
    assert listen(watched, 1, NONE) == []
    assert listen(watched, DEAF_LOOKS - 1, only(2)) == []
    assert listen(watched, 1, only(2)) == [2]


def test_a_triangle_that_is_heard_again_heals_as_others_do():
    watched = small_foot()
    assert listen(watched, DEAF_LOOKS, only(2), t_ns=START_NS) == [2]
    assert listen(watched, 1, only(2), t_ns=START_NS + GOOD_NS) == [2]
    assert listen(watched, 1, NONE, t_ns=START_NS + 2 * GOOD_NS - 1) == [2]
    assert listen(watched, 1, NONE, t_ns=START_NS + 2 * GOOD_NS) == []
    assert not watched.must_update(AT_REST)


def test_a_triangle_without_noise_stays_loose_while_it_sends_nothing():
    watched = small_foot()
    assert listen(watched, DEAF_LOOKS, only(2), t_ns=START_NS) == [2]
    assert listen(watched, 1, only(2), fresh=only(0, 1, 3, 4), t_ns=START_NS + 2 * GOOD_NS) == [2]
    assert listen(watched, 1, NONE, t_ns=START_NS + 2 * GOOD_NS + 1) == [2], "good for a nanosecond"


def test_where_none_has_noise_none_is_loose():
    watched = small_foot()
    assert listen(watched, 2 * DEAF_LOOKS, ALL) == []
    assert not watched.must_update(AT_REST)


def test_two_without_noise_are_both_loose():
    assert listen(small_foot(), DEAF_LOOKS, only(0, 3)) == [0, 3]


@pytest.mark.parametrize(("looks", "loose"), [(LIVELY_LOOKS, [0]), (LIVELY_LOOKS + 1, [])])
def test_the_triangle_in_the_middle_of_the_others_must_change_so_often(looks, loose):
    watched = small_foot()
    listen(watched, DEAF_LOOKS - looks, only(0))
    assert listen(watched, looks, only(0, 1, 2, 3)) == loose, "of 1, 2, 3 and 4 the middle two stand still so long"


def test_one_other_triangle_that_stands_still_for_longer_does_not_matter():
    watched = small_foot()
    listen(watched, DEAF_LOOKS - LIVELY_LOOKS - 20, only(0))
    listen(watched, 20, only(0, 1))
    assert listen(watched, LIVELY_LOOKS, only(0, 1)) == [0]


@pytest.mark.parametrize(("shift", "loose"), [(NOISY_SHIFT, [1, 4]), (NOISY_SHIFT + 1, [])])
def test_a_board_at_a_high_shift_shows_no_noise(shift, loose):
    assert listen(small_foot(shift={4: shift}), DEAF_LOOKS, only(1, 4)) == loose


def test_a_board_at_a_high_shift_is_no_measure_of_noise():
    quiet = only(1, 2, 3, 4)
    assert listen(small_foot(shift={4: NOISY_SHIFT + 1, 2: NOISY_SHIFT + 1}), DEAF_LOOKS, quiet) == [2]


def test_boards_at_a_high_shift_are_not_enough_to_hear_others_by():
    assert listen(small_foot(shift={9: 7, 2: 7}), DEAF_LOOKS, only(1, 4)) == []


def test_a_loose_triangle_heals_also_where_none_has_noise():
    watched = small_foot()
    assert loose_rows(watched, counts_with(1, NO_CONTACT)) == [1]
    for _ in range(DEAF_LOOKS):
        watched.listen(ALL, NONE)
    assert watched.must_update(AT_REST)
    assert loose_rows(watched, AT_REST, START_NS + GOOD_NS) == []
