"""The mapping procedure: a person presses position after position, and the responding triangle is identified.

A state machine over time. Its inputs are the readings of every triangle (skin.touch), its outputs prompts for the
person. It knows the positions of a template, but not which triangle is where.

    rest      all untouched: the mean reading of every triangle is its level
    press     waits until some triangle falls well below its level and stays there for a moment
    lift      waits until it returns; then the whole press is judged
    … the next position; a position without a response, or with that of another position, comes once more at the end
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping as Map
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .layout import Foot, Layout
from .touch import N_NUMBERS

# For the mean over a triangle's ten taxels. A finger of 15 mm that presses with 40 N lowers the triangle under it by 10
# counts and the next by 1 to 2 (8 kPa a count); the mean's noise is 0.3.
PRESSED_COUNT = 2.0
NOISE_FACTOR = 6.0  # a triangle that is noisy at rest must fall by this many of its standard deviations
MARGIN = 2.0  # the pressed triangle falls by at least this multiple of the second one's fall
RELEASED_SHARE = 0.3  # of the deepest fall
REST_S, HOLD_S, QUIET_S = 1.5, 0.3, 0.3
WAIT_S = 15.0  # for a press; then the position counts as missing. For a lift, until the prompt is repeated
MAX_UNCLEAR = 3  # times a position is prompted again at once because two triangles responded

Identity = tuple[int, int]  # board, triangle
PromptKind = Literal["rest", "press", "lift", "again", "answered", "missing", "done"]
State = Literal["answered", "missing", "unclear", "doubled"]


@dataclass(frozen=True, slots=True)
class Position:
    """One position of the template to press."""

    foot: Foot
    row: int  # in the template's layout
    patch: str
    number: int  # within the patch, from 1, in the template's order
    x_mm: float
    y_mm: float

    def __str__(self) -> str:
        """Name of the position for a person."""
        return f"{self.foot} foot, {self.patch} patch, position {self.number}"


def positions(layout: Layout) -> list[Position]:
    """Return the positions of a template, in its order."""
    result: list[Position] = []
    for row, t in enumerate(layout.triangles):
        number = 1 + sum(earlier.patch == t.patch for earlier in layout.triangles[:row])
        result.append(Position(layout.foot, row, t.patch, number, t.x_mm, t.y_mm))
    return result


@dataclass(frozen=True, slots=True)
class MappingPrompt:
    """A message to the person; `text` is complete."""

    kind: PromptKind
    text: str
    position: Position | None = None
    identity: Identity | None = None


@dataclass(frozen=True, slots=True)
class PositionResult:
    """The result of a position at the end."""

    position: Position
    state: State
    identity: Identity | None  # the responding triangle; None: none, or not a single one
    rivals: tuple[Position, ...] = ()  # doubled: the other positions at which the same triangle responded


class Mapping:
    """Prompts for the positions in turn; call `update` with the readings of the triangles until `is_done`."""

    def __init__(self, targets: Sequence[Position], owners: Map[int, Foot], wait_s: float = WAIT_S) -> None:
        """`owners`: the configured foot of each board."""
        self._targets = list(targets)
        self._queue = deque(targets)
        self._again: list[Position] = []  # the second time round
        self._owners = dict(owners)
        self._wait_ns = round(wait_s * 1e9)
        self._answers: dict[Position, Identity | None] = {}
        self._unclear: dict[Position, int] = {}
        self._state: PromptKind = "rest"
        self._since_ns: int | None = None
        self._rest = _Mean()
        self._level: NDArray[np.float64] = np.empty(0)
        self._bar: NDArray[np.float64] = np.empty(0)
        self._pressed_since_ns: int | None = None
        self._fall_sum: NDArray[np.float64] = np.empty(0)
        self._deepest = 0.0
        self._quiet_since_ns: int | None = None

    @property
    def is_done(self) -> bool:
        """Whether every position has been prompted for."""
        return self._state == "done"

    @property
    def position(self) -> Position | None:
        """The position to press, or being pressed, now."""
        return self._queue[0] if self._queue and self._state in ("press", "lift") else None

    def update(self, now_ns: int, level_count: NDArray[np.float64]) -> list[MappingPrompt]:
        """Process `level_count` (16, 16) by [board, triangle], NaN where unknown, and return prompts for the person."""
        level = level_count.ravel()
        if self._since_ns is None:
            self._since_ns = now_ns
            return [MappingPrompt("rest", "touch nothing: taking what every triangle reads without load")]
        step = {"rest": self._at_rest, "press": self._await_press, "lift": self._await_lift}.get(self._state)
        return step(now_ns, level) if step is not None else []

    def results(self) -> list[PositionResult]:
        """Return the result of every position, in the order of the targets."""
        where: dict[Identity, list[Position]] = {}
        for position in self._targets:
            identity = self._answers.get(position)
            if identity is not None:
                where.setdefault(identity, []).append(position)
        results = []
        for position in self._targets:
            identity = self._answers.get(position)
            if identity is None:
                state: State = "unclear" if self._unclear.get(position, 0) >= MAX_UNCLEAR else "missing"
                results.append(PositionResult(position, state, None))
            elif len(where[identity]) > 1:
                rivals = tuple(candidate for candidate in where[identity] if candidate is not position)
                results.append(PositionResult(position, "doubled", identity, rivals))
            else:
                results.append(PositionResult(position, "answered", identity))
        return results

    # ---- the three states

    def _at_rest(self, now_ns: int, level: NDArray[np.float64]) -> list[MappingPrompt]:
        assert self._since_ns is not None
        self._rest.add(level)
        if now_ns - self._since_ns < REST_S * 1e9:
            return []
        self._level = self._rest.mean()
        self._bar = np.maximum(PRESSED_COUNT, NOISE_FACTOR * self._rest.std())
        return self._next(now_ns)

    def _await_press(self, now_ns: int, level: NDArray[np.float64]) -> list[MappingPrompt]:
        assert self._since_ns is not None
        fall = self._fall(level)
        if not (fall > self._bar).any():
            self._pressed_since_ns = None
            return self._missing(now_ns) if now_ns - self._since_ns > self._wait_ns else []
        if self._pressed_since_ns is None:
            self._pressed_since_ns = now_ns
            self._fall_sum, self._deepest = np.zeros_like(fall), 0.0
        self._gather(fall)
        if now_ns - self._pressed_since_ns < HOLD_S * 1e9:
            return []
        self._state, self._since_ns, self._quiet_since_ns = "lift", now_ns, None
        winner = int(self._fall_sum.argmax())
        return [MappingPrompt("lift", f"{_name(winner)} answers: lift", self._queue[0], _identity(winner))]

    def _await_lift(self, now_ns: int, level: NDArray[np.float64]) -> list[MappingPrompt]:
        assert self._since_ns is not None
        fall = self._fall(level)
        self._gather(fall)
        winner = int(self._fall_sum.argmax())
        shallow = max(RELEASED_SHARE * self._deepest, 0.5 * self._bar[winner])
        if fall[winner] > shallow or (fall > np.maximum(shallow, self._bar)).any():
            self._quiet_since_ns = None
            if now_ns - self._since_ns <= self._wait_ns:
                return []
            self._since_ns, still = now_ns, int(fall.argmax())
            text = f"{_name(still)} still reads as if it were pressed: lift, and take away what lies on the insole"
            return [MappingPrompt("lift", text, self._queue[0], _identity(still))]
        if self._quiet_since_ns is None:
            self._quiet_since_ns, self._rest = now_ns, _Mean()
        self._rest.add(level)
        if now_ns - self._quiet_since_ns < QUIET_S * 1e9:
            return []
        rest = self._rest.mean()  # a sensor that creeps back must not count as pressed at the next position
        self._level = np.where(np.isnan(rest), self._level, rest)
        return self._judge(now_ns)

    # ---- judging a press

    def _judge(self, now_ns: int) -> list[MappingPrompt]:
        position = self._queue[0]
        order = np.argsort(self._fall_sum)
        first, second = int(order[-1]), int(order[-2])
        if self._fall_sum[second] * MARGIN > self._fall_sum[first]:
            times = self._unclear[position] = self._unclear.get(position, 0) + 1
            if times >= MAX_UNCLEAR:
                return self._settle(now_ns, None, f"{position}: two answer every time, left in doubt")
            text = (
                f"{_name(first)} and {_name(second)} answer together: press the middle of {position}, with a fingertip"
            )
            return [MappingPrompt("again", text, position), *self._prompt(now_ns)]
        identity = _identity(first)
        self._unclear.pop(position, None)
        text = f"{position}: {_name(first)}"
        owner = self._owners.get(identity[0])
        if owner is None:
            text += " – a board that the configuration does not know"
        elif owner != position.foot:
            text += f" – a board that the configuration gives to the {owner} foot"
        rival = next((p for p, i in self._answers.items() if i == identity and p != position), None)
        if rival is not None:
            text += f" – it answered at {rival} too"
            self._ask_again(rival)
            self._ask_again(position)
        return self._settle(now_ns, identity, text)

    def _missing(self, now_ns: int) -> list[MappingPrompt]:
        position = self._queue[0]
        self._unclear.pop(position, None)
        self._ask_again(position)
        return self._settle(now_ns, None, f"{position}: nothing answers", "missing")

    def _settle(
        self, now_ns: int, identity: Identity | None, text: str, kind: PromptKind = "answered"
    ) -> list[MappingPrompt]:
        position = self._queue.popleft()
        self._answers[position] = identity
        return [MappingPrompt(kind, text, position, identity), *self._next(now_ns)]

    def _ask_again(self, position: Position) -> None:
        """Append the position to the queue once: a slip is corrected, a wrong cable gives the same response."""
        if position not in self._again:
            self._again.append(position)
            self._queue.append(position)

    def _next(self, now_ns: int) -> list[MappingPrompt]:
        if not self._queue:
            self._state = "done"
            return [MappingPrompt("done", "all positions have been asked")]
        return self._prompt(now_ns)

    def _prompt(self, now_ns: int) -> list[MappingPrompt]:
        position = self._queue[0]
        self._state, self._since_ns, self._pressed_since_ns = "press", now_ns, None
        again = " once more" if position in self._answers else ""
        return [MappingPrompt("press", f"press the middle of {position}{again}, then lift", position)]

    def _fall(self, level: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fall of each triangle below its level at rest, (256,) counts; 0 where either is unknown."""
        return np.nan_to_num(self._level - level)

    def _gather(self, fall: NDArray[np.float64]) -> None:
        self._fall_sum += np.maximum(fall, 0.0)
        self._deepest = max(self._deepest, float(fall.max()))


class _Mean:
    """Mean and standard deviation of levels by triangle; NaN for a triangle that was unknown most of the time."""

    def __init__(self) -> None:
        self._values: list[NDArray[np.float64]] = []

    def add(self, level: NDArray[np.float64]) -> None:
        self._values.append(level.copy())

    def _table(self) -> NDArray[np.float64]:
        table = np.array(self._values)
        table[:, np.isnan(table).mean(axis=0) > 0.5] = np.nan
        return table

    def mean(self) -> NDArray[np.float64]:
        return np.ma.masked_invalid(self._table()).mean(axis=0).filled(np.nan)  # type: ignore[no-any-return]

    def std(self) -> NDArray[np.float64]:
        return np.ma.masked_invalid(self._table()).std(axis=0).filled(0.0)  # type: ignore[no-any-return]


def _identity(index: int) -> Identity:
    return divmod(index, N_NUMBERS)


def _name(index: int) -> str:
    board, triangle = _identity(index)
    return f"board {board} triangle {triangle}"
