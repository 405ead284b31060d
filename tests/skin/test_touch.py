"""What every triangle on the bus reads, from frames written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from insole_daemon.skin.geometry import THERMAL_PADS
from insole_daemon.skin.identifiers import (
    CLASS_LEGACY_SKIN,
    CLASS_MANAGEMENT,
    CLASS_SECOND_HALF,
    CLASS_SKIN,
    ERROR_NO_ACK,
    ERROR_NOT_CONNECTED,
    TAG_A,
    TAG_B,
    skin_id,
)
from insole_daemon.skin.touch import Touch

NOW_NS = 3_000_000_000_000
STALE_NS = 500_000_000  # half a second, as is promised
BOARD, TRIANGLE = 5, 12
LEVEL = 100.0  # of COUNTS without the thermal pads
COUNTS = [110, 90, 105, 95, 102, 98, 1, 120, 80, 107, 255, 93]


def frame(data: list[int], can_id: int = skin_id(BOARD, TRIANGLE), t_ns: int = NOW_NS, flags: int = 0) -> FrameBatch:
    """One frame."""
    return FrameBatch(
        np.array([7]), np.array([t_ns]), np.zeros(1, np.uint8), np.array([can_id], np.uint32),
        np.array([len(data)], np.uint8), np.array([data[:8] + [0] * (8 - len(data))], np.uint8),
        np.array([flags], np.uint8),
    )  # fmt: skip


def half_a(counts: list[int]) -> list[int]:
    return [TAG_A, *counts[:7]]


def half_b(counts: list[int], error: int = 0) -> list[int]:
    return [TAG_B, *counts[7:], 0xF5, 0x70 | error]


def halves(
    counts: list[int], board: int = BOARD, triangle: int = TRIANGLE, t_ns: int = NOW_NS, error: int = 0
) -> FrameBatch:
    can_id = skin_id(board, triangle)
    return FrameBatch.concatenate([frame(half_a(counts), can_id, t_ns), frame(half_b(counts, error), can_id, t_ns)])


def fed(*batches: FrameBatch) -> Touch:
    """All in one batch."""
    touch = Touch()
    touch.feed(FrameBatch.concatenate(batches))
    return touch


def known(level: NDArray[np.float64]) -> dict[tuple[int, int], float]:
    """The level of every (board, triangle) that is known."""
    assert level.shape == (16, 16)
    return {(board, triangle): level[board, triangle] for board, triangle in np.argwhere(~np.isnan(level)).tolist()}


def where(marked: NDArray[np.bool_]) -> list[list[int]]:
    assert marked.shape == (16, 16)
    rows: list[list[int]] = np.argwhere(marked).tolist()
    return rows


def test_before_the_first_frame_all_levels_are_unknown() -> None:
    touch = Touch()
    touch.feed(FrameBatch.empty())
    for now_ns in (0, 1, NOW_NS):
        assert known(touch.level_count(now_ns)) == {}
    assert where(touch.has_arrived()) == where(touch.faulty()) == []


def test_the_level_is_the_mean_of_the_pressure_taxels_by_board_and_triangle() -> None:
    touch = fed(halves(COUNTS), halves([count - 60 if count > 60 else 200 for count in COUNTS], 9, 3))
    assert known(touch.level_count(NOW_NS)) == {(5, 12): LEVEL, (9, 3): LEVEL - 60}
    assert where(touch.has_arrived()) == [[5, 12], [9, 3]]
    assert where(touch.faulty()) == []


@pytest.mark.parametrize("identity", [(0, 0), (0, 15), (15, 0), (15, 15)])
def test_every_address_has_a_place(identity: tuple[int, int]) -> None:
    assert known(fed(halves(COUNTS, *identity)).level_count(NOW_NS)) == {identity: LEVEL}


@pytest.mark.parametrize("taxel", range(12))
def test_every_taxel_weighs_a_tenth_and_the_thermal_pads_nothing(taxel: int) -> None:
    counts = COUNTS.copy()
    counts[taxel] = 130
    expected = LEVEL if taxel in THERMAL_PADS else LEVEL + (130 - COUNTS[taxel]) / 10
    assert known(fed(halves(counts)).level_count(NOW_NS)) == {(5, 12): pytest.approx(expected)}


def test_the_newest_half_stands() -> None:
    old, new = [20] * 12, [80] * 12
    touch = fed(halves(new), halves(old), halves(new), frame(half_a(old)))
    assert known(touch.level_count(NOW_NS)) == {(5, 12): pytest.approx((6 * 20 + 4 * 80) / 10)}
    touch.feed(frame(half_a(new)))
    assert known(touch.level_count(NOW_NS)) == {(5, 12): 80}
    touch.feed(frame(half_b(old)))
    assert known(touch.level_count(NOW_NS)) == {(5, 12): pytest.approx((6 * 80 + 4 * 20) / 10)}


# ---- what is no skin frame


@pytest.mark.parametrize(
    ("class_a", "class_b", "taken_a", "taken_b"),
    [
        (CLASS_SKIN, CLASS_SKIN, True, True),
        (CLASS_LEGACY_SKIN, CLASS_LEGACY_SKIN, True, True),
        (CLASS_SKIN, CLASS_SECOND_HALF, True, True),
        (CLASS_SECOND_HALF, CLASS_SKIN, False, True),
        (CLASS_SKIN, 5, True, False),
        (2, CLASS_SKIN, False, True),
        (0, 0, False, False),
        (1, 1, False, False),
        (2, 2, False, False),
        (5, 5, False, False),
        (CLASS_MANAGEMENT, CLASS_MANAGEMENT, False, False),
    ],
)
def test_the_classes_that_carry_a_half(class_a: int, class_b: int, taken_a: bool, taken_b: bool) -> None:
    touch = fed(
        frame(half_a(COUNTS), skin_id(BOARD, TRIANGLE, class_a)),
        frame(half_b(COUNTS), skin_id(BOARD, TRIANGLE, class_b)),
    )
    assert known(touch.level_count(NOW_NS)) == ({(5, 12): LEVEL} if taken_a and taken_b else {})
    assert where(touch.has_arrived()) == ([[5, 12]] if taken_a or taken_b else [])


@pytest.mark.parametrize("tag", [0x00, TAG_A - 1, TAG_A + 1, TAG_B - 1, TAG_B + 1, 0xFF])
def test_a_frame_with_another_tag_is_not_a_half(tag: int) -> None:
    assert where(fed(frame([tag, *COUNTS[:7]])).has_arrived()) == []


@pytest.mark.parametrize("flags", [EXTENDED, REMOTE, ERROR, FD])
@pytest.mark.parametrize("tag", [TAG_A, TAG_B])
def test_frames_of_another_kind_are_passed_over(tag: int, flags: int) -> None:
    touch = fed(halves(COUNTS), frame([tag, *[9] * 7], flags=flags))
    assert known(touch.level_count(NOW_NS)) == {(5, 12): LEVEL}
    assert where(fed(frame([tag, *[9] * 7], flags=flags)).has_arrived()) == []


@pytest.mark.parametrize("n_bytes", range(1, 8))
@pytest.mark.parametrize("tag", [TAG_A, TAG_B])
def test_a_half_that_is_cut_is_passed_over(tag: int, n_bytes: int) -> None:
    touch = fed(halves(COUNTS), frame([tag, *[9] * 7][:n_bytes]))
    assert known(touch.level_count(NOW_NS)) == {(5, 12): LEVEL}
    assert where(fed(frame([tag, *[9] * 7][:n_bytes])).has_arrived()) == []


# ---- silence


def test_a_reading_is_half_a_second_good() -> None:
    touch = fed(halves(COUNTS), halves(COUNTS, 9, 3, NOW_NS + 1))
    assert known(touch.level_count(NOW_NS + STALE_NS)) == {(5, 12): LEVEL, (9, 3): LEVEL}
    assert known(touch.level_count(NOW_NS + STALE_NS + 1)) == {(9, 3): LEVEL}
    assert known(touch.level_count(NOW_NS + STALE_NS + 2)) == {}
    assert where(touch.has_arrived()) == [[5, 12], [9, 3]], "it was seen none the less"


@pytest.mark.parametrize("half", ["A", "B"])
def test_one_half_alone_gives_no_reading_but_counts_as_received(half: str) -> None:
    data = half_a(COUNTS) if half == "A" else half_b(COUNTS)
    touch = fed(frame(data))
    assert known(touch.level_count(NOW_NS)) == {}
    assert where(touch.has_arrived()) == [[5, 12]]
    touch = fed(halves(COUNTS), frame(data, t_ns=NOW_NS + STALE_NS))
    assert known(touch.level_count(NOW_NS + STALE_NS)) == {(5, 12): LEVEL}
    assert known(touch.level_count(NOW_NS + STALE_NS + 1)) == {}, "the other half is too old"


def test_a_triangle_that_sends_again_has_a_level_again() -> None:
    touch = fed(halves(COUNTS))
    later_ns = NOW_NS + 10 * STALE_NS
    assert known(touch.level_count(later_ns)) == {}
    touch.feed(halves(COUNTS, t_ns=later_ns))
    assert known(touch.level_count(later_ns)) == {(5, 12): LEVEL}


# ---- open or dead


@pytest.mark.parametrize("error", [ERROR_NO_ACK, ERROR_NOT_CONNECTED, 4, 8, 0xF])
def test_a_triangle_that_reports_an_error_is_faulty_and_has_no_level(error: int) -> None:
    touch = fed(halves(COUNTS, error=error), halves(COUNTS, 9, 3))
    assert where(touch.faulty()) == [[5, 12]]
    assert where(touch.has_arrived()) == [[5, 12], [9, 3]]
    assert known(touch.level_count(NOW_NS)) == {(9, 3): LEVEL}


def test_the_error_is_over_with_a_second_half_without_it() -> None:
    touch = fed(halves(COUNTS, error=ERROR_NOT_CONNECTED))
    touch.feed(frame([TAG_A, *COUNTS[:7]]))
    assert where(touch.faulty()) == [[5, 12]], "the first half does not tell"
    touch.feed(frame(half_b(COUNTS)))
    assert where(touch.faulty()) == []
    assert known(touch.level_count(NOW_NS)) == {(5, 12): LEVEL}
