"""Who answers a press: the mapping alone, with what the triangles read worked out by hand."""

from __future__ import annotations

from collections.abc import Mapping as Map
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.skin.layout import Foot, Triangle, of
from insole_daemon.skin.mapping import (
    HOLD_S,
    MARGIN,
    MAX_UNCLEAR,
    NOISE_FACTOR,
    PRESSED_COUNT,
    QUIET_S,
    RELEASED_SHARE,
    REST_S,
    WAIT_S,
    Identity,
    Mapping,
    MappingPrompt,
    Position,
    PositionResult,
    positions,
)

REST_NS, HOLD_NS, QUIET_NS, WAIT_NS = (round(s * 1e9) for s in (REST_S, HOLD_S, QUIET_S, WAIT_S))
STEP_NS = 50_000_000
N_AT_REST = REST_NS // STEP_NS
UNLOADED = 240.0
DEEP = 20.0  # what a finger takes from the triangle under it
FEW = 0.01

FIRST = Position("left", 0, "front", 1, 200.0, -10.0)
SECOND = Position("left", 1, "front", 2, 180.0, 10.0)
THIRD = Position("right", 0, "rear", 1, 20.0, 0.0)
ASKED = (FIRST, SECOND, THIRD)
A, B, C = (5, 12), (9, 3), (5, 0)
OWNERS: dict[int, Foot] = {5: "left", 9: "right"}


def reads(falls: Map[Identity, float]) -> NDArray[np.float64]:
    """(16, 16) what the triangles read when some of them have fallen by so much; NaN: nothing is known of it."""
    level = np.full((16, 16), UNLOADED)
    for identity, fall in falls.items():
        level[identity] -= fall
    return level


