"""An independent reader of the golden logs: what protocol/ says, one frame at a time, and nothing of insole_daemon.

Frames are decoded by cantools with skin.dbc; classes of frames, cycles, validity, pressure and wrench follow
keys.md in plain integers and floats. Whatever the package publishes is held against this.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import cantools
import yaml

PROTOCOL = Path(__file__).parents[2] / "protocol"
SKIN = cantools.database.load_file(PROTOCOL / "skin.dbc", frame_id_mask=0x700).messages[0]

PATIENCE = 3
GAP_NS = 60_000_000_000
TWICE_NS = 500_000
THERMAL_PADS = (6, 10)
TAXELS_MM = [
    (6.533, 0), (9.8, -5.66), (3.267, -5.66), (0, 0), (-3.267, -5.66), (-9.8, -5.66),
    (-6.51, -3.75), (-6.533, 0), (-3.267, 5.66), (0, 11.317), (0, 7.532), (3.267, 5.66),
]  # fmt: skip

_LINE = re.compile(r"\((\d+)\.(\d{6})\) +\S+ +([0-9A-F]{8}|[0-9A-F]{3})#(.*)")

Identity = tuple[int, int]  # board, triangle
Half = tuple[int, str]  # row of the layout, "A" or "B"


class Frame(NamedTuple):
    """One line of a log."""

    t_ns: int  # as written
    mono_ns: int  # with the steps backwards taken out
    kind: str  # data | remote | extended | error | fd
    can_id: int
    data: bytes


def frames(log: Path) -> Iterator[Frame]:
    """The frames of a candump log."""
    last_ns, taken_out_ns = None, 0
    for line in log.read_text().splitlines():
        seconds, micros, digits, payload = re.fullmatch(_LINE, line).groups()
        t_ns = int(seconds) * 1_000_000_000 + int(micros) * 1000
        if last_ns is not None and t_ns < last_ns:
            taken_out_ns += last_ns - t_ns
        last_ns = t_ns
        can_id = int(digits, 16)
        kind = "data"
        if can_id & 0x2000_0000:
            kind = "error"
        elif payload.startswith("#"):
            kind = "fd"
        elif payload.startswith("R"):
            kind = "remote"
        elif len(digits) == 8:
            kind = "extended"
        data = bytes.fromhex(payload) if kind in ("data", "extended", "error") else b""
        yield Frame(t_ns, t_ns + taken_out_ns, kind, can_id, data)


def decode(data: bytes) -> dict[str, int]:
    """The signals of a half."""
    return SKIN.decode(data, decode_choices=False)


def status_word(signals: Mapping[str, int]) -> int:
    """The status of a half B as one word."""
    return signals["ErrorCode"] | sum(signals[f"OutOfRange{taxel}"] << 4 + taxel for taxel in range(12))


class Refusal(NamedTuple):
    """Why a frame is no half."""

    reason: str
    address: int | None = None


def classify(frame: Frame, triangles: set[Identity]) -> tuple[Identity, str] | Refusal:
    """The half that a frame is, or why it is none: the table of keys.md, line by line."""
    if frame.kind != "data":
        return Refusal(frame.kind)
    cls, address, number = frame.can_id >> 8, frame.can_id >> 4 & 15, frame.can_id & 15
    identity = (address, number)
    if len(frame.data) != 8:
        if cls == 4:
            return Refusal("bad_dlc")
        if cls == 7 and number == 5 and not frame.data:
            return Refusal("overflow", address)
        return Refusal("other")
    half = {0x40: "A", 0xC0: "B"}.get(frame.data[0])
    if cls == 4:
        if address not in {board for board, _ in triangles}:
            return Refusal("unconfigured_board", address)
        if half is None:
            return Refusal("unknown_tag")
        if identity not in triangles:
            return Refusal("unconfigured_triangle")
        return identity, half
    if identity in triangles and ((cls == 3 and half) or (cls == 6 and half == "B")):
        return identity, half
    return Refusal("other")


@dataclass
class Foot:
    """One foot: its layout, and the open cycle."""

    insole: Mapping[str, Any]  # of a golden file: foot, layout, boards, calibration
    settings: Mapping[str, float]
    superseded: int = 0
    missed: int = 0
    skipped: int = 0
    cycles: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        layout = yaml.safe_load((PROTOCOL / "golden" / self.insole["layout"]).read_text())
        self.area_m2 = layout["taxel_area_mm2"] * 1e-6
        self.triangles = layout["triangles"]
        self.rows = {(t["board"], t["triangle"]): row for row, t in enumerate(self.triangles)}
        self.boards = {board["address"]: board for board in self.insole["boards"]}
        self.period_ns = round(1e9 / self.settings["rate_hz"])
        self.slack_ns = round(self.settings["slack_ms"] * 1e6)
        halves = [(row, half) for row in range(len(self.triangles)) for half in "AB"]
        self.last: dict[Half, tuple[dict[str, int], int, int]] = {}  # signals, t_ns, mono_ns
        self.expected = set(halves)
        self.misses = dict.fromkeys(halves, 0)
        self.newest: dict[int, Half] = {}  # of each board
        self.seen: set[Half] = set()
        self.returning: set[Half] = set()
        self.due_ns: int | None = None
        self.newest_t_ns = 0

    def pass_time(self, present_ns: int) -> None:
        """Close what is due by time."""
        while self.due_ns is not None and present_ns > self.due_ns:
            if not self.seen and present_ns - self.due_ns > GAP_NS:
                n = (present_ns - self.due_ns) // self.period_ns
                self.skipped += n
                self.due_ns += n * self.period_ns
            absent = self.expected - self.seen
            for half in absent:
                self.misses[half] += 1
            self.missed += len(absent)
            t_ns = self.due_ns
            self.close(t_ns, late=bool(self.expected))
            self.expected = {half for half in self.expected if self.misses[half] < PATIENCE}
            self.set_due(t_ns)

    def take(self, identity: Identity, letter: str, frame: Frame) -> None:
        """A half of this foot arrives."""
        half = self.rows[identity], letter
        if self.due_ns is None:
            self.due_ns = frame.mono_ns + self.period_ns + self.slack_ns
        self.pass_time(frame.mono_ns)
        since_ns = frame.mono_ns - self.last[half][2] if half in self.last else None
        board, _ = identity
        twice = since_ns is not None and since_ns < TWICE_NS and self.newest.get(board) == half
        self.newest[board] = half
        if since_ns is not None and not twice and since_ns <= self.period_ns + self.slack_ns:
            self.misses[half] = 0
            self.returning.add(half)
        self.superseded += twice or half in self.seen
        self.last[half] = decode(frame.data), frame.t_ns, frame.mono_ns
        self.newest_t_ns = frame.t_ns
        if not twice:
            self.seen.add(half)
        if self.expected and self.expected <= self.seen:
            self.close(frame.mono_ns, late=False)

    def close(self, t_ns: int, late: bool) -> None:
        """End the open cycle."""
        counts, status, age_ms, stamps = [], [], [], []
        for row in range(len(self.triangles)):
            a, b = self.last.get((row, "A")), self.last.get((row, "B"))
            taxels_a = [a[0][f"Taxel{k}"] for k in range(7)] if a else [0] * 7
            taxels_b = [b[0][f"Taxel{k}"] for k in range(7, 12)] if b else [0] * 5
            counts.append(taxels_a + taxels_b)
            status.append(status_word(b[0]) if b else 0)
            older = min((a, b), key=lambda last: last[2]) if a and b else None
            age_ms.append((t_ns - older[2]) / 1e6 if older else None)
            stamps.append(older[1] // 1000 if older else None)
        absent = self.expected - self.seen
        valid = [self.valid(row, *of) for row, of in enumerate(zip(counts, status, age_ms, strict=True))]
        pressure = [self.pressure_pa(row, of) for row, of in enumerate(counts)]
        self.cycles.append(
            {
                "seq": len(self.cycles),
                "t_us": self.newest_t_ns // 1000,
                "late": late,
                "repeated": not self.seen,
                "missing": sorted({row for row, _ in absent}),
                "counts": [bytes(of).hex().upper() for of in counts],
                "status": status,
                "age_ms": age_ms,
                "triangle_t_us": stamps,
                "valid": [sum(mark << taxel for taxel, mark in enumerate(of)) for of in valid],
                "pressure_kpa": [[p if p is None else p / 1000 for p in of] for of in pressure],
                **self.wrench(pressure, valid),
            }
        )
        self.expected |= self.returning
        self.returning, self.seen = set(), set()
        self.set_due(t_ns)

    def set_due(self, closed_ns: int) -> None:
        self.due_ns = closed_ns + self.period_ns + (self.slack_ns if self.expected else 0)

    def valid(self, row: int, counts: list[int], status: int, age_ms: float | None) -> list[bool]:
        board = self.boards[self.triangles[row]["board"]]
        if age_ms is None or age_ms > self.settings["stale_after_ms"] or status & 15:
            return [False] * 12
        marks = []
        for taxel, count in enumerate(counts):
            at_rest = count == 255 and board["no_load"] == 255
            flagged = status >> 4 + taxel & 1 and board["shift"] < 7 and not at_rest
            clamped = count == 0 or (count == 255 and not at_rest)
            marks.append(taxel not in THERMAL_PADS and not flagged and not clamped)
        return marks

    def pressure_pa(self, row: int, counts: list[int]) -> list[float | None]:
        calibration = self.insole["calibration"]
        baseline = calibration["baseline_count"][str(self.triangles[row]["board"])]
        result: list[float | None] = []
        for taxel, count in enumerate(counts):
            activation = baseline - count
            pressure: float | None = sum(c * activation**k for k, c in enumerate(calibration["coefficients_pa"]))
            if 0 < self.settings["activation_threshold_count"] > activation:
                pressure = 0.0
            result.append(None if taxel in THERMAL_PADS else pressure)
        return result

    def xy_m(self, row: int, taxel: int) -> tuple[float, float]:
        triangle = self.triangles[row]
        x, y = TAXELS_MM[taxel]
        if triangle.get("mirrored", False):
            x = -x
        turn = math.radians(triangle["rotation_deg"])
        turned = x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)
        return (triangle["x_mm"] + turned[0]) * 1e-3, (triangle["y_mm"] + turned[1]) * 1e-3

    def wrench(self, pressure_pa: list[list[float | None]], valid: list[list[bool]]) -> dict[str, Any]:
        loads = [
            (pressure_pa[row][taxel], *self.xy_m(row, taxel))
            for row, marks in enumerate(valid)
            for taxel, mark in enumerate(marks)
            if mark
        ]
        f_z = math.fsum(p * self.area_m2 for p, _, _ in loads)
        m_x = math.fsum(y * p * self.area_m2 for p, _, y in loads)
        m_y = -math.fsum(x * p * self.area_m2 for p, x, _ in loads)
        contact = bool(loads) and f_z >= self.settings["min_force_n"]
        touched = sum(p >= self.settings["min_pressure_pa"] for p, _, _ in loads)
        return {
            "f_z_n": f_z if loads else None,
            "m_x_nm": m_x if loads else None,
            "m_y_nm": m_y if loads else None,
            "cop_x_m": -m_y / f_z if contact else None,
            "cop_y_m": m_x / f_z if contact else None,
            "contact_area_m2": touched * self.area_m2,
            "valid_fraction": len(loads) / (10 * len(self.triangles)),
        }


def read(log: Path, settings: Mapping[str, float], insoles: list[Mapping[str, Any]]) -> dict[str, Any]:
    """All that is expected of a log: refused frames, and the cycles of each foot up to the time of the last frame."""
    feet = [Foot(insole, settings) for insole in insoles]
    owner = {identity: foot for foot in feet for identity in foot.rows}
    triangles = set(owner)
    refused: dict[str, Any] = dict.fromkeys(
        ("other", "remote", "extended", "fd", "error", "bad_dlc", "unknown_tag", "unconfigured_triangle"), 0
    )
    refused |= {"unconfigured_board": {}, "overflow": {}}
    for frame in frames(log):
        for foot in feet:
            foot.pass_time(frame.mono_ns)
        classified = classify(frame, triangles)
        if not isinstance(classified, Refusal):
            owner[classified[0]].take(*classified, frame)
        elif classified.address is None:
            refused[classified.reason] += 1
        else:
            by_address = refused[classified.reason]
            by_address[str(classified.address)] = by_address.get(str(classified.address), 0) + 1
    return {
        "refused": refused,
        "feet": [
            {
                **foot.insole,
                "superseded_halves": foot.superseded,
                "missed_halves": foot.missed,
                "skipped": foot.skipped,
                "cycles": foot.cycles,
            }
            for foot in feet
        ],
    }
