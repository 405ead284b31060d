"""The load of configured boards on a bus of 1 Mbit/s, and its limit.

A triangle sends two frames of 8 bytes a period; a frame takes 111 bit times without a stuff bit, 135 with as many as
there can be (ISO 11898-1, 10.5). Six boards with all 16 triangles take 43 to 52 % at 50 ms and 107 to 130 % at
20 ms; with the 56 triangles two insoles really have, 62 to 76 % at 20 ms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import BusError

BIT_RATE_HZ = 1_000_000
FRAME_BITS = (111, 135)  # least, most

# Largest load, computed with the longest frames. Boards are not synchronised, so their frames queue: the remaining time
# must carry commands, answers and other nodes, and empty each queue before the next reading (an MTB3 drops all of its
# 20 frames if they are still in the queue then).
MOST_LOAD = 0.8


@dataclass(frozen=True, slots=True)
class Stream:
    """The configured stream of one board."""

    address: int
    n_triangles: int  # enabled
    period_ms: int

    @property
    def frames_per_s(self) -> float:
        """Frames per second: two halves for each triangle and period."""
        return 2 * self.n_triangles * 1000 / self.period_ms


@dataclass(frozen=True, slots=True)
class BusLoad:
    """The load of all boards of one interface; `least` and `most` are fractions of its time."""

    interface: str
    streams: tuple[Stream, ...]
    frames_per_s: float
    least: float
    most: float


def bus_load(interface: str, streams: Iterable[Stream]) -> BusLoad:
    """Return the load of `streams`, which are all streams on `interface`."""
    streams = tuple(streams)
    frames_per_s = sum(stream.frames_per_s for stream in streams)
    least, most = (frames_per_s * bits / BIT_RATE_HZ for bits in FRAME_BITS)
    return BusLoad(interface, streams, frames_per_s, least, most)


def check_fits(load: BusLoad) -> None:
    """Raise BusError with the numbers and the remedy if `load` does not fit."""
    if load.most <= MOST_LOAD:
        return
    settings = ", ".join(f"board {s.address}: {s.n_triangles} triangles every {s.period_ms} ms" for s in load.streams)
    scale = load.most / MOST_LOAD
    n = sum(stream.n_triangles for stream in load.streams)
    raise BusError(
        f"the configured boards exceed the capacity of {load.interface}: {load.frames_per_s:.0f} frames/s take "
        f"{load.least:.0%} to {load.most:.0%} of 1 Mbit/s, at most {MOST_LOAD:.0%} is permitted ({settings}). "
        f"Remove triangles that do not exist from the layout (at these periods at most {int(n / scale)} of {n} fit), "
        f"make every period_ms at least {scale:.1f} times as long (50 ms is what the boards' protocol recommends), "
        "or spread the boards over two interfaces"
    )
