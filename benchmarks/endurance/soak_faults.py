"""What happens in a day: walks on insoles with faults, and at random everything that comes between boards and daemon.

All of it from one seed. Faults of frames act on a second of frames at a time; each knows the kind of what it makes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.random import Generator

from benchmarks.endurance.soak_bus import KINDS, Clock, Frames, SoakBus
from benchmarks.lib import traffic
from insole_daemon.service.daemon import Daemon
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.skin.identifiers import CLASS_MANAGEMENT, CLASS_SKIN, TAG_A, TYPE_OVERFLOW

SECOND_NS = 1_000_000_000
_DLC = 4
_KIND = {name: number for number, name in enumerate(KINDS)}
_EXTENDED, _REMOTE, _ERROR = 1 << 31, 1 << 30, 1 << 29
_ERROR_CLASSES = np.array([0x004, 0x008, 0x010, 0x020, 0x080], np.uint32)
_STRANGERS = (1, 2, 3, 4)  # addresses nobody configured
_MANY_S, _FEW_S = 20, 2  # the longest of what is a nuisance, and of what takes everything away

Transform = Callable[[Frames, Generator], Frames]


def _ids(frames: Frames) -> np.ndarray:
    return frames.rows.view(np.uint32)[:, 0]


def _some(frames: Frames, random: Generator, share: float) -> np.ndarray:
    return np.flatnonzero(random.random(len(frames.rows)) < share)


def _changed(frames: Frames, at: np.ndarray, kind: str) -> Frames:
    """A copy to change, in which the frames `at` are of another kind."""
    new = Frames(frames.rows.copy(), frames.due_ns, frames.kind.copy())
    new.kind[at] = _KIND[kind]
    return new


def _with(frames: Frames, rows: np.ndarray, due_ns: np.ndarray, kind: np.ndarray) -> Frames:
    """With further frames among them."""
    due_ns = np.concatenate([frames.due_ns, due_ns])
    order = np.argsort(due_ns, kind="stable")
    merged = Frames(np.concatenate([frames.rows, rows]), due_ns, np.concatenate([frames.kind, kind]))
    return merged[order]


def _board_silent(frames: Frames, random: Generator) -> Frames:
    """One of the boards, another one every second."""
    of = _ids(frames) >> 4 & 0xF
    return frames[of != random.choice(np.unique(of))]


def _all_silent(frames: Frames, random: Generator) -> Frames:
    return frames[:0]


def _lost(frames: Frames, random: Generator) -> Frames:
    return frames[random.random(len(frames.rows)) >= 0.02]


def _duplicated(frames: Frames, random: Generator) -> Frames:
    at = _some(frames, random, 0.02)
    return _with(frames, frames.rows[at], frames.due_ns[at], frames.kind[at])


def _reordered(frames: Frames, random: Generator) -> Frames:
    order = np.arange(len(frames.rows))
    at = _some(frames, random, 0.02)
    at = at[(at + 1 < len(order)) & (np.diff(at, prepend=-2) > 1)]
    order[at], order[at + 1] = order[at + 1], order[at]
    return Frames(frames.rows[order], frames.due_ns, frames.kind[order])


def _corrupted(frames: Frames, random: Generator) -> Frames:
    """Words of the payload; no frame says that it is."""
    at = _some(frames, random, 0.02)
    new = _changed(frames, at, "used")
    new.rows[at, 9:16] = random.integers(0, 256, (len(at), 7))
    return new


def _wrong_length(frames: Frames, random: Generator) -> Frames:
    at = _some(frames, random, 0.02)
    new = _changed(frames, at, "bad_dlc")
    new.rows[at, _DLC] = random.integers(0, 8, len(at))
    return new


def _wrong_tag(frames: Frames, random: Generator) -> Frames:
    at = _some(frames, random, 0.02)
    new = _changed(frames, at, "unknown_tag")
    new.rows[at, 8] = 0x11
    return new


def _remote(frames: Frames, random: Generator) -> Frames:
    at = _some(frames, random, 0.005)
    new = _changed(frames, at, "remote")
    _ids(new)[at] |= np.uint32(_REMOTE)
    return new


def _extended(frames: Frames, random: Generator) -> Frames:
    at = _some(frames, random, 0.005)
    new = _changed(frames, at, "extended")
    _ids(new)[at] |= np.uint32(_EXTENDED)
    return new


def _bus_errors(frames: Frames, random: Generator) -> Frames:
    at = _some(frames, random, 0.01)
    rows = np.zeros((len(at), 16), np.uint8)
    rows.view(np.uint32)[:, 0] = random.choice(_ERROR_CLASSES, len(at)) | np.uint32(_ERROR)
    rows[:, _DLC] = 8
    return _with(frames, rows, frames.due_ns[at], np.full(len(at), _KIND["error"], np.uint8))


def _babbling(frames: Frames, random: Generator) -> Frames:
    """Boards that nobody configured, triangles that are not there, other nodes, an MTB3 that drops its queue."""
    if not len(frames.rows):
        return frames
    n, stranger = 2000, CLASS_SKIN << 8 | random.choice(_STRANGERS) << 4
    ids = {
        "unconfigured_board": stranger | random.integers(0, 16, n),
        "unconfigured_triangle": np.full(n, CLASS_SKIN << 8 | 5 << 4 | 2),
        "other": 0x200 | random.integers(0, 256, n),
        "overflow": CLASS_MANAGEMENT << 8 | random.choice(_STRANGERS, n) << 4 | TYPE_OVERFLOW,
    }
    kind = random.choice([_KIND[name] for name in ids], n).astype(np.uint8)
    rows = np.zeros((n, 16), np.uint8)
    for name, of_kind in ids.items():
        at = kind == _KIND[name]
        rows.view(np.uint32)[at, 0] = of_kind[at]
        if name != "overflow":  # which has no payload
            rows[at, _DLC], rows[at, 8] = 8, TAG_A
    due_ns = np.sort(random.integers(int(frames.due_ns[0]), int(frames.due_ns[-1]) + 1, n))
    return _with(frames, rows, due_ns, kind)


TRANSFORMS: dict[str, tuple[Transform, int]] = {  # and the longest it lasts, s
    "board silent": (_board_silent, _MANY_S),
    "all silent": (_all_silent, _FEW_S),
    "frames lost": (_lost, _MANY_S),
    "frames duplicated": (_duplicated, _MANY_S),
    "frames reordered": (_reordered, _MANY_S),
    "frames corrupted": (_corrupted, _MANY_S),
    "wrong length": (_wrong_length, _MANY_S),
    "wrong tag": (_wrong_tag, _MANY_S),
    "remote frames": (_remote, _MANY_S),
    "29-bit frames": (_extended, _MANY_S),
    "error frames": (_bus_errors, _MANY_S),
    "babbling": (_babbling, _MANY_S),
}
MOMENTS = ("stopped", "overrun", "clock step", "bus down", "reload", "reload refused")


def loops(seed: int) -> list[traffic.Loop]:
    """Walks of 10 s that can be repeated, on a healthy insole and on some with faults."""
    return [
        traffic.loop(seed),
        traffic.loop(
            seed + 1, [InjectedFault("loose", 2.0, 7.0, 5, 0), InjectedFault("loose", 3.0, 4.0, 9, 4, chance=0.3)]
        ),
        traffic.loop(seed + 2, [InjectedFault("dead", 1.0, None, 6, 4, 4), InjectedFault("stuck", 1.0, 9.0, 8, 4, 7)]),
        traffic.loop(
            seed + 3, [InjectedFault("noisy", 1.0, 8.0, 10, 3, 1), InjectedFault("saturated", 1.0, 6.0, 5, 6, 8)]
        ),
    ]


class Day:
    """What is on the bus, second by second, and at which moments something happens that is no matter of frames."""

    def __init__(self, seed: int, loops: Sequence[traffic.Loop], every_s: float = 30.0) -> None:
        """`loops` are of 10 s; `every_s`: the time between two faults, on average."""
        self.happened: dict[str, int] = {}
        self.bring_about: Callable[[str], None] = lambda moment: None
        self._random = np.random.default_rng(seed)
        self._loops, self._every_s = loops, every_s
        self._loop, self._second, self._until_second = loops[0], 0, 0
        self._transform: Transform | None = None

    def frames(self, from_ns: int) -> Frames:
        """Of the second that begins at `from_ns`."""
        random, second = self._random, self._second
        self._second += 1
        if second % 60 == 0:
            self._loop = self._loops[int(random.integers(len(self._loops)))]
        first, last = np.searchsorted(self._loop.t_ns, [second % 10 * SECOND_NS, (second % 10 + 1) * SECOND_NS])
        n = int(last - first)
        due_ns = self._loop.t_ns[first:last] + (from_ns - second % 10 * SECOND_NS)
        frames = Frames(self._loop.rows[first:last], due_ns, np.zeros(n, np.uint8))
        if second >= self._until_second:
            self._transform = None
            if second > 10 and random.random() < 1 / self._every_s:
                name = str(random.choice([*TRANSFORMS, *MOMENTS]))
                self.happened[name] = self.happened.get(name, 0) + 1
                if name in MOMENTS:
                    self._until_second = second + 15  # nothing else until it is over
                    self.bring_about(name)
                else:
                    self._transform, longest_s = TRANSFORMS[name]
                    self._until_second = second + int(random.integers(1, longest_s + 1))
        return frames if self._transform is None else self._transform(frames, random)


class FaultyBus(SoakBus):
    """The bus of a `day`, whose moments it brings about: in its clock, its interface and the daemon's configuration."""

    def __init__(self, clock: Clock, config_file: Path, day: Day) -> None:
        self.day = day
        self.daemon: Daemon | None = None
        self._clock_of_day, self._config_file = clock, config_file
        self._config = config_file.read_text()
        self._random = np.random.default_rng(1)
        self._reloads = 0
        day.bring_about = self._bring_about
        super().__init__(clock, day.frames)

    def _bring_about(self, moment: str) -> None:
        if moment == "stopped":
            self._clock_of_day.stop_for(float(self._random.uniform(0.05, 2.0)))
        elif moment == "overrun":  # the queue holds four seconds
            self._clock_of_day.stop_for(float(self._random.uniform(5.0, 10.0)))
        elif moment == "clock step":
            self._clock_of_day.wall_offset_ns += int(self._random.choice([-1, 1])) * 3600 * SECOND_NS
        elif moment == "bus down":
            self.go_down(float(self._random.uniform(0.5, 5.0)))
        elif self.daemon is not None:
            self._reloads += 1
            good = f"{self._config}contact: {{min_force_n: {20 + self._reloads % 2}}}\n"
            self._config_file.write_text(good if moment == "reload" else good + "nonsense: 1\n")
            self.daemon.reload()
