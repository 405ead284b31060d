"""Comparison of the frames that boards send with their configuration, which is the only confirmation of it.

Boards acknowledge no setting (TSD-ICUBUNIT-canprotocol 3.3.5), so a StreamWatch observes their frames for a while: the
class of the identifiers, the triangles, the period and the unloaded count. The frames do not show the shift.
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
# For the median over all taxels of a board: the baseline is one reading with a noise of about a count per taxel, and
# the rounding of the digitiser adds up to half a count.
REST_TOLERANCE_COUNT = 3.0

_SPAN = 5  # intervals; with more of them, few lost readings would lengthen most spans
_BYTES_A, _BYTES_B = slice(1, 8), slice(1, 6)  # counts of taxels 0 to 6 and 7 to 11


@dataclass(frozen=True, slots=True)
class ObservedBoard:
    """The frames of one board during the observation, summarised."""

    address: int
    legacy: bool  # some of it in class 3: an MTB3 that was never configured in the new style
    triangles: tuple[int, ...]
    open_triangles: tuple[int, ...]  # those that report a data line without a sensor
    period_ms: float | None  # median over its halves and the spans between their readings; None: too few
    rest_count: float | None  # median over its pressure taxels, open triangles left out; None: there is none

    def differences(self, board: Board, triangles: Collection[int]) -> list[str]:
        """Return the differences from the configuration `board` with `triangles` enabled; empty: it is as configured.

        `rest_difference` checks the unloaded count, which is valid only for a foot without load.
        """
        if not self.triangles:
            return ["sends nothing"]
        differences = []
        if self.legacy:
            differences.append("sends in class 3, as an MTB3 does that was never configured in the new style")
        missing, extra = set(triangles) - set(self.triangles), set(self.triangles) - set(triangles)
        if missing:
            differences.append(f"triangles missing: {_format_numbers(missing)}")
        if extra:
            differences.append(f"triangles that were not enabled: {_format_numbers(extra)}")
        tolerance_ms = max(PERIOD_TOLERANCE * board.period_ms, PERIOD_TOLERANCE_MS)
        if self.period_ms is None or abs(self.period_ms - board.period_ms) > tolerance_ms:
            sends = "too seldom to tell a period" if self.period_ms is None else f"every {self.period_ms:.1f} ms"
            differences.append(f"sends {sends}, expected every {board.period_ms} ms")
        return differences

    def rest_difference(self, board: Board) -> list[str]:
        """Return the difference from the no-load count right after the board took its baseline; empty if none."""
        if self.rest_count is None or board.skin_type == RAW_TEST_MODE:
            return []
        if abs(self.rest_count - board.no_load) <= REST_TOLERANCE_COUNT:
            return []
        rests = f"its taxels are at {self.rest_count:.0f} counts, expected {board.no_load} ± {REST_TOLERANCE_COUNT:.0f}"
        return [f"{rests}: did something press on the insole meanwhile?"]


class StreamWatch:
    """Collects the halves of some boards, of all their triangles."""

    def __init__(self, addresses: Collection[int]) -> None:
        self._addresses = tuple(addresses)
        self._batches: list[FrameBatch] = []

    def feed(self, frames: FrameBatch) -> None:
        """Add received frames."""
        halves = frames[_is_half(frames) & np.isin(frames.can_id >> np.uint32(4) & 0xF, self._addresses)]
        if len(halves):
            self._batches.append(halves)

    def observed(self) -> dict[int, ObservedBoard]:
        """Return a summary of the frames of every board, by address."""
        frames = FrameBatch.concatenate(self._batches)
        address = frames.can_id >> np.uint32(4) & 0xF
        return {board: _observe_board(board, frames[address == board]) for board in self._addresses}


def _is_half(frames: FrameBatch) -> NDArray[np.bool_]:
    cls, tag = frames.can_id >> np.uint32(8), frames.data[:, 0]
    skin = (cls == CLASS_SKIN) | (cls == CLASS_LEGACY_SKIN)
    a, b = skin & (tag == TAG_A), (skin | (cls == CLASS_SECOND_HALF)) & (tag == TAG_B)
    half: NDArray[np.bool_] = (a | b) & (frames.flags == 0) & (frames.dlc == 8)
    return half


def _observe_board(address: int, frames: FrameBatch) -> ObservedBoard:
    triangle, is_b = frames.can_id & 0xF, frames.data[:, 0] == TAG_B
    is_open = is_b & (frames.data[:, 7] & 0xF == ERROR_NOT_CONNECTED)
    open_triangles = tuple(np.unique(triangle[is_open]).tolist())
    connected = ~np.isin(triangle, open_triangles)
    counts = np.concatenate([
        frames.data[connected & ~is_b, _BYTES_A][:, PRESSURE_TAXELS[:7]].ravel(),
        frames.data[connected & is_b, _BYTES_B][:, PRESSURE_TAXELS[7:]].ravel(),
    ])  # fmt: skip
    periods = [
        _periods_ns(frames.t_mono_ns[(triangle == number) & (is_b == half)])
        for number in np.unique(triangle)
        for half in (False, True)
    ]
    period_ns = np.concatenate(periods) if periods else np.empty(0)
    return ObservedBoard(
        address,
        bool((frames.can_id >> np.uint32(8) == CLASS_LEGACY_SKIN).any()),
        tuple(np.unique(triangle).tolist()),
        open_triangles,
        float(np.median(period_ns)) * 1e-6 if len(period_ns) else None,
        float(np.median(counts)) if len(counts) else None,
    )


def _periods_ns(t_mono_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return estimates of the period of one half from its arrival times (n,); empty if n < 2.

    Each value is the mean of several intervals: a host or an adapter that is often delayed delivers periodic frames in
    bursts, and most single intervals of such a stream may be too short.
    """
    span = min(_SPAN, max(1, len(t_mono_ns) // 6))
    return (t_mono_ns[span:] - t_mono_ns[:-span]) / span


def _format_numbers(triangles: Collection[int]) -> str:
    return ", ".join(map(str, sorted(triangles)))
