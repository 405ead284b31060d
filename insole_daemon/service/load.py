"""What presses on a foot, over long enough to say that nothing does."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from .foot import Foot
from .operations import Step

LOOK_NS = 1_500_000_000  # longer than the swing of a step: a foot in the air while walking is not unloaded
_EVERY_NS = 50_000_000
_TOGETHER = 4  # forces that are averaged: noise alone may reach the contact force once, a step lasts longer

_LOADED_SHARE = 0.05  # of the taxels


@dataclass(frozen=True, slots=True)
class FootLoad:
    """What pressed on a foot while it was looked at."""

    force_n: float | None  # the most there was for 0.2 s; None: nothing valid was seen
    low_share: float  # the most taxels that read far below the rest of the foot
    min_force_n: float

    @property
    def loaded(self) -> bool:
        """By the force, or by taxels that stand out: those tell also where the boards run with other settings."""
        return (self.force_n is not None and self.force_n >= self.min_force_n) or self.low_share >= _LOADED_SHARE

    @property
    def words(self) -> str:
        """For messages."""
        if self.force_n is None:
            return "its load is not known"
        if self.force_n < self.min_force_n and self.low_share >= _LOADED_SHARE:
            return f"{self.low_share:.0%} of its taxels read far below the others"
        return f"it bears {self.force_n:.0f} N"


class LoadRecord:
    """The load of `foot` over the last LOOK_NS, boards `without` left out; one that is silent drops out by itself."""

    def __init__(self, foot: Foot, without: Collection[int] = ()) -> None:
        self._foot, self._without = foot, without
        self._seen: deque[tuple[int, float | None, float]] = deque()  # when, f_z in N, share of low taxels

    def add(self, step: Step) -> None:
        """Look at what the step brought, if it is time to."""
        now_ns = step.now_mono_ns
        if not step.closed or (self._seen and now_ns - self._seen[-1][0] < _EVERY_NS):
            return
        newest = step.closed[-1]
        self._seen.append((now_ns, *self._foot.load(newest, len(newest) - 1, self._without)))
        while now_ns - self._seen[0][0] > LOOK_NS:
            self._seen.popleft()

    def load(self) -> FootLoad:
        """The most there was."""
        forces_n = [force_n for _, force_n, _ in self._seen if force_n is not None]
        together = min(_TOGETHER, len(forces_n))
        most_n = float(np.convolve(forces_n, np.ones(together) / together, "valid").max()) if forces_n else None
        low_share = max((share for *_, share in self._seen), default=0.0)
        return FootLoad(most_n, low_share, self._foot.config.contact.min_force_n)
