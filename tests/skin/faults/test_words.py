"""The sentences on a fault: who, what happened, what it costs, what to do."""

from __future__ import annotations

import pytest

from insole_daemon.skin.faults.words import describe_fault
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
                "board 6 triangle 0 taxel 4 does not respond to load: it is left out, 0.4 % of the area; "
                "if more follow on this triangle, replace it"
            ),
        ),
        (
            "taxel_stuck",
            (5, 15, 0),
            (
                "board 5 triangle 15 taxel 0 is constant while its neighbours change: it is left out, "
                "0.4 % of the area; if more follow on this triangle, replace it"
            ),
        ),
        (
            "taxel_saturated",
            (7, 2, 11),
            (
                "board 7 triangle 2 taxel 11 reads the end of its range: it is left out, 0.4 % of the area; "
                "if it stays there without load, zero the insole; if it comes with the load, raise the board's shift"
            ),
        ),
        (
            "board_address_clash",
            (5, None, None),
            (
                "board 5 sends about twice as often as it should, so two boards use this address: "
                "its 120 taxels are left out, 42.9 % of the area; "
                "give one of them another address, or, if there is only one, correct its period in the configuration"
            ),
        ),
        (
            "board_rezeroed",
            (7, None, None),
            (
                "board 7 took a new zero while it was loaded, and is wrong by that load until it is zeroed again: "
                "its 110 taxels are left out, 39.3 % of the area; lift the foot and zero the insole"
            ),
        ),
        (
            "board_reset",
            (7, None, None),
            (
                "board 7 was silent and sends again, so it restarted or was unplugged: its readings are used, "
                "nothing is left out; look at its power, and zero the insole while nobody stands on it"
            ),
        ),
    ],
)
def test_a_fault_that_began(kind, place, sentence):
    assert describe_fault(LAYOUT, kind, *place, began=True, lasted_s=None) == sentence


def test_a_board_that_is_silent_costs_its_share_of_the_area():
    taxels = 10 * sum(triangle.board == 6 for triangle in LAYOUT.triangles)
    text = describe_fault(LAYOUT, "board_silent", 6, None, None, began=True, lasted_s=None)
    assert text == (
        f"board 6 sends nothing: its {taxels} taxels are left out, {100 * taxels / 280:.1f} % of the area; "
        "look at its power and its CAN connector"
    )


@pytest.mark.parametrize(
    ("kind", "place", "sentence"),
    [
        ("board_silent", (6, None, None), "board 6 sends again"),
        ("board_reset", (7, None, None), "board 7 has sent steadily since it came back"),
        ("board_address_clash", (5, None, None), "board 5 is alone on its address again"),
        ("board_rezeroed", (5, None, None), "board 5 reads its unloaded levels again and is used"),
        ("triangle_loose", (5, 0, None), "board 5 triangle 0 is connected again"),
        ("taxel_dead", (7, 14, 0), "board 7 triangle 14 taxel 0 responds again"),
        ("taxel_stuck", (6, 0, 4), "board 6 triangle 0 taxel 4 changes again"),
        ("taxel_saturated", (6, 15, 11), "board 6 triangle 15 taxel 11 is back in its range"),
    ],
)
def test_a_fault_that_healed(kind, place, sentence):
    assert describe_fault(LAYOUT, kind, *place, began=False, lasted_s=3.26) == f"{sentence}, after 3.3 s"
    assert describe_fault(LAYOUT, kind, *place, began=False, lasted_s=0.0) == f"{sentence}, after 0.0 s"


def test_a_board_that_is_first_heard():
    assert describe_fault(LAYOUT, "board_silent", 6, None, None, began=False, lasted_s=None) == "board 6 sends"
