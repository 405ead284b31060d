"""The layout that a mapping amounts to, and the sentences on what is not as it should be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from insole_daemon.skin.layout import Foot, Triangle, of
from insole_daemon.skin.mapping import Identity, Position, PositionResult, positions
from insole_daemon.skin.mapping_result import layout_of, summary

TEMPLATE = of(
    "left",
    3.1e-5,
    "a tenth",
    (
        Triangle(board=1, triangle=0, patch="front", x_mm=200.0, y_mm=-10.0, rotation_deg=30.0),
        Triangle(board=1, triangle=1, patch="front", x_mm=180.0, y_mm=10.0, rotation_deg=90.0, mirrored=True),
        Triangle(board=2, triangle=0, patch="rear", x_mm=20.0, y_mm=0.0, rotation_deg=210.0),
    ),
)
LEFT = positions(TEMPLATE)
RIGHT = [Position("right", row, "rear", row + 1, 30.0 * row, 0.0) for row in range(3)]
OWNERS: dict[int, Foot] = {5: "left", 6: "left", 9: "right"}


def answered(position: Position, board: int, triangle: int = 0) -> PositionResult:
    return PositionResult(position, "answered", (board, triangle))


def lines(
    *results: PositionResult,
    streaming: Sequence[Identity] = (),
    faulty: Sequence[Identity] = (),
    owners: dict[int, Foot] = OWNERS,
) -> list[str]:
    return summary(results, owners, streaming, faulty)


# ---- the layout


def test_the_layout_has_the_responding_triangle_at_the_position_of_the_template() -> None:
    results = [answered(LEFT[2], 6, 11), answered(LEFT[0], 9, 3), answered(LEFT[1], 5, 15)]
    layout = layout_of(TEMPLATE, results)
    assert layout is not None
    assert layout.triangles == (
        Triangle(board=6, triangle=11, patch="rear", x_mm=20.0, y_mm=0.0, rotation_deg=210.0),
        Triangle(board=9, triangle=3, patch="front", x_mm=200.0, y_mm=-10.0, rotation_deg=30.0),
        Triangle(board=5, triangle=15, patch="front", x_mm=180.0, y_mm=10.0, rotation_deg=90.0, mirrored=True),
    )
    np.testing.assert_array_equal(layout.xy_m, TEMPLATE.xy_m[[2, 0, 1]])
    assert (layout.foot, layout.area_meaning) == ("left", "a tenth")
    assert layout.taxel_area_m2 == pytest.approx(3.1e-5)


def test_a_layout_is_of_one_foot_and_without_the_positions_in_doubt() -> None:
    results = [
        answered(RIGHT[0], 9, 3),
        PositionResult(LEFT[0], "doubled", (5, 1), (LEFT[2],)),
        answered(LEFT[1], 5, 15),
        PositionResult(LEFT[2], "doubled", (5, 1), (LEFT[0],)),
        PositionResult(RIGHT[1], "missing", None),
    ]
    layout = layout_of(TEMPLATE, results)
    assert layout is not None
    assert [(t.board, t.triangle, t.x_mm) for t in layout.triangles] == [(5, 15, 180.0)]


@pytest.mark.parametrize(
    "results",
    [
        [],
        [answered(RIGHT[0], 9)],
        [PositionResult(LEFT[0], "missing", None), PositionResult(LEFT[1], "unclear", None)],
        [
            PositionResult(LEFT[0], "doubled", (5, 1), (LEFT[1],)),
            PositionResult(LEFT[1], "doubled", (5, 1), (LEFT[0],)),
        ],
    ],
)
def test_without_a_position_with_a_response_no_layout_is_written(results: list[PositionResult]) -> None:
    assert layout_of(TEMPLATE, results) is None


# ---- the sentences


def test_a_complete_mapping_gives_no_sentence() -> None:
    results = [answered(LEFT[0], 5), answered(LEFT[1], 6), answered(RIGHT[0], 9)]
    assert lines(*results, streaming=[(5, 0), (6, 0), (9, 0)]) == []
    assert lines() == []


def test_missing_and_doubtful_positions_are_reported_in_the_order_asked() -> None:
    assert lines(
        PositionResult(LEFT[1], "unclear", None), answered(LEFT[0], 5), PositionResult(LEFT[2], "missing", None)
    ) == [
        "in doubt: left foot, front patch, position 2: two answered every time",
        "missing: left foot, rear patch, position 1: nothing answered; is its triangle enabled, and connected?",
    ]


def test_a_triangle_with_several_responses_is_reported_once_with_all_places() -> None:
    results = [
        PositionResult(LEFT[0], "doubled", (5, 1), (LEFT[2], LEFT[1])),
        PositionResult(RIGHT[0], "doubled", (9, 7), (RIGHT[1],)),
        PositionResult(LEFT[1], "doubled", (5, 1), (LEFT[0], LEFT[2])),
        PositionResult(LEFT[2], "doubled", (5, 1), (LEFT[0], LEFT[1])),
        PositionResult(RIGHT[1], "doubled", (9, 7), (RIGHT[0],)),
    ]
    advice = "left out there; look for two triangles with one address"
    assert lines(*results) == [
        f"doubled: board 5 triangle 1 answers at {LEFT[0]}; {LEFT[2]}; {LEFT[1]}: {advice}",
        f"doubled: board 9 triangle 7 answers at {RIGHT[0]}; {RIGHT[1]}: {advice}",
    ]


def test_boards_that_lie_in_the_other_foot_are_swapped() -> None:
    advice = "move it there in the configuration, or plug the insoles the other way round"
    assert lines(answered(LEFT[0], 9), answered(RIGHT[0], 6), answered(LEFT[1], 9, 1), answered(LEFT[2], 5)) == [
        f"swapped: board 6 lies in the right foot, the configuration gives it to the left foot: {advice}",
        f"swapped: board 9 lies in the left foot, the configuration gives it to the right foot: {advice}",
    ]


def test_a_board_that_lies_in_both_feet_is_swapped_in_part() -> None:
    question = "was the other foot pressed, or is a patch plugged into the wrong board?"
    results = [answered(LEFT[0], 5), answered(RIGHT[0], 5, 1), answered(LEFT[1], 5, 2), answered(RIGHT[1], 9)]
    assert lines(*results) == [
        f"swapped: board 5 of the left foot answered at 3 positions, 1 of them in the right foot: {question}"
    ]


def test_a_second_response_also_shows_in_which_foot_a_board_lies() -> None:
    results = [
        PositionResult(LEFT[0], "doubled", (9, 1), (LEFT[1],)),
        PositionResult(LEFT[1], "doubled", (9, 1), (LEFT[0],)),
    ]
    assert [line.split(",")[0] for line in lines(*results)][1:] == ["swapped: board 9 lies in the left foot"]


def test_a_board_that_is_not_configured_is_reported_with_its_feet() -> None:
    results = [answered(RIGHT[0], 12), answered(RIGHT[1], 12, 1), answered(LEFT[0], 5)]
    assert lines(*results) == ["unknown: board 12 lies in the right foot: add it to the boards there"]
    assert lines(*results, answered(LEFT[1], 12, 2)) == [
        "unknown: board 12 lies in the left and the right foot: add it to the boards there"
    ]


def test_triangles_that_report_themselves_open_or_dead_are_listed() -> None:
    assert lines(streaming=[(6, 2), (5, 11)], faulty=[(6, 2), (5, 11)]) == [
        "open or dead by their own report: board 5 triangle 11, board 6 triangle 2"
    ]


def test_streaming_triangles_without_a_position_are_reported_unless_faulty() -> None:
    results = [
        answered(LEFT[0], 5, 1),
        PositionResult(LEFT[1], "doubled", (6, 2), (LEFT[2],)),
        PositionResult(RIGHT[0], "missing", None),
    ]
    streaming = [(9, 4), (5, 1), (6, 2), (5, 9), (6, 3)]
    assert lines(*results, streaming=streaming, faulty=[(6, 3)])[2:] == [
        "open or dead by their own report: board 6 triangle 3",
        "streaming, but found at no position: board 5 triangle 9, board 9 triangle 4",
    ]


def test_the_sentences_stand_in_one_order() -> None:
    results = [
        answered(LEFT[0], 12, 1),
        PositionResult(RIGHT[0], "doubled", (9, 1), (RIGHT[1],)),
        PositionResult(RIGHT[1], "doubled", (9, 1), (RIGHT[0],)),
        PositionResult(LEFT[1], "missing", None),
    ]
    sentences = lines(*results, streaming=[(5, 0), (5, 1)], faulty=[(5, 1)])
    assert [line.split(":")[0] for line in sentences] == [
        "missing", "doubled", "unknown", "open or dead by their own report", "streaming, but found at no position",
    ]  # fmt: skip
