"""The dynamic model, live: readings into the load by the static curve and the effects beside it, causally.

What a calibration lists under `effects` is undone in the order of the signal path (`Chain.live`), a cycle at a time or
many: the numbers are the same. Nothing later than a cycle is used for it; what only comes late is stamped earlier.

- Held against what the static curve says, an effect is at work up to where it was identified, the upper end of
  `valid_range: {pressure_pa: […]}`: memory sees no more than that, what goes beyond is added as it is, and is marked.
- A taxel that is not valid is taken to stay at what it said last, and remembers that. Its pressure is the static one.
- Memory begins with the first cycle: what presses then has done so for ever (where a taxel is not valid then, nothing
  has); plays begin unloaded.
- A zero says what is read without load, so what only shifts that (OF_REST) is left out beside one. Times of a drift or
  a rezero are those of a recording, `began_t_ns` in `provenance`: on another day they mean nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout
from .calibration import BEGAN, Calibration
from .chain import Chain
from .effect import Effect
from .law import Array

OF_REST = ("baseline", "preload", "drift", "rezero")
OF_THEIR_TIME = ("drift", "rezero")
_DAY_NS = 86_400 * 10**9


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """An effect that is not undone, and a sentence why."""

    effect: Effect
    why: str


@dataclass(frozen=True, slots=True, eq=False)
class Undone:
    """n cycles."""

    pressure_pa: Array  # (n, n_triangles, 12); the static one where not valid
    valid: NDArray[np.bool_]  # (n, n_triangles, 12) as given, of the places the pressures belong to
    beyond: NDArray[np.bool_]  # (n, n_triangles, 12) valid, and more than the effects were identified to


class DynamicModel:
    """What the effects of one foot's calibration make of its readings, and what it remembers of them."""

    def __init__(
        self, layout: Layout, calibration: Calibration, boards: Sequence[Board], began_ns: int, *, zeroed: bool
    ) -> None:
        """`began_ns`: CLOCK_REALTIME at second 0 of the times it is given; `zeroed`: the baselines are of a zero."""
        since_ns = began_ns - int(calibration.provenance.get(BEGAN, 0))
        self.effects, self.left_out = _parted(calibration.effects, zeroed, abs(since_ns) < _DAY_NS)
        self._baseline_count = calibration.baseline_count
        self._highest_count: Array | None = None
        chain = Chain(self.effects, layout, calibration, boards)
        self.xy_m = chain.xy_m  # (n_triangles, 12, 2) where the taxels lie whose loads are found
        of_curve = [each for each in self.effects if each.law.domain in ("curve", "activation", "count")]
        of_load = [each for each in self.effects if each.law.domain in ("place", "pressure")]
        self._reading = None
        if any(each.law.inverse is not None for each in of_curve):
            self._reading = Chain(of_curve, layout, calibration, boards).live()
        self._load = Chain(of_load, layout).live()
        self._origin_s = since_ns * 1e-9 if any(each.law.word in OF_THEIR_TIME for each in self.effects) else 0.0
        self._highest_pa = _highest_pa(of_load, layout)
        self._read_by = chain.read_by
        # (n_triangles,) ns by how much older than its stamp a triangle's load is
        self.late_ns: NDArray[np.int64] = np.rint(1e9 * self.at_places(chain.late_s[None])[0].max(axis=1)).astype(
            np.int64
        )
        self.late_ns.setflags(write=False)

    def mask(self, activation_threshold_count: float) -> None:
        """Below the threshold a taxel bears nothing from now on, as by the static curve; 0 is off."""
        self._highest_count = None
        if activation_threshold_count > 0:
            self._highest_count = self._baseline_count - activation_threshold_count

    def __call__(self, static_pa: Array, counts: NDArray[np.uint8], valid: NDArray[np.bool_], t_s: Array) -> Undone:
        """Of n cycles that follow those before: `static_pa`, `counts` and `valid` (n, n_triangles, 12).

        `t_s` (n,) s of a clock that never goes back, since `began_ns`.
        """
        t_s = t_s + self._origin_s
        if self._reading is None:
            effective_pa = np.where(valid, static_pa, np.nan)
        else:
            effective_pa = self._reading(np.where(valid, counts, np.nan), t_s)
        loaded = valid
        if self._highest_count is not None:
            loaded = valid & (counts <= self._highest_count)
            effective_pa[valid & ~loaded] = 0.0
        within_pa, over_pa = effective_pa, None
        beyond = np.zeros(valid.shape, np.bool_)
        if self._highest_pa is not None:
            over_pa = np.maximum(effective_pa - self._highest_pa, 0.0)  # NaN stays
            beyond = over_pa > 0
            within_pa = effective_pa - over_pa
        load_pa = self._load(within_pa, t_s)
        if over_pa is not None:
            load_pa += self.at_places(over_pa)
        pressure_pa = np.where(self.at_places(loaded), load_pa, self.at_places(static_pa))
        return Undone(pressure_pa, self.at_places(valid), self.at_places(beyond))

    def at_places(self, of_readings: NDArray[Any]) -> NDArray[Any]:
        """What is of readings (n, …), at the places where their loads are."""
        if self._read_by is None:
            return of_readings
        return of_readings.reshape(len(of_readings), -1)[:, self._read_by].reshape(of_readings.shape)


def _parted(effects: Iterable[Effect], zeroed: bool, same_day: bool) -> tuple[tuple[Effect, ...], tuple[LeftOut, ...]]:
    """Those that are undone, and the others."""
    undone, left_out = [], []
    for effect in effects:
        why = _why_not(effect, zeroed, same_day)
        if why is None:
            undone.append(effect)
        else:
            left_out.append(LeftOut(effect, why))
    return tuple(undone), tuple(left_out)


def _why_not(effect: Effect, zeroed: bool, same_day: bool) -> str | None:
    law = effect.law
    if law.needs_temperature:
        return "the boards do not send their temperature: it reads as at t0_c"
    if zeroed and law.word in OF_REST:
        return "the zero that was taken says what is read without load"
    if law.word in OF_THEIR_TIME and not same_day:
        return f"its times are those of a recording of another day ({BEGAN}): take a zero instead"
    if law.inverse is None and not np.any(law.late_s(effect.values) > 0):
        return f"it has no inverse: {law.inverse_is}"
    return None


def _highest_pa(effects: Iterable[Effect], layout: Layout) -> Array | None:
    """(n_triangles, 12) Pa up to which all effects of a taxel were identified; None where nobody said."""
    highest = np.full(len(layout) * N_TAXELS, np.inf)
    for effect in effects:
        if "pressure_pa" in effect.valid_range:
            slots = effect.where.slots(layout)
            highest[slots] = np.minimum(highest[slots], effect.valid_range["pressure_pa"][1])
    return highest.reshape(len(layout), N_TAXELS) if np.isfinite(highest).any() else None
