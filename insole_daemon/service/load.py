"""The load on a foot, observed for long enough to exclude the swing of a step."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from .foot import Foot
from .operations import Step

LOOK_NS = 1_500_000_000  # longer than a swing phase, in which a walking foot is not to be taken as unloaded
_EVERY_NS = 50_000_000
_AVERAGED = 4  # consecutive forces in a mean: noise alone may exceed the contact force once

_LOADED_SHARE = 0.05  # of the taxels


@dataclass(frozen=True, slots=True)
class FootLoad:
    """The load on a foot during an observation."""

    force_n: float | None  # highest mean over 0.2 s; None: no valid taxel
    low_share: float  # largest share of taxels that read far below the rest of the foot
    min_force_n: float

    @property
    def loaded(self) -> bool:
        """Whether force or low taxels show a load; the latter also do for boards with other settings."""
        return (self.force_n is not None and self.force_n >= self.min_force_n) or self.low_share >= _LOADED_SHARE

    @property
    def words(self) -> str:
        """The load in words, for messages."""
        if self.force_n is None:
            return "its load is not known"
        if self.force_n < self.min_force_n and self.low_share >= _LOADED_SHARE:
            return f"{self.low_share:.0%} of its taxels read far below the others"
        return f"it bears {self.force_n:.0f} N"


class LoadRecord:
    """The load on `foot` over the last LOOK_NS, without the boards in `without` and those that are silent."""

    def __init__(self, foot: Foot, without: Collection[int] = ()) -> None:
        self._foot, self._without = foot, without
        self._seen: deque[tuple[int, float | None, float]] = deque()  # when, f_z in N, share of low taxels

    def add(self, step: Step) -> None:
        """Add the newest cycle of a step, at most once in _EVERY_NS."""
        now_ns = step.now_mono_ns
        if not step.closed or (self._seen and now_ns - self._seen[-1][0] < _EVERY_NS):
            return
        newest = step.closed[-1]
        self._seen.append((now_ns, *self._foot.load(newest, len(newest) - 1, self._without)))
        while now_ns - self._seen[0][0] > LOOK_NS:
            self._seen.popleft()

    def load(self) -> FootLoad:
        """Return the highest load of the last LOOK_NS."""
        forces_n = [force_n for _, force_n, _ in self._seen if force_n is not None]
        n = min(_AVERAGED, len(forces_n))
        peak_n = float(np.convolve(forces_n, np.ones(n) / n, "valid").max()) if forces_n else None
        low_share = max((share for *_, share in self._seen), default=0.0)
        return FootLoad(peak_n, low_share, self._foot.config.contact.min_force_n)
