"""What is on the bus: the boards of both feet, walked on, as rows of `struct can_frame` with their bus times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.sink import can_frames
from insole_daemon.config import Config, Zenoh
from insole_daemon.service.foot import Foot, load_feet

if TYPE_CHECKING:
    from insole_daemon.simulation.faults import InjectedFault

PERIOD_NS = 20_000_000
LOOP_CYCLES = 500  # boards drift apart by 20 ppm, so phases step by some 0.2 ms where a loop of 10 s begins anew


@dataclass(frozen=True, slots=True)
class Loop:
    """Frames that may be sent again and again: the last is followed by the first, `length_ns` after itself."""

    rows: NDArray[np.uint8]  # (n, 16) struct can_frame
    t_ns: NDArray[np.int64]  # (n,) when each is complete on the bus, from 0
    length_ns: int


def config(endpoint: str = "") -> Config:
    """The built-in rig, two feet of three boards, reached at `endpoint`."""
    return replace(Config(rig="bench"), zenoh=Zenoh(listen=(endpoint,) if endpoint else ()))


def feet() -> list[Foot]:
    """Both feet, with the built-in layout and calibration."""
    return load_feet(config())


def frames(seconds: float, seed: int = 0, faults: Sequence[InjectedFault] = ()) -> FrameBatch:
    """Both feet walking: 112 frames every 20 ms on one bus, every board with a clock and a phase from `seed`."""
    from insole_daemon.simulation.emulator import Emulator  # no part of a daemon, whose start is timed with `feet`
    from insole_daemon.simulation.foot import Walk

    layouts = [foot.layout for foot in feet()]
    return Emulator(config(), layouts, Walk(layouts, seed=seed), seed=seed, faults=faults).frames(0, seconds)


def loop(seed: int = 0, faults: Sequence[InjectedFault] = ()) -> Loop:
    """The same as a loop, cut where the bus is idle, every half in it as often as every other."""
    batch = frames((LOOP_CYCLES + 3) * PERIOD_NS * 1e-9, seed, faults)
    head = slice(112, 224)  # all boards send by then
    start = 112 + int(np.diff(batch.t_ns[head]).argmax()) + 1
    end = start + 112 * LOOP_CYCLES
    cut = batch[start:end]
    key = cut.can_id.astype(np.int64) << 8 | cut.data[:, 0]
    if set(np.unique(key, return_counts=True)[1].tolist()) != {LOOP_CYCLES}:
        raise SystemExit(f"the frames of seed {seed} cannot be cut into a loop; choose another seed")
    return Loop(can_frames(cut), cut.t_ns - cut.t_ns[0], int(batch.t_ns[end] - batch.t_ns[start]))
