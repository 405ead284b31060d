"""Injected faults of an insole: a fault changes raw words, a board's state or its stream, never counts.

    kind           effect on the readings or the board, from `t_s` until `until_s`
    loose          0xFFFF on the whole triangle: its data line is open. Only if the mean of its pressure taxels is
                   at least `level_pa`, if given, and at a fraction `chance` of the ticks
    dead_chip      0 on the whole triangle, at a fraction `chance` of the ticks. The firmware counts errors: after
                   five of them it zeroes the board by itself, see board.py
    dead           the taxel stays unloaded: a constant word, no response
    stuck          a constant word, as under `level_pa` (may be negative), by default 100 kPa
    saturated      0xFFFF, full scale, from `level_pa` on; without it, always
    noisy          `factor` times the noise
    rezero         the board takes a new baseline under any load, at its first tick from `t_s` on; an MTB3 is
                   silent meanwhile. It has no duration: `until_s` is None
    silent         no frames sent or received: a cable is out. Its clock and its settings stay
    reset          the board loses power at `t_s`, is up again at `until_s` (None: half a second later) and then
                   `comes_back`: "silent", with the firmware's settings, until commanded; "defaults", streaming
                   with them, as if a host had only sent SET_TXMODE; or "configured", streaming as before with a
                   new baseline, as if a host had configured it
    address_clash  board `other` uses the address of `board`: it streams and answers with it

A fault of triangles or taxels without `triangle` affects all triangles of the board, without `taxel` all pressure
taxels. Times are seconds since power-up and exact: a tick at `until_s` is without the fault. Source of the firmware's
reactions: robotology/icub-firmware, embot_app_application_theSkin.cpp 439–509.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..documents import Section
from ..errors import SimulationError
from ..skin.layout import Layout
from .reference_insole import reference_insole

FaultKind = Literal[
    "loose", "dead_chip", "dead", "stuck", "saturated", "noisy", "rezero", "silent", "reset", "address_clash"
]
ComesBack = Literal["silent", "defaults", "configured"]

KINDS: tuple[FaultKind, ...] = get_args(FaultKind)
LINE_KINDS: tuple[FaultKind, ...] = ("loose", "dead_chip")  # of a triangle's data line or chip
TAXEL_KINDS: tuple[FaultKind, ...] = ("dead", "stuck", "saturated", "noisy")
BOARD_KINDS: tuple[FaultKind, ...] = ("rezero", "silent", "reset", "address_clash")

STUCK_PA = 100e3  # default level


@dataclass(frozen=True, slots=True)
class InjectedFault(Section):
    """One fault of one board; the module's table explains each kind and its parameters.

    Raises SimulationError if there is no such fault.
    """

    kind: FaultKind
    t_s: float
    until_s: float | None  # None: for ever
    board: int  # address, as it is configured
    triangle: int | None = None
    taxel: int | None = None
    level_pa: float | None = None
    factor: float = 8.0
    chance: float = 1.0
    comes_back: ComesBack = "silent"
    other: int | None = None  # address, as it is configured

    def __post_init__(self) -> None:
        problem = self._problem()
        if problem:
            raise SimulationError(f"the fault {self.kind} of board {self.board}: {problem}")

    def _problem(self) -> str | None:
        if self.kind not in KINDS:
            return f"expected one of {', '.join(KINDS)}"
        if self.until_s is not None and self.until_s <= self.t_s:
            return f"expected until_s after t_s {self.t_s}, found {self.until_s}"
        if self.triangle is not None and (self.kind in BOARD_KINDS or not 0 <= self.triangle <= 15):
            return f"expected a triangle 0 to 15, or none for what befalls a board, found {self.triangle}"
        if self.taxel is not None and (self.kind not in TAXEL_KINDS or not 0 <= self.taxel <= 11):
            return f"expected a taxel 0 to 11, and only for what befalls a taxel, found {self.taxel}"
        if self.kind == "rezero" and self.until_s is not None:
            return f"it is a moment: expected until_s None, found {self.until_s}"
        if (self.kind == "address_clash") != (self.other is not None) or self.other == self.board:
            return f"expected another board as `other` with an address_clash alone, found {self.other}"
        if not 0 < self.chance <= 1:
            return f"expected a chance above 0, at most 1, found {self.chance}"
        return None

    def is_active(self, t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (n,) whether it is present at the times `t_s` (n,)."""
        is_present: NDArray[np.bool_] = t_s >= self.t_s
        if self.until_s is not None:
            is_present &= t_s < self.until_s
        return is_present


@dataclass(frozen=True, slots=True)
class BoardEvent:
    """A time at which a board changes by itself."""

    t_s: float
    what: Literal["rezero", "cut", "mend", "lose power", "boot", "take address", "own address"]
    fault: InjectedFault


def board_events(address: int, faults: Iterable[InjectedFault]) -> list[BoardEvent]:
    """Return the changes that `faults` cause to the board configured as `address`, in order of time."""
    events = []
    for fault in faults:
        if fault.kind == "address_clash" and fault.other == address:
            events.append(BoardEvent(fault.t_s, "take address", fault))
            if fault.until_s is not None:
                events.append(BoardEvent(fault.until_s, "own address", fault))
        if fault.board != address:
            continue
        if fault.kind == "rezero":
            events.append(BoardEvent(fault.t_s, "rezero", fault))
        elif fault.kind == "silent":
            events.append(BoardEvent(fault.t_s, "cut", fault))
            if fault.until_s is not None:
                events.append(BoardEvent(fault.until_s, "mend", fault))
        elif fault.kind == "reset":
            events.append(BoardEvent(fault.t_s, "lose power", fault))
            events.append(
                BoardEvent(
                    fault.t_s + reference_insole().boot_s if fault.until_s is None else fault.until_s, "boot", fault
                )
            )
    return sorted(events, key=lambda event: event.t_s)


def check_faults(faults: Iterable[InjectedFault], config: Config, layouts: Iterable[Layout]) -> None:
    """Raise SimulationError if a fault names a board or a triangle that does not exist."""
    boards = sorted(board.address for insole in config.insoles for board in insole.boards)
    identities = {(triangle.board, triangle.triangle) for layout in layouts for triangle in layout.triangles}
    for i, fault in enumerate(faults):
        for key, address in (("board", fault.board), ("other", fault.other)):
            if address is not None and address not in boards:
                raise SimulationError(
                    f"faults[{i}].{key}: expected one of the configured boards {boards}, found {address}"
                )
        if fault.triangle is not None and (fault.board, fault.triangle) not in identities:
            triangles_of_board = sorted(triangle for board, triangle in identities if board == fault.board)
            raise SimulationError(
                f"faults[{i}].triangle: expected one of those of board {fault.board}, {triangles_of_board}, "
                f"found {fault.triangle}"
            )
