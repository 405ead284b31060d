"""Makes the golden logs: emulated boards, whose frames are then reordered, lost, doubled and spoilt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insole_daemon.bus.frames import FrameBatch
from insole_daemon.config import Board, Config, Insole
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Stand, Walk
from insole_daemon.simulation.load import Load
from insole_daemon.skin.layout import Layout, builtin

START_NS = 1_760_000_000_000_000_000
ADDRESSES = {"left": (5, 6, 7), "right": (8, 9, 10)}
LAYOUTS = {foot: builtin(foot, addresses) for foot, addresses in ADDRESSES.items()}  # type: ignore[arg-type]


@dataclass(order=True)
class Frame:
    """One frame to be written; `text` stands where a candump line has something else than an id and 8 bytes."""

    t_us: int
    can_id: int = field(compare=False)
    data: bytearray = field(compare=False)
    text: str | None = field(default=None, compare=False)

    @property
    def half(self) -> tuple[int, int, str]:
        """Board, triangle, and A or B."""
        return self.can_id >> 4 & 15, self.can_id & 15, "B" if self.data[0] == 0xC0 else "A"

    def line(self) -> str:
        text = self.text or f"{self.can_id:03X}#{self.data.hex().upper()}"
        return f"({self.t_us // 1_000_000}.{self.t_us % 1_000_000:06d}) can0 {text}\n"


def boards(foot: str, **settings: Sequence[int]) -> Insole:
    """An insole whose three boards have `settings`, one value each."""
    return Insole(
        foot=foot,  # type: ignore[arg-type]
        boards=tuple(
            Board(address=address, interface="can0", **{name: values[i] for name, values in settings.items()})
            for i, address in enumerate(ADDRESSES[foot])
        ),
    )


def emulate(
    insoles: Sequence[Insole], load: Callable[[list[Layout]], Load], begin_s: float, seconds: float, seed: int
) -> list[Frame]:
    """The frames of a stretch of time, whole microseconds, as a log has them."""
    layouts = [LAYOUTS[insole.foot] for insole in insoles]
    emulator = Emulator(Config(insoles=tuple(insoles)), layouts, load(layouts), seed=seed)
    batch: FrameBatch = emulator.frames(START_NS, begin_s + seconds)
    batch = batch[batch.t_ns >= START_NS + round(begin_s * 1e9)]
    rows = zip(batch.t_ns.tolist(), batch.can_id.tolist(), batch.data, strict=True)
    return [Frame(t_ns // 1000, can_id, bytearray(data.tobytes())) for t_ns, can_id, data in rows]


def ticks(frames: list[Frame], board: int) -> list[list[Frame]]:
    """The frames of a board, a tick each; a tick that the beginning of the log cuts is left out."""
    lowest = min(t.triangle for of in LAYOUTS.values() for t in of.triangles if t.board == board)
    of_ticks: list[list[Frame]] = []
    for frame in frames:
        if frame.half == (board, lowest, "A"):
            of_ticks.append([])
        if of_ticks and frame.half[0] == board:
            of_ticks[-1].append(frame)
    return of_ticks


def walk() -> list[Frame]:
    """Both feet: the right heel strikes, the left one toes off."""
    return emulate([boards("left"), boards("right")], Walk, 0.48, 0.43, seed=1)


def mtb3() -> list[Frame]:
    """The transmit queue of an MTB3 is a stack: B before A, high triangles first. One tick overflows it."""
    frames = emulate([boards("left")], Walk, 0.2, 0.4, seed=2)
    rng = np.random.default_rng(2)
    lost: set[int] = set()
    for board in ADDRESSES["left"]:
        for number, tick in enumerate(ticks(frames, board)):
            # What is pushed while others wait overtakes them; how many wait when sending starts varies.
            order, at = [], 0
            while at < len(tick):
                pushed = int(rng.integers(2, 20))
                order += list(range(at, min(at + pushed, len(tick))))[::-1]
                at += pushed
            contents = [(tick[i].can_id, tick[i].data) for i in order]
            for frame, (can_id, data) in zip(tick, contents, strict=True):
                frame.can_id, frame.data = can_id, data
            if board == 5 and number == 7:  # 20 frames pending: all dropped, and an empty frame instead
                tick[2].text = "755#"
                lost |= {id(frame) for frame in tick[3:22]}
    new_style_us = START_NS // 1000 + 400_000
    commands = [
        Frame(new_style_us + 150 * i, 0x200 | board, bytearray((0x07, 0x00)))
        for i, board in enumerate(ADDRESSES["left"])
    ]
    for frame in frames:
        if frame.t_us < new_style_us and frame.text is None:
            frame.can_id = 0x300 | frame.can_id & 0xFF
    return sorted([*(frame for frame in frames if id(frame) not in lost), *commands])


def slow() -> list[Frame]:
    """The left boards send every 50 ms; of the right ones only the front board does, the others every 20 ms."""
    insoles = [boards("left", period_ms=(50, 50, 50)), boards("right", period_ms=(50, 20, 20))]
    return emulate(insoles, Walk, 0.5, 0.43, seed=3)


def second_half_class6() -> list[Frame]:
    """Half B comes on class 6, and so does what is no half B of the layout."""
    frames = emulate([boards("left")], Stand, 0.1, 0.2, seed=4)
    for frame in frames:
        if frame.half[2] == "B":
            frame.can_id = 0x600 | frame.can_id & 0xFF
    strangers = [
        Frame(frames[100].t_us + 3, 0x650, bytearray.fromhex("40EEEEEEEEEEEEEE")),  # a half A on class 6
        Frame(frames[100].t_us + 5, 0x652, bytearray.fromhex("C0EEEEEEEEEE0000")),  # no such triangle
        Frame(frames[100].t_us + 7, 0x6C0, bytearray.fromhex("C0EEEEEEEEEE0000")),  # no such board
        Frame(frames[100].t_us + 9, 0x651, bytearray.fromhex("C0EEEEEEEEEE00")),  # 7 bytes
    ]
    return sorted([*frames, *strangers])


@dataclass(frozen=True)
class Case:
    """A golden log: what it is about, its insoles, and how it is made."""

    about: str
    insoles: tuple[Insole, ...]
    make: Callable[[], list[Frame]]

    def as_golden(self) -> list[dict[str, Any]]:
        """The insoles as the golden file states them."""
        return [
            {
                "foot": insole.foot,
                "layout": f"{insole.foot}.yaml",
                "boards": [
                    {"address": board.address, "no_load": board.no_load, "shift": board.shift}
                    for board in insole.boards
                ],
                # The built-in default: a straight line from what the boards rest at, by the firmware's floor.
                "calibration": {
                    "baseline_count": {
                        str(board.address): board.no_load + (1 - 2.0**-board.shift) / 2 for board in insole.boards
                    },
                    "coefficients_pa": [0.0, 8000.0],
                },
            }
            for insole in self.insoles
        ]


def faulty_insole() -> Insole:
    """The right foot; its middle board rests at 255, and at shift 7 the flags of the rear one mean nothing."""
    return boards("right", no_load=(240, 255, 240), shift=(3, 3, 7))


def cases() -> dict[str, Case]:
    """By name."""
    import faults

    both = (boards("left"), boards("right"))
    return {
        "walk": Case("both feet walk, MTB4 order", both, walk),
        "mtb3": Case("legacy class 3, then class 4; B before A, triangles shuffled; one overflow", both[:1], mtb3),
        "faults": Case("what goes wrong on a bus and in a triangle", (faulty_insole(),), faults.make),
        "slow": Case("boards at 50 ms, alone and beside boards at 20 ms", both, slow),
        "second_half_class6": Case("half B on class 6", both[:1], second_half_class6),
    }


def layout_yaml(foot: str) -> str:
    """The built-in layout as a file."""
    layout = LAYOUTS[foot]
    head = (
        "# The built-in approximation of a size 42, which the golden logs are read with.\n"
        f"format: insole-layout/1\nfoot: {foot}\ntaxel_area_mm2: {layout.taxel_area_m2 * 1e6:.10g}\n"
        f"area_meaning: {layout.area_meaning}\ntriangles:\n"
    )
    rows = [
        f"  - {{board: {t.board}, triangle: {t.triangle}, patch: {t.patch}, x_mm: {t.x_mm}, y_mm: {t.y_mm}, "
        f"rotation_deg: {t.rotation_deg}, mirrored: {str(t.mirrored).lower()}}}\n"
        for t in layout.triangles
    ]
    return head + "".join(rows)
