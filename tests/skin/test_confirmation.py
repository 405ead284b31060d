"""What a board is seen to send, from frames built by hand, and what of it stands against its settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from insole_daemon.config import Board
from insole_daemon.skin.commands import CLASS_COMMAND, RAW_TEST_MODE, SKIN_TYPES
from insole_daemon.skin.confirmation import (
    PERIOD_TOLERANCE,
    PERIOD_TOLERANCE_MS,
    REST_TOLERANCE_COUNT,
    ObservedBoard,
    StreamWatch,
)
from insole_daemon.skin.geometry import N_TAXELS, PRESSURE_TAXELS, THERMAL_PADS
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

BOARD = Board(address=5, interface="can0", period_ms=20, no_load=240)
GOOD = ObservedBoard(5, legacy=False, triangles=(0, 3, 12), open_triangles=(), period_ms=20.0, rest_count=240.0)
SILENT = ObservedBoard(5, legacy=False, triangles=(), open_triangles=(), period_ms=None, rest_count=None)
OUT_OF_RANGE = 0xFFF0  # the flags of all taxels in the status word

Row = tuple[float, int, bytes, int]  # ms, identifier, payload, flags


def frames(rows: Sequence[Row]) -> FrameBatch:
    n = len(rows)
    t_mono_ns = np.array([round(t_ms * 1e6) for t_ms, *_ in rows], np.int64)
    return FrameBatch(
        np.zeros(n, np.int64), t_mono_ns, np.zeros(n, np.uint8), np.array([row[1] for row in rows], np.uint32),
        np.array([len(row[2]) for row in rows], np.uint8),
        np.array([list(row[2].ljust(8, b"\0")) for row in rows], np.uint8).reshape(n, 8),
        np.array([row[3] for row in rows], np.uint8),
    )  # fmt: skip


def half_a(t_ms: float, board: int = 5, triangle: int = 3, count: int = 240, cls: int = CLASS_SKIN) -> Row:
    return t_ms, skin_id(board, triangle, cls), bytes([TAG_A, *[count] * 7]), 0


def half_b(
    t_ms: float, board: int = 5, triangle: int = 3, count: int = 240, cls: int = CLASS_SKIN, status: int = 0
) -> Row:
    return t_ms, skin_id(board, triangle, cls), bytes([TAG_B, *[count] * 5, *status.to_bytes(2)]), 0


def of_counts(counts: Sequence[int], status: int = 0) -> list[Row]:
    """Both halves of one triangle with these twelve counts."""
    identifier = skin_id(5, 3)
    return [
        (0, identifier, bytes([TAG_A, *counts[:7]]), 0),
        (1, identifier, bytes([TAG_B, *counts[7:], *status.to_bytes(2)]), 0),
    ]


def observed(*rows: Row, address: int = 5) -> ObservedBoard:
    watch = StreamWatch([address])
    watch.feed(frames(rows))
    return watch.observed()[address]


def test_a_board_as_configured_has_no_differences() -> None:
    assert GOOD.differences(BOARD, [12, 0, 3]) == []


def test_a_silent_board_has_one_difference() -> None:
    assert SILENT.differences(BOARD, [0, 3]) == ["sends nothing"]


def test_class_3_is_an_mtb3_that_was_never_configured() -> None:
    assert replace(GOOD, legacy=True).differences(BOARD, GOOD.triangles) == [
        "sends in class 3, as an MTB3 does that was never configured in the new style"
    ]


@pytest.mark.parametrize(
    ("enabled", "differences"),
    [
        ((0, 3, 12, 2), ["triangles missing: 2"]),
        ((0, 3, 10, 9, 12), ["triangles missing: 9, 10"]),
        ((3, 12), ["triangles that were not enabled: 0"]),
        ((3,), ["triangles that were not enabled: 0, 12"]),
        ((15, 3, 4), ["triangles missing: 4, 15", "triangles that were not enabled: 0, 12"]),
        ((), ["triangles that were not enabled: 0, 3, 12"]),
    ],
)
def test_triangles_missing_and_triangles_too_many(enabled: tuple[int, ...], differences: list[str]) -> None:
    assert GOOD.differences(BOARD, enabled) == differences


@pytest.mark.parametrize(
    ("told_ms", "tolerance_ms"),
    [(5, PERIOD_TOLERANCE_MS), (20, 20 * PERIOD_TOLERANCE), (50, 50 * PERIOD_TOLERANCE)],
    ids=["short: of so many ms", "20 ms: of the period", "50 ms: of the period"],
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_period_differs_once_it_is_beyond_the_tolerance(told_ms: int, tolerance_ms: float, sign: int) -> None:
    board = replace(BOARD, period_ms=told_ms)
    at_ms, beyond_ms = told_ms + sign * tolerance_ms, told_ms + sign * (tolerance_ms + 0.04)
    assert replace(GOOD, period_ms=at_ms).differences(board, GOOD.triangles) == []
    assert replace(GOOD, period_ms=beyond_ms).differences(board, GOOD.triangles) == [
        f"sends every {at_ms:.1f} ms, expected every {told_ms} ms"
    ]


def test_a_board_that_was_hardly_heard_has_no_period() -> None:
    assert replace(GOOD, period_ms=None).differences(BOARD, GOOD.triangles) == [
        "sends too seldom to tell a period, expected every 20 ms"
    ]


def test_every_difference_is_reported() -> None:
    assert replace(GOOD, legacy=True, period_ms=40.26).differences(BOARD, [0, 3, 4]) == [
        "sends in class 3, as an MTB3 does that was never configured in the new style",
        "triangles missing: 4",
        "triangles that were not enabled: 12",
        "sends every 40.3 ms, expected every 20 ms",
    ]


@pytest.mark.parametrize("no_load", [240, 200])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_rest_differs_once_it_is_beyond_the_tolerance(no_load: int, sign: int) -> None:
    board = replace(BOARD, no_load=no_load)
    at, beyond = no_load + sign * REST_TOLERANCE_COUNT, no_load + sign * (REST_TOLERANCE_COUNT + 1)
    assert replace(GOOD, rest_count=at).rest_difference(board) == []
    assert replace(GOOD, rest_count=beyond).rest_difference(board) == [
        f"its taxels are at {beyond:.0f} counts, expected {no_load} ± 3: did something press on the insole meanwhile?"
    ]


def test_a_baseline_is_reported_in_whole_counts() -> None:
    (message,) = replace(GOOD, rest_count=99.7).rest_difference(BOARD)
    assert message.startswith("its taxels are at 100 counts,")


@pytest.mark.parametrize("skin_type", SKIN_TYPES)
def test_only_raw_words_have_no_rest(skin_type: int) -> None:
    differences = replace(GOOD, rest_count=0.0).rest_difference(replace(BOARD, skin_type=skin_type))  # type: ignore[arg-type]
    assert bool(differences) == (skin_type != RAW_TEST_MODE)


def test_an_unobserved_rest_count_gives_no_difference() -> None:
    assert SILENT.rest_difference(BOARD) == []


@pytest.mark.parametrize("fed", [[], [[]], [[half_a(0, board=9), half_b(1, board=9)]]])
def test_a_board_that_was_not_heard_sends_nothing(fed: list[list[Row]]) -> None:
    watch = StreamWatch([6, 5])
    for rows in fed:
        watch.feed(frames(rows))
    assert watch.observed() == {5: SILENT, 6: replace(SILENT, address=6)}


def test_boards_are_judged_independently() -> None:
    watch = StreamWatch([7, 5])
    watch.feed(frames([
        half_a(0, 7, 15, 200, CLASS_LEGACY_SKIN), half_a(1, 5, 4, 240), half_a(2, 6, 9, 100),
        half_b(3, 7, 2, 200, status=ERROR_NOT_CONNECTED), half_a(21, 5, 4, 240), half_a(30, 6, 9, 100),
        half_a(50, 7, 15, 210, CLASS_LEGACY_SKIN),
    ]))  # fmt: skip
    assert watch.observed() == {
        7: ObservedBoard(7, True, (2, 15), (2,), 50.0, 205.0),
        5: ObservedBoard(5, False, (4,), (), 20.0, 240.0),
    }


@pytest.mark.parametrize("portion", [1, 3])
def test_it_does_not_matter_in_what_portions_frames_arrive(portion: int) -> None:
    rows = [of(20.0 * tick, 5, triangle) for tick in range(3) for triangle in (1, 2) for of in (half_a, half_b)]
    watch = StreamWatch([5])
    for first in range(0, len(rows), portion):
        watch.feed(frames(rows[first : first + portion]))
        watch.feed(frames([]))
    assert watch.observed()[5] == observed(*rows) == ObservedBoard(5, False, (1, 2), (), 20.0, 240.0)


@pytest.mark.parametrize(
    "row",
    [
        *((0, skin_id(5, 3), half_a(0)[2], flags) for flags in (EXTENDED, REMOTE, ERROR, FD)),
        *((0, skin_id(5, 3), half_a(0)[2][:n], 0) for n in (0, 1, 7)),
        *((0, skin_id(5, 3), bytes([tag, *[240] * 7]), 0) for tag in (0, 0x41, 0x80, 0xC1)),
        half_a(0, cls=0),
        half_a(0, cls=CLASS_COMMAND),
        half_a(0, cls=5),
        half_a(0, cls=CLASS_SECOND_HALF),
        half_b(0, cls=CLASS_MANAGEMENT),
        (0, skin_id(5, 14, CLASS_LEGACY_SKIN), bytes.fromhex("0112001200"), 0),
    ],
)
def test_a_frame_that_is_not_a_half_is_ignored(row: Row) -> None:
    assert observed(row) == SILENT


@pytest.mark.parametrize("cls", [CLASS_SKIN, CLASS_LEGACY_SKIN, CLASS_SECOND_HALF])
def test_halves_b_come_in_three_classes(cls: int) -> None:
    assert observed(half_b(0, triangle=15, cls=cls)) == replace(
        SILENT, legacy=cls == CLASS_LEGACY_SKIN, triangles=(15,), rest_count=240.0
    )


def test_halves_a_come_in_two_classes() -> None:
    assert observed(half_a(0)).triangles == observed(half_a(0, cls=CLASS_LEGACY_SKIN)).triangles == (3,)


def test_one_half_in_class_3_is_enough() -> None:
    assert observed(half_a(0), half_b(1), half_a(20, cls=CLASS_LEGACY_SKIN), half_b(21)).legacy


def test_triangles_are_reported_once_and_in_order() -> None:
    board = observed(half_b(0, triangle=15), half_a(1, triangle=0), half_a(2, triangle=9), half_a(3, triangle=0))
    assert board.triangles == (0, 9, 15)


@pytest.mark.parametrize("flags", [0, OUT_OF_RANGE])
@pytest.mark.parametrize("error", range(16))
def test_a_triangle_that_reports_itself_open_is_open(flags: int, error: int) -> None:
    assert observed(half_b(0, status=flags | error)).open_triangles == ((3,) if error == ERROR_NOT_CONNECTED else ())


def test_one_status_word_is_enough_for_an_open_triangle() -> None:
    board = observed(
        half_b(0, triangle=9), half_b(1, triangle=9, status=ERROR_NOT_CONNECTED), half_b(2, triangle=9),
        half_b(3, triangle=4), half_b(4, triangle=2, status=ERROR_NOT_CONNECTED),
        half_b(5, triangle=1, status=ERROR_NO_ACK),
    )  # fmt: skip
    assert board.open_triangles == (2, 9)
    assert board.triangles == (1, 2, 4, 9)


def test_the_last_byte_of_half_a_is_a_count() -> None:
    assert observed(half_a(0, count=ERROR_NOT_CONNECTED)).open_triangles == ()


@pytest.mark.parametrize("pads", [0, 255])
@pytest.mark.parametrize("status", [0, OUT_OF_RANGE | ERROR_NO_ACK])
@pytest.mark.parametrize("taxel", np.flatnonzero(PRESSURE_TAXELS).tolist())
def test_the_rest_is_the_median_over_pressure_taxels(taxel: int, status: int, pads: int) -> None:
    others = [other for other in range(N_TAXELS) if other not in (taxel, *THERMAL_PADS)]
    counts = [pads] * N_TAXELS
    counts[taxel] = 100
    for other in others[::2]:
        counts[other] = 200
    for other in others[1::2]:
        counts[other] = 0
    assert observed(*of_counts(counts, status)).rest_count == 150.0, "between the fifth and the sixth of ten"


@pytest.mark.parametrize(
    ("rows", "rest_count"),
    [
        ([half_a(0, count=230)], 230.0),
        ([half_b(0, count=230)], 230.0),
        ([half_a(0, count=230), half_b(0, count=240)], 230.0),  # six taxels and four
        ([half_a(0, count=230), half_b(0, count=240), half_b(20, count=240)], 240.0),
        ([half_a(0, triangle=1, count=230), half_a(1, triangle=2, count=240)], 235.0),
    ],
)
def test_the_rest_is_of_all_that_arrived(rows: list[Row], rest_count: float) -> None:
    assert observed(*rows).rest_count == rest_count


def test_an_open_triangle_has_no_rest() -> None:
    of_open = [half(tick, triangle=2, count=0) for tick in range(5) for half in (half_a, half_b)]
    says_so = half_b(6, triangle=2, count=0, status=ERROR_NOT_CONNECTED)
    assert observed(*of_open, says_so, half_a(7), half_b(8)).rest_count == 240.0
    assert observed(*of_open, half_a(7), half_b(8)).rest_count == 0.0
    assert observed(*of_open, says_so).rest_count is None


@pytest.mark.parametrize(
    ("rows", "period_ms"),
    [
        ([half_a(0), half_a(20)], 20.0),
        ([half_b(0), half_b(20)], 20.0),
        ([half_a(0), half_b(1), half_a(20), half_b(21)], 20.0),
        ([half_b(0), half_a(1), half_b(20), half_a(21)], 20.0),
        ([half_a(0, triangle=1), half_a(7, triangle=2), half_a(20, triangle=1), half_a(27, triangle=2)], 20.0),
        ([half_a(0), half_b(5, cls=CLASS_SECOND_HALF), half_a(20), half_b(25, cls=CLASS_SECOND_HALF)], 20.0),
        ([half_a(0), half_a(19), half_a(39.5), half_a(139.5)], 20.5),
        ([half_a(0), half_b(3), half_a(19), half_a(39.5), half_b(43)], 20.5),
        ([half_a(0), half_a(20), half_a(50)], 25.0),
    ],
    ids=[
        "A alone", "B alone", "B after A", "A after B", "two triangles", "B in class 6", "one that came late",
        "A and B", "two intervals",
    ],
)  # fmt: skip
def test_the_period_is_the_median_over_halves(rows: list[Row], period_ms: float) -> None:
    assert observed(*rows).period_ms == pytest.approx(period_ms)


def test_readings_handed_on_in_bursts_keep_their_period() -> None:
    """The host looks every 50 ms, and stamps what has come as it reads it."""
    held_up_ms = [-(-20 * tick // 50) * 50 + tick / 100 for tick in range(60)]
    assert np.median(np.diff(held_up_ms)) < 20 * (1 - PERIOD_TOLERANCE)
    assert observed(*(half_a(t_ms) for t_ms in held_up_ms)).differences(BOARD, [3]) == []


def test_readings_handed_on_after_one_long_stop_keep_their_period() -> None:
    held_up_ms = [1000 + tick / 10 if 500 <= 20 * tick < 1000 else 20 * tick for tick in range(60)]
    assert observed(*(half_a(t_ms) for t_ms in held_up_ms)).differences(BOARD, [3]) == []


def test_a_tenth_of_the_readings_lost_keeps_the_period() -> None:
    random = np.random.default_rng(1)
    came = random.random(60) > 0.1
    assert not came.all()
    assert observed(*(half_a(20 * tick) for tick in np.flatnonzero(came).tolist())).differences(BOARD, [3]) == []


def test_an_open_triangle_keeps_the_period_too() -> None:
    assert observed(*(half_b(20 * tick, status=ERROR_NOT_CONNECTED) for tick in range(2))).period_ms == pytest.approx(
        20.0
    )


def test_halves_that_came_once_have_no_period() -> None:
    assert observed(half_a(0), half_b(20), half_a(40, triangle=4), half_b(60, triangle=4)).period_ms is None
