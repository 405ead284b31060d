"""Whose a taxel is, on a foot whose boards are neither sorted nor in one piece."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.config import Board
from insole_daemon.skin.faults.places import Places
from insole_daemon.skin.geometry import THERMAL_PADS
from insole_daemon.skin.layout import Triangle, of

BOARD_OF_ROW = (9, 5, 9, 7, 5)

LAYOUT = of(
    "left",
    32.4e-6,
    None,
    tuple(
        Triangle(board=board, triangle=row, patch="sole", x_mm=20.0 * row, y_mm=0.0, rotation_deg=0.0)
        for row, board in enumerate(BOARD_OF_ROW)
    ),
)
BOARDS = {
    5: Board(address=5, interface="can0", period_ms=50, shift=1, no_load=255),
    6: Board(address=6, interface="can0", period_ms=100, shift=7, no_load=1),  # of the other foot
    7: Board(address=7, interface="can0", period_ms=20, shift=2, no_load=230),
    9: Board(address=9, interface="can0", period_ms=40, shift=3, no_load=240),
}


@pytest.fixture
def places() -> Places:
    return Places(LAYOUT, BOARDS)


def test_the_taxels_are_all_but_the_thermal_pads_triangle_by_triangle(places: Places) -> None:
    expected = [(row, pad) for row in range(len(BOARD_OF_ROW)) for pad in range(12) if pad not in THERMAL_PADS]
    assert [divmod(taxel, 12) for taxel in places.taxel.tolist()] == expected
    assert places.triangle.tolist() == [row for row, _ in expected]


def test_boards_are_in_the_order_of_the_layout(places: Places) -> None:
    assert places.addresses == (9, 5, 7)
    assert places.board_of_triangle.tolist() == [0, 1, 0, 2, 1]
    assert [places.addresses[board] for board in places.board] == np.repeat(BOARD_OF_ROW, 10).tolist()


def test_each_board_has_its_own_settings(places: Places) -> None:
    assert places.layout is LAYOUT
    assert places.period_ns.tolist() == [40_000_000, 50_000_000, 20_000_000]
    assert places.no_load.tolist() == [240, 255, 230]
    assert places.shift.tolist() == [3, 1, 2]


@pytest.mark.parametrize(
    ("of_triangle", "of_board"),
    [([1, 2, 3, 4, 5], [3, 5, 4]), ([5, 4, 3, 2, 1], [5, 4, 2]), ([-1, -2, -3, -4, -5], [-1, -2, -4])],
)
def test_the_maximum_of_a_board_is_that_of_its_highest_triangle(
    places: Places, of_triangle: list[int], of_board: list[int]
) -> None:
    assert places.most_of_board(np.array(of_triangle)).tolist() == of_board


@pytest.mark.parametrize(("row", "address"), [*enumerate(BOARD_OF_ROW)])
def test_one_triangle_is_any_of_its_board_and_of_no_other(places: Places, row: int, address: int) -> None:
    of_board = places.any_of_board(np.arange(len(BOARD_OF_ROW)) == row)
    assert np.array(places.addresses)[of_board].tolist() == [address]


def test_none_of_the_triangles_is_none_of_the_boards(places: Places) -> None:
    assert places.any_of_board(np.zeros(len(BOARD_OF_ROW), bool)).tolist() == [False] * 3
