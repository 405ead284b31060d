"""What boards really send, against what they were told: the only confirmation there is of a configuration.

No setting is acknowledged (TSD-ICUBUNIT-canprotocol 3.3.5), so the stream is looked at for a while: the class of its
identifiers, which triangles it carries, how often, and what it rests at. The shift cannot be seen in it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch
from ..config import Board
from .commands import RAW_TEST_MODE
from .geometry import PRESSURE_TAXELS
from .identifiers import CLASS_LEGACY_SKIN, CLASS_SECOND_HALF, CLASS_SKIN, ERROR_NOT_CONNECTED, TAG_A, TAG_B

PERIOD_TOLERANCE = 0.1  # of the period, and at least
PERIOD_TOLERANCE_MS = 1.0
# Of the median over all taxels of a board: the baseline is one reading with a noise of about a count per taxel, and
# the floor in the digitiser adds up to half a count.
REST_TOLERANCE_COUNT = 3.0

_SPAN = 5  # intervals; with more of them, few lost readings would lengthen most spans
_BYTES_A, _BYTES_B = slice(1, 8), slice(1, 6)  # counts of taxels 0 to 6 and 7 to 11


@dataclass(frozen=True, slots=True)
class Seen:
    """What one board sent while it was watched."""

    address: int
    legacy: bool  # some of it in class 3: an MTB3 that was never configured in the new style
    triangles: tuple[int, ...]
    open_triangles: tuple[int, ...]  # those that report a data line without a sensor
    period_ms: float | None  # median over its halves and the spans between their readings; None: too few
    rest_count: float | None  # median over its pressure taxels, open triangles left out; None: there is none

    def differences(self, board: Board, triangles: Collection[int]) -> list[str]:
        """What stands against that `board` does what it was told, with `triangles` enabled; nothing: it does.

        The rest is looked at by `rest_difference`: it holds only for a foot without load.
        """
        if not self.triangles:
            return ["sends nothing"]
        found = []
        if self.legacy:
            found.append("sends in class 3, as an MTB3 does that was never configured in the new style")
        missing, extra = set(triangles) - set(self.triangles), set(self.triangles) - set(triangles)
        if missing:
            found.append(f"triangles missing: {_list(missing)}")
        if extra:
            found.append(f"triangles that were not enabled: {_list(extra)}")
        tolerance_ms = max(PERIOD_TOLERANCE * board.period_ms, PERIOD_TOLERANCE_MS)
        if self.period_ms is None or abs(self.period_ms - board.period_ms) > tolerance_ms:
            sends = "too seldom to tell a period" if self.period_ms is None else f"every {self.period_ms:.1f} ms"
            found.append(f"sends {sends}, expected every {board.period_ms} ms")
        return found

    def rest_difference(self, board: Board) -> list[str]:
        """What stands against that it rests at its no-load count, right after its baseline was taken."""
        if self.rest_count is None or board.skin_type == RAW_TEST_MODE:
            return []
        if abs(self.rest_count - board.no_load) <= REST_TOLERANCE_COUNT:
            return []
        rests = f"its taxels are at {self.rest_count:.0f} counts, expected {board.no_load} ± {REST_TOLERANCE_COUNT:.0f}"
        return [f"{rests}: did something press on the insole meanwhile?"]


class StreamWatch:
    """Collects the halves of some boards, whatever triangle they are of."""

    def __init__(self, addresses: Collection[int]) -> None:
        self._addresses = tuple(addresses)
        self._kept: list[FrameBatch] = []

    def feed(self, frames: FrameBatch) -> None:
        """Take in what arrived."""
        kept = frames[_is_half(frames) & np.isin(frames.can_id >> np.uint32(4) & 0xF, self._addresses)]
        if len(kept):
            self._kept.append(kept)

    def seen(self) -> dict[int, Seen]:
        """What every board sent, by address."""
        frames = FrameBatch.concatenate(self._kept)
        address = frames.can_id >> np.uint32(4) & 0xF
        return {each: _seen(each, frames[address == each]) for each in self._addresses}


def _is_half(frames: FrameBatch) -> NDArray[np.bool_]:
    cls, tag = frames.can_id >> np.uint32(8), frames.data[:, 0]
    skin = (cls == CLASS_SKIN) | (cls == CLASS_LEGACY_SKIN)
    a, b = skin & (tag == TAG_A), (skin | (cls == CLASS_SECOND_HALF)) & (tag == TAG_B)
    half: NDArray[np.bool_] = (a | b) & (frames.flags == 0) & (frames.dlc == 8)
    return half


def _seen(address: int, frames: FrameBatch) -> Seen:
    triangle, is_b = frames.can_id & 0xF, frames.data[:, 0] == TAG_B
    is_open = is_b & (frames.data[:, 7] & 0xF == ERROR_NOT_CONNECTED)
    open_triangles = tuple(np.unique(triangle[is_open]).tolist())
    there = ~np.isin(triangle, open_triangles)
    counts = np.concatenate([
        frames.data[there & ~is_b, _BYTES_A][:, PRESSURE_TAXELS[:7]].ravel(),
        frames.data[there & is_b, _BYTES_B][:, PRESSURE_TAXELS[7:]].ravel(),
    ])  # fmt: skip
    periods = [
        _periods_ns(frames.t_mono_ns[(triangle == each) & (is_b == half)])
        for each in np.unique(triangle)
        for half in (False, True)
    ]
    period_ns = np.concatenate(periods) if periods else np.empty(0)
    return Seen(
        address,
        bool((frames.can_id >> np.uint32(8) == CLASS_LEGACY_SKIN).any()),
        tuple(np.unique(triangle).tolist()),
        open_triangles,
        float(np.median(period_ns)) * 1e-6 if len(period_ns) else None,
        float(np.median(counts)) if len(counts) else None,
    )


def _periods_ns(t_mono_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """What one half that arrived at these times (n,) says of its period; nothing where n < 2.

    Each value is the mean of several intervals: a host or an adapter that is often held up hands on in bursts what
    came in its rhythm, and of such a stream most single intervals may be too short.
    """
    span = min(_SPAN, max(1, len(t_mono_ns) // 6))
    return (t_mono_ns[span:] - t_mono_ns[:-span]) / span


def _list(triangles: Collection[int]) -> str:
    return ", ".join(map(str, sorted(triangles)))