class Person:
    """Sits before a mapping: shows it what the triangles read, and hears what it says."""

    def __init__(self, asked: Sequence[Position] = ASKED, wait_s: float = WAIT_S) -> None:
        self.mapping = Mapping(asked, OWNERS, wait_s)
        self.now_ns = 7_000_000_000_000

    def shows(self, falls: Map[Identity, float] | None = None, after_ns: int = STEP_NS) -> list[MappingPrompt]:
        self.now_ns += after_ns
        return self.mapping.update(self.now_ns, reads(falls or {}))

    def waits(self, for_ns: int, falls: Map[Identity, float] | None = None) -> list[MappingPrompt]:
        """Shows it at once, and on and on until it has stood for so long."""
        return [prompt for _ in range(for_ns // STEP_NS + 1) for prompt in self.shows(falls)]

    def presses(self, falls: Map[Identity, float]) -> list[MappingPrompt]:
        return self.waits(HOLD_NS, falls)

    def lifts(self) -> list[MappingPrompt]:
        return self.waits(QUIET_NS)

    def answers(self, *falls: Map[Identity, float]) -> list[MappingPrompt]:
        """Press upon press."""
        return [prompt for fall in falls for prompt in (*self.presses(fall), *self.lifts())]

    def stays_away(self) -> list[MappingPrompt]:
        return [*self.shows(after_ns=WAIT_NS), *self.shows(after_ns=1)]


def ready(asked: Sequence[Position] = ASKED, *, noise: Map[Identity, float] | None = None) -> Person:
    """A person who is to press the first position; at rest some triangles had such a standard deviation."""
    person = Person(asked)
    assert [prompt.kind for prompt in person.shows()] == ["rest"]
    for at in range(N_AT_REST):
        sign = 1 if at % 2 else -1
        prompts = person.shows({identity: sign * std for identity, std in (noise or {}).items()})
    assert [prompt.kind for prompt in prompts] == ["press"]
    return person


def kinds(prompts: Sequence[MappingPrompt]) -> list[str]:
    return [prompt.kind for prompt in prompts]


# ---- positions


def test_positions_are_numbered_within_their_patch_in_the_order_of_the_template() -> None:
    patches = ["rear", "front", "rear", "rear", "front"]
    triangles = tuple(
        Triangle(board=3, triangle=row, patch=patch, x_mm=10.0 * row, y_mm=5.0 - row, rotation_deg=0.0)
        for row, patch in enumerate(patches)
    )
    assert positions(of("right", 1e-5, None, triangles)) == [
        Position("right", 0, "rear", 1, 0.0, 5.0),
        Position("right", 1, "front", 1, 10.0, 4.0),
        Position("right", 2, "rear", 2, 20.0, 3.0),
        Position("right", 3, "rear", 3, 30.0, 2.0),
        Position("right", 4, "front", 2, 40.0, 1.0),
    ]


# ---- a whole round


def test_a_mapping_gives_the_expected_prompts_from_first_to_last() -> None:
    person = Person([FIRST, THIRD])
    prompts = [*person.waits(REST_NS), *person.answers({A: DEEP}, {B: DEEP})]
    assert prompts == [
        MappingPrompt("rest", "touch nothing: taking what every triangle reads without load"),
        MappingPrompt("press", "press the middle of left foot, front patch, position 1, then lift", FIRST),
        MappingPrompt("lift", "board 5 triangle 12 answers: lift", FIRST, A),
        MappingPrompt("answered", "left foot, front patch, position 1: board 5 triangle 12", FIRST, A),
        MappingPrompt("press", "press the middle of right foot, rear patch, position 1, then lift", THIRD),
        MappingPrompt("lift", "board 9 triangle 3 answers: lift", THIRD, B),
        MappingPrompt("answered", "right foot, rear patch, position 1: board 9 triangle 3", THIRD, B),
        MappingPrompt("done", "all positions have been asked"),
    ]
    assert person.mapping.results() == [PositionResult(FIRST, "answered", A), PositionResult(THIRD, "answered", B)]


def test_the_position_is_known_while_it_is_to_be_pressed_and_while_it_is() -> None:
    person = Person([FIRST, THIRD])
    person.shows()
    assert person.mapping.position is None
    person.waits(REST_NS - STEP_NS)
    assert person.mapping.position is FIRST
    person.presses({A: DEEP})
    assert person.mapping.position is FIRST
    person.lifts()
    assert person.mapping.position is THIRD
    assert not person.mapping.is_done
    person.answers({B: DEEP})
    assert person.mapping.position is None
    assert person.mapping.is_done


def test_a_finished_mapping_prompts_no_more() -> None:
    person = ready([FIRST])
    person.answers({A: DEEP})
    assert person.answers({B: DEEP}) == []
    assert person.stays_away() == []
    assert person.mapping.results() == [PositionResult(FIRST, "answered", A)]


def test_a_mapping_without_positions_ends_after_the_rest() -> None:
    person = Person([])
    assert kinds(person.waits(REST_NS)) == ["rest", "done"]
    assert person.mapping.is_done
    assert person.mapping.results() == []


# ---- rest


def test_the_rest_lasts_its_time() -> None:
    person = Person()
    assert kinds(person.shows()) == ["rest"]
    assert person.shows(after_ns=REST_NS - 1) == []
    assert kinds(person.shows(after_ns=1)) == ["press"]


def test_the_level_is_what_a_triangle_reads_at_rest_on_average() -> None:
    person = Person()
    person.shows()
    for at in range(N_AT_REST):
        person.shows({A: 7.0 if at % 2 else 8.0})
    bar = max(PRESSED_COUNT, NOISE_FACTOR * 0.5)
    assert person.presses({A: 7.5 + bar - FEW}) == []
    assert kinds(person.presses({A: 7.5 + bar + FEW})) == ["lift"]


def test_the_array_that_is_shown_may_be_used_again() -> None:
    person = Person()
    level = np.empty((16, 16))
    person.shows()
    for at in range(N_AT_REST):
        level[:] = UNLOADED
        person.mapping.update(person.now_ns + (at + 1) * STEP_NS, level)
        level[:] = 0.0
    person.now_ns += REST_NS
    assert kinds(person.presses({A: PRESSED_COUNT + FEW})) == ["lift"]


@pytest.mark.parametrize(("n_unknown", "answers"), [(N_AT_REST // 2 - 1, True), (N_AT_REST // 2 + 1, False)])
def test_a_triangle_that_was_unknown_for_more_than_half_of_the_rest_does_not_answer(
    n_unknown: int, answers: bool
) -> None:
    person = Person()
    person.shows()
    for at in range(N_AT_REST):
        person.shows({A: np.nan if at < n_unknown else 0.0})
    assert kinds(person.presses({A: 100.0})) == (["lift"] if answers else [])


# ---- press


@pytest.mark.parametrize(
    ("std", "bar"),
    [
        (0.0, PRESSED_COUNT),
        (PRESSED_COUNT / NOISE_FACTOR / 2, PRESSED_COUNT),
        (1.0, NOISE_FACTOR),
        (2.0, 2 * NOISE_FACTOR),
    ],
)
def test_the_bar_is_the_least_count_or_so_many_standard_deviations(std: float, bar: float) -> None:
    person = ready(noise={A: std})
    assert person.presses({A: bar}) == []
    assert kinds(person.presses({A: bar + FEW})) == ["lift"]


def test_the_noise_of_one_triangle_does_not_raise_the_bar_of_another() -> None:
    prompts = ready(noise={A: 2.0}).presses({B: PRESSED_COUNT + FEW})
    assert [(prompt.kind, prompt.identity) for prompt in prompts] == [("lift", B)]


def test_a_triangle_that_rises_is_not_pressed() -> None:
    assert ready().presses({A: -DEEP}) == []


def test_a_triangle_that_falls_silent_is_not_pressed() -> None:
    assert ready().presses({A: np.nan}) == []


def test_a_press_is_held_for_its_time() -> None:
    person = ready()
    assert person.shows({A: DEEP}) == []
    assert person.shows({A: DEEP}, HOLD_NS - 1) == []
    assert kinds(person.shows({A: DEEP}, 1)) == ["lift"]


def test_a_press_that_is_let_go_of_begins_anew() -> None:
    person = ready()
    person.shows({A: DEEP})
    person.shows({A: DEEP}, HOLD_NS - 1)
    assert person.shows() == []
    assert person.shows({A: DEEP}) == []
    assert person.shows({A: DEEP}, HOLD_NS - 1) == []
    assert kinds(person.shows({A: DEEP}, 1)) == ["lift"]


def test_a_released_touch_does_not_count() -> None:
    person = ready()
    for _ in range(3):
        person.shows({A: DEEP})
    person.shows()
    assert kinds(prompts := person.answers({B: PRESSED_COUNT + FEW})) == ["lift", "answered", "press"]
    assert [prompt.identity for prompt in prompts[:2]] == [B, B]


def test_the_triangle_with_the_largest_fall_over_the_press_responds() -> None:
    person = ready()
    person.waits(HOLD_NS - STEP_NS, {A: DEEP})
    assert [prompt.identity for prompt in person.shows({A: DEEP, B: DEEP + 5})] == [A]


# ---- lift


@pytest.mark.parametrize(
    ("std", "fall", "back"),
    [
        (0.0, DEEP, RELEASED_SHARE * DEEP),
        (0.0, PRESSED_COUNT + FEW, PRESSED_COUNT / 2),
        (1.0, NOISE_FACTOR + 1, NOISE_FACTOR / 2),
    ],
    ids=["a share of the deepest fall", "half the bar of a light press", "half the bar of a noisy triangle"],
)
def test_a_triangle_counts_as_lifted_when_it_has_returned_to(std: float, fall: float, back: float) -> None:
    person = ready(noise={A: std})
    person.presses({A: fall})
    assert person.waits(QUIET_NS, {A: back + FEW}) == []
    assert kinds(person.waits(QUIET_NS, {A: back})) == ["answered", "press"]


@pytest.mark.parametrize("deep_while", ["held", "waiting for the lift"])
def test_the_deepest_fall_is_that_of_the_whole_press(deep_while: str) -> None:
    person = ready()
    falls = [DEEP, 5.0] if deep_while == "held" else [5.0, DEEP]
    person.shows({A: falls[0]})
    person.presses({A: 5.0})
    person.shows({A: falls[1]})
    assert kinds(person.waits(QUIET_NS, {A: RELEASED_SHARE * DEEP})) == ["answered", "press"]


def test_the_deepest_fall_is_that_of_this_press() -> None:
    person = ready()
    person.answers({A: 2 * DEEP})
    person.presses({B: DEEP})
    assert person.waits(QUIET_NS, {B: 2 * RELEASED_SHARE * DEEP}) == []


@pytest.mark.parametrize(
    ("std", "back"),
    [(0.0, RELEASED_SHARE * DEEP), (2.0, 2 * NOISE_FACTOR)],
    ids=["the share of the deepest fall", "its own bar"],
)
def test_another_that_is_still_pressed_is_waited_for_until_it_is_back_to(std: float, back: float) -> None:
    person = ready(noise={B: std})
    person.waits(10 * HOLD_NS, {A: DEEP})
    assert person.waits(QUIET_NS, {B: back + FEW}) == []
    assert person.waits(QUIET_NS, {B: back}) != []


def test_a_triangle_that_falls_silent_under_the_finger_counts_as_lifted() -> None:
    person = ready()
    person.presses({A: DEEP})
    prompts = person.waits(QUIET_NS, {A: np.nan})
    assert [(prompt.kind, prompt.identity) for prompt in prompts] == [("answered", A), ("press", None)]


def test_board_is_judged_after_the_quiet_time() -> None:
    person = ready()
    person.presses({A: DEEP})
    assert person.shows() == []
    assert person.shows(after_ns=QUIET_NS - 1) == []
    assert person.shows({A: DEEP}) == []
    assert person.shows() == []
    assert person.shows(after_ns=QUIET_NS - 1) == []
    assert kinds(person.shows(after_ns=1)) == ["answered", "press"]


def test_a_sensor_that_creeps_back_is_not_pressed_at_the_next_position() -> None:
    person = ready()
    person.presses({A: DEEP})
    creep = RELEASED_SHARE * DEEP - 1
    person.waits(QUIET_NS, {A: creep})
    assert person.presses({A: creep + PRESSED_COUNT}) == []
    assert kinds(person.presses({A: creep + PRESSED_COUNT + FEW})) == ["lift"]


def test_the_new_level_is_that_of_the_last_quiet_time() -> None:
    person = ready()
    person.presses({A: DEEP})
    person.waits(QUIET_NS - STEP_NS, {A: RELEASED_SHARE * DEEP})
    person.shows({A: DEEP})
    person.lifts()
    assert kinds(person.presses({A: PRESSED_COUNT + FEW})) == ["lift"]


def test_a_triangle_that_was_silent_in_the_quiet_time_keeps_its_level() -> None:
    person = ready()
    person.presses({A: DEEP})
    person.waits(QUIET_NS, {B: np.nan})
    assert person.presses({B: PRESSED_COUNT}) == []
    assert kinds(person.presses({B: PRESSED_COUNT + FEW})) == ["lift"]


def test_a_triangle_that_was_silent_at_rest_can_answer_from_the_next_lift_on() -> None:
    person = Person()
    person.waits(REST_NS, {B: np.nan})
    assert person.presses({B: 100.0}) == [], "nobody knows from where it fell"
    person.answers({A: DEEP})
    assert person.presses({B: PRESSED_COUNT}) == []
    assert kinds(person.presses({B: PRESSED_COUNT + FEW})) == ["lift"]


def test_an_overdue_lift_repeats_the_prompt() -> None:
    person = ready()
    person.presses({A: DEEP})
    still = MappingPrompt(
        "lift", "board 9 triangle 3 still reads as if it were pressed: lift, and take away what lies on the insole",
        FIRST, B,
    )  # fmt: skip
    for _ in range(2):
        assert person.shows({B: DEEP}, WAIT_NS) == []
        assert person.shows({A: DEEP - 1, B: DEEP}, 1) == [still]
    assert kinds(person.lifts()) == ["answered", "press"]


# ---- one alone, or two


def test_the_margin_is_enough() -> None:
    prompts = ready().answers({A: DEEP, B: DEEP / MARGIN})
    assert [(prompt.kind, prompt.identity) for prompt in prompts] == [("lift", A), ("answered", A), ("press", None)]


def test_a_rise_does_not_reduce_the_largest_fall() -> None:
    person = ready()
    person.presses({A: DEEP, B: DEEP / MARGIN})
    person.shows({A: -10 * DEEP})
    assert [prompt.identity for prompt in person.lifts()] == [A, None]


def test_two_that_answer_together_are_asked_for_again_at_once() -> None:
    person = ready()
    falls = {B: DEEP, A: DEEP / MARGIN + FEW, C: DEEP / MARGIN}
    assert person.answers(falls)[1:] == [
        MappingPrompt(
            "again",
            "board 9 triangle 3 and board 5 triangle 12 answer together: "
            "press the middle of left foot, front patch, position 1, with a fingertip",
            FIRST,
        ),
        MappingPrompt("press", "press the middle of left foot, front patch, position 1, then lift", FIRST),
    ]
    assert person.answers({C: DEEP})[1] == MappingPrompt(
        "answered", "left foot, front patch, position 1: board 5 triangle 0", FIRST, C
    )


def test_two_that_answer_every_time_leave_the_position_in_doubt() -> None:
    person = ready([FIRST, THIRD])
    both = {A: DEEP, B: DEEP}
    assert kinds(person.answers(*[both] * (MAX_UNCLEAR - 1))) == ["lift", "again", "press"] * (MAX_UNCLEAR - 1)
    prompts = person.answers(both)
    assert kinds(prompts) == ["lift", "answered", "press"]
    assert prompts[1] == MappingPrompt(
        "answered", "left foot, front patch, position 1: two answer every time, left in doubt", FIRST
    )
    assert prompts[2].position is THIRD
    person.answers({B: DEEP})
    assert person.mapping.results() == [PositionResult(FIRST, "unclear", None), PositionResult(THIRD, "answered", B)]


def test_a_clear_response_replaces_an_ambiguous_one() -> None:
    person = ready([FIRST, SECOND])
    both = {A: DEEP, B: DEEP}
    person.answers(*[both] * (MAX_UNCLEAR - 1), {A: DEEP})
    person.answers({A: DEEP})
    assert person.mapping.position is FIRST, "once more, since both positions were answered by the same"
    assert kinds(person.answers(*[both] * (MAX_UNCLEAR - 1))) == ["lift", "again", "press"] * (MAX_UNCLEAR - 1)


def test_unclear_now_and_then_is_missing_when_nothing_answers_in_the_end() -> None:
    person = ready([FIRST])
    person.answers(*[{A: DEEP, B: DEEP}] * (MAX_UNCLEAR - 1))
    person.stays_away()
    person.stays_away()
    assert person.mapping.is_done
    assert person.mapping.results() == [PositionResult(FIRST, "missing", None)]


def test_unclear_before_nothing_answered_does_not_count_afterwards() -> None:
    person = ready([FIRST])
    both = {A: DEEP, B: DEEP}
    person.answers(*[both] * (MAX_UNCLEAR - 1))
    person.stays_away()
    assert kinds(person.answers(*[both] * (MAX_UNCLEAR - 1))) == ["lift", "again", "press"] * (MAX_UNCLEAR - 1)


# ---- whose board it is


@pytest.mark.parametrize(
    ("position", "identity", "remark"),
    [
        (FIRST, A, ""),
        (FIRST, B, " – a board that the configuration gives to the right foot"),
        (THIRD, A, " – a board that the configuration gives to the left foot"),
        (THIRD, (12, 5), " – a board that the configuration does not know"),
    ],
)
def test_a_board_of_another_foot_or_none_is_reported_and_its_response_used(
    position: Position, identity: Identity, remark: str
) -> None:
    person = ready([position])
    board, triangle = identity
    text = f"{position}: board {board} triangle {triangle}{remark}"
    assert person.answers({identity: DEEP})[1] == MappingPrompt("answered", text, position, identity)
    assert person.mapping.results() == [PositionResult(position, "answered", identity)]


# ---- once more at the end


def test_two_positions_with_the_same_answer_are_both_asked_once_more_at_the_end() -> None:
    person = ready()
    person.answers({A: DEEP})
    assert person.answers({A: DEEP})[1:] == [
        MappingPrompt(
            "answered",
            "left foot, front patch, position 2: board 5 triangle 12 "
            "– it answered at left foot, front patch, position 1 too",
            SECOND,
            A,
        ),
        MappingPrompt("press", "press the middle of right foot, rear patch, position 1, then lift", THIRD),
    ]
    assert person.answers({B: DEEP})[-1] == MappingPrompt(
        "press", "press the middle of left foot, front patch, position 1 once more, then lift", FIRST
    )
    assert person.answers({C: DEEP})[-1].position is SECOND
    assert person.answers({A: DEEP})[1:] == [
        MappingPrompt("answered", "left foot, front patch, position 2: board 5 triangle 12", SECOND, A),
        MappingPrompt("done", "all positions have been asked"),
    ]
    assert [(result.state, result.identity) for result in person.mapping.results()] == [
        ("answered", C), ("answered", A), ("answered", B),
    ]  # fmt: skip


@pytest.mark.parametrize("asked", [(FIRST, SECOND), ASKED], ids=["two", "three"])
def test_the_same_answer_time_and_again_is_doubled_and_not_asked_a_third_time(asked: Sequence[Position]) -> None:
    person = ready(asked)
    person.answers(*[{A: DEEP}] * (2 * len(asked)))
    assert person.mapping.is_done
    assert person.mapping.results() == [
        PositionResult(position, "doubled", A, tuple(other for other in asked if other is not position))
        for position in asked
    ]


def test_a_board_of_the_other_foot_and_a_second_response_are_both_reported() -> None:
    person = ready([THIRD, FIRST])
    person.answers({B: DEEP})
    assert person.answers({B: DEEP})[1].text == (
        "left foot, front patch, position 1: board 9 triangle 3 – a board that the configuration gives to the right "
        "foot – it answered at right foot, rear patch, position 1 too"
    )


def test_of_two_doubled_positions_one_stays_answered_if_the_other_becomes_missing() -> None:
    person = ready([FIRST, SECOND])
    person.answers({A: DEEP}, {A: DEEP})
    person.stays_away()
    person.answers({A: DEEP})
    assert person.mapping.is_done
    assert person.mapping.results() == [PositionResult(FIRST, "missing", None), PositionResult(SECOND, "answered", A)]


def test_no_response_is_accepted_after_the_wait() -> None:
    person = ready([FIRST, THIRD])
    assert person.shows(after_ns=WAIT_NS) == []
    assert person.shows(after_ns=1) == [
        MappingPrompt("missing", "left foot, front patch, position 1: nothing answers", FIRST),
        MappingPrompt("press", "press the middle of right foot, rear patch, position 1, then lift", THIRD),
    ]
    assert person.answers({B: DEEP})[-1] == MappingPrompt(
        "press", "press the middle of left foot, front patch, position 1 once more, then lift", FIRST
    )
    assert kinds(person.stays_away()) == ["missing", "done"], "no third time"
    assert person.mapping.results() == [PositionResult(FIRST, "missing", None), PositionResult(THIRD, "answered", B)]


def test_the_wait_is_as_long_as_is_asked_for() -> None:
    person = Person(wait_s=2.5)
    person.waits(REST_NS)
    assert person.shows(after_ns=2_500_000_000) == []
    assert kinds(person.shows(after_ns=1)) == ["missing", "press"]


def test_every_position_has_the_whole_wait_for_itself() -> None:
    person = ready()
    person.shows(after_ns=WAIT_NS)
    person.answers({A: DEEP})
    assert person.shows(after_ns=WAIT_NS) == []
    assert kinds(person.shows(after_ns=1)) == ["missing", "press"]


def test_a_press_at_the_end_of_the_wait_is_still_taken() -> None:
    person = ready()
    assert person.shows({A: DEEP}, WAIT_NS) == []
    assert kinds(person.presses({A: DEEP})) == ["lift"]
