"""Invert the effects of a calibration live: from readings to the load, causally.

The calibration's `effects` are inverted in the order of the signal path (`Chain.live`), one cycle or many at a time
with the same result. Only earlier cycles are used; an effect that merely delays is corrected by an earlier time stamp.

- An effect is inverted only within the range in which it was identified, up to the upper end of `valid_range:
  {pressure_pa: […]}`. Pressure above it is added unchanged and marked as beyond.
- A taxel that becomes invalid keeps its last value in the memory terms; its pressure is the static one.
- Memory starts at the first cycle: the load present then is assumed to have lasted for ever (none if the taxel is
  invalid then); play operators start unloaded.
- A zero measures the unloaded counts, so effects that only shift these (OF_REST) are not inverted with a zero. Times of
  `drift` and `rezero` refer to one recording (`began_t_ns` in `provenance`) and are ignored on another day.
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
from .kernel_stage import KernelStage
from .law import Array

OF_REST = ("baseline", "preload", "drift", "rezero")
OF_THEIR_TIME = ("drift", "rezero")
_DAY_NS = 86_400 * 10**9


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """An effect that is not inverted, with the reason as a sentence."""

    effect: Effect
    why: str


@dataclass(frozen=True, slots=True, eq=False)
class InvertedCycles:
    """The loads of n cycles."""

    pressure_pa: Array  # (n, n_triangles, 12); static pressure where invalid
    valid: NDArray[np.bool_]  # (n, n_triangles, 12) validity at the positions of the pressures
    beyond: NDArray[np.bool_]  # (n, n_triangles, 12) valid, but above the range in which the effects were identified


class DynamicModel:
    """Inverse of the effects in one foot's calibration, with its memory."""

    def __init__(
        self, layout: Layout, calibration: Calibration, boards: Sequence[Board], began_ns: int, *, zeroed: bool
    ) -> None:
        """Build the inverse; the model then starts with the first cycle.

        `began_ns` is CLOCK_REALTIME at second 0 of the times passed later; `zeroed` states that the baselines are of a
        zero.
        """
        since_ns = began_ns - int(calibration.provenance.get(BEGAN, 0))
        self.effects, self.left_out = _split_effects(calibration.effects, zeroed, abs(since_ns) < _DAY_NS)
        self._baseline_count = calibration.baseline_count
        self.highest_count: Array | None = None  # (n_triangles, 12) above which a count is no load; None: no mask
        chain = Chain(self.effects, layout, calibration, boards)
        self.xy_m = chain.xy_m  # (n_triangles, 12, 2) positions of the resulting loads
        of_curve = [effect for effect in self.effects if effect.law.domain in ("curve", "activation", "count")]
        of_load = [effect for effect in self.effects if effect.law.domain in ("place", "pressure")]
        self._reading = None
        if any(effect.law.inverse is not None for effect in of_curve):
            self._reading = Chain(of_curve, layout, calibration, boards).live()
        self._load_chain = Chain(of_load, layout)
        self._load = self._load_chain.live()
        self._origin_s = since_ns * 1e-9 if any(effect.law.word in OF_THEIR_TIME for effect in self.effects) else 0.0
        self.highest_pa = _highest_pa(of_load, layout)  # (n_triangles, 12) inf: not known
        self._has_highest = bool(np.isfinite(self.highest_pa).any())
        self._read_by = chain.read_by
        # (n_triangles,) delay of a triangle's load, to subtract from its time stamp
        self.late_ns: NDArray[np.int64] = np.rint(1e9 * self.at_places(chain.late_s[None])[0].max(axis=1)).astype(
            np.int64
        )
        self.late_ns.setflags(write=False)

    def mask(self, activation_threshold_count: float) -> None:
        """Set the load to 0 below this activation from now on, as the static curve does; 0 switches it off."""
        self.highest_count = None
        if activation_threshold_count > 0:
            self.highest_count = self._baseline_count - activation_threshold_count

    def __call__(
        self, static_pa: Array, counts: NDArray[np.uint8], valid: NDArray[np.bool_], t_s: Array
    ) -> InvertedCycles:
        """Invert n further cycles; `static_pa`, `counts` and `valid` (n, n_triangles, 12).

        `t_s` (n,) are seconds since `began_ns` on a monotonic clock.
        """
        t_s = t_s + self._origin_s
        if self._reading is None:
            effective_pa = np.where(valid, static_pa, np.nan)
        else:
            effective_pa = self._reading(np.where(valid, counts, np.nan), t_s)
        loaded = valid
        if self.highest_count is not None:
            loaded = valid & (counts <= self.highest_count)
            effective_pa[valid & ~loaded] = 0.0
        within_pa, excess_pa = effective_pa, None
        beyond = np.zeros(valid.shape, np.bool_)
        if self._has_highest:
            excess_pa = np.maximum(effective_pa - self.highest_pa, 0.0)  # NaN is preserved
            beyond = excess_pa > 0
            within_pa = effective_pa - excess_pa
        load_pa = self._load(within_pa, t_s)
        if excess_pa is not None:
            load_pa += self.at_places(excess_pa)
        pressure_pa = np.where(self.at_places(loaded), load_pa, self.at_places(static_pa))
        return InvertedCycles(pressure_pa, self.at_places(valid), self.at_places(beyond))

    def kernel_stages(self) -> list[KernelStage] | None:
        """Return the stages as the compiled kernel takes them; None where it has not all of them."""
        return None if self._reading is not None or self._origin_s else self._load_chain.kernel_stages()

    def at_places(self, of_readings: NDArray[Any]) -> NDArray[Any]:
        """Reorder readings (n, …) to the positions of their loads."""
        if self._read_by is None:
            return of_readings
        return of_readings.reshape(len(of_readings), -1)[:, self._read_by].reshape(of_readings.shape)


def _split_effects(
    effects: Iterable[Effect], zeroed: bool, same_day: bool
) -> tuple[tuple[Effect, ...], tuple[LeftOut, ...]]:
    """Split the effects into those to invert and the others."""
    inverted, left_out = [], []
    for effect in effects:
        why = _why_not(effect, zeroed, same_day)
        if why is None:
            inverted.append(effect)
        else:
            left_out.append(LeftOut(effect, why))
    return tuple(inverted), tuple(left_out)


def _why_not(effect: Effect, zeroed: bool, same_day: bool) -> str | None:
    """Return why the effect is not inverted, or None if it is."""
    law = effect.law
    if law.needs_temperature:
        return "the boards do not send their temperature: t0_c is assumed"
    if zeroed and law.word in OF_REST:
        return "the zero already contains the unloaded counts"
    if law.word in OF_THEIR_TIME and not same_day:
        return f"its times are those of a recording of another day ({BEGAN}): take a zero instead"
    if law.inverse is None and not np.any(law.late_s(effect.values) > 0):
        return f"it has no inverse: {law.inverse_is}"
    return None


def _highest_pa(effects: Iterable[Effect], layout: Layout) -> Array:
    """Return (n_triangles, 12) the pressure up to which all effects of a taxel were identified; inf if unknown."""
    highest = np.full(len(layout) * N_TAXELS, np.inf)
    for effect in effects:
        if "pressure_pa" in effect.valid_range:
            slots = effect.where.slots(layout)
            highest[slots] = np.minimum(highest[slots], effect.valid_range["pressure_pa"][1])
    return highest.reshape(len(layout), N_TAXELS)
