"""The sentences on a fault: who, what happened, what it costs, what to do."""

from __future__ import annotations

import pytest

from insole_daemon.skin.faults.words import describe
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))  # 28 triangles of ten taxels


@pytest.mark.parametrize(
    ("kind", "place", "sentence"),
    [
        (
            "triangle_loose",
            (5, 3, None),
            "board 5 triangle 3 came loose: its 10 taxels are left out, 3.6 % of the area; check its connector",
        ),
        (
            "taxel_dead",
            (6, 0, 4),
            (
                "board 6 triangle 0 taxel 4 does not answer to load: it is left out, 0.4 % of the area; "
                "if more follow on this triangle, replace it"
            ),
        ),
        (
            "board_reset",
            (7, None, None),
            (
                "board 7 was silent and sends again, so it restarted or was unplugged: its readings are believed, "
                "nothing is left out; look at its power, and zero the insole while nobody stands on it"
            ),
        ),
    ],
)
def test_a_fault_that_began(kind, place, sentence):
    assert describe(LAYOUT, kind, *place, began=True, lasted_s=None) == sentence


def test_a_board_that_is_silent_costs_its_share_of_the_area():
    taxels = 10 * sum(triangle.board == 6 for triangle in LAYOUT.triangles)
    found = describe(LAYOUT, "board_silent", 6, None, None, began=True, lasted_s=None)
    assert found == (
        f"board 6 sends nothing: its {taxels} taxels are left out, {100 * taxels / 280:.1f} % of the area; "
        "look at its power and its CAN connector"
    )


def test_a_fault_that_healed():
    healed = describe(LAYOUT, "taxel_stuck", 6, 0, 4, began=False, lasted_s=3.26)
    assert healed == "board 6 triangle 0 taxel 4 moves again, after 3.3 s"
    assert describe(LAYOUT, "board_silent", 6, None, None, began=False, lasted_s=None) == "board 6 sends"
