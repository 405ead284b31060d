"""Steps, from the vertical force: initial contact and toe-off, and the figures of a step.

A contact is the moment at which the force above its rest crosses a low level, interpolated between two cycles: 20 N as
is customary with force plates (Tirosh & Sparrow 2003, J. Appl. Biomech. 19:158; insoles: Catalfamo et al. 2008, Gait &
Posture 28:420), or a twentieth of the largest force lately, since the sensor forgets a step only slowly.
It is reported once the force has also passed a high level, and only if it took no longer than QUICK_S from one to the
other: noise does not reach the high one, and who shifts his weight is slower. Toe-off is the same downwards. So a cycle
or two pass until a contact is reported, and none until a toe-off is.

Rest is the least force of the last second in which the foot was loaded and unloaded: insoles keep an offset and drift.
Nothing of the future is used, and nothing but the cycles: a recording gives what was live.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...compiled import kernel
from ...skin.layout import Foot, Layout
from ..regions import REGIONS, regions

LOW_N, LOW_PART = 20.0, 0.05  # above rest; in N and of the largest force lately, whichever is more
HIGH_N, HIGH_PART = 60.0, 0.15
QUICK_S = 0.2  # from one to the other
LONGEST_STRIDE_S = 3.0  # more is a pause
_GAP_S = 0.2  # of cycles: what lies between is not known
_BLOCK_S = 0.5
_BLOCKS = 2  # the last second: who lifts a foot is not slower, who shifts his weight is
_LONG_AGO_NS = -(10**18)
_UNLOADED = 0.2  # of the largest force of that time: what is above it is no rest

Kind = Literal["initial_contact", "toe_off"]


@dataclass(frozen=True, slots=True)
class GaitEvent:
    """A foot touches the ground, or leaves it.

    `figures` have their unit in the name; one that cannot be known, as the stride of a first step, is None.
    """

    foot: Foot
    kind: Kind
    t_ns: int  # when it happened, on the clock of the cycles' t_ns
    noticed_after_s: float
    figures: dict[str, float | None]


class Levels:
    """The forces below which a foot is unloaded, and above which it is loaded, from the last second that had both."""

    def __init__(self) -> None:
        self._blocks: deque[tuple[float, float]] = deque(maxlen=_BLOCKS)  # least and largest force
        self._least, self._most, self._until_ns = math.inf, -math.inf, 0
        self.low_n, self.high_n = LOW_N, HIGH_N

    def update(self, t_mono_ns: int, f_z_n: float) -> None:
        """Take in the force of one cycle."""
        self._least, self._most = min(self._least, f_z_n), max(self._most, f_z_n)
        if t_mono_ns < self._until_ns:
            return
        self._blocks.append((self._least, self._most))
        self._least, self._most, self._until_ns = math.inf, -math.inf, t_mono_ns + round(_BLOCK_S * 1e9)
        least, most = min(low for low, _ in self._blocks), max(high for _, high in self._blocks)
        if most >= self.high_n and least < _UNLOADED * most:
            self.low_n = least + max(LOW_N, LOW_PART * (most - least))
            self.high_n = least + max(HIGH_N, HIGH_PART * (most - least))


class FootGait:
    """The steps of one foot; to be given every cycle that brought something new, in order."""

    def __init__(self, layout: Layout) -> None:
        self.foot = layout.foot
        self.stance_s: float | None = None  # of the last step
        self.contact_ns: int | None = None  # monotonic; None: in the air, or put down gently
        self.loaded = False
        region = regions(layout).ravel()
        self._order = np.argsort(region, kind="stable")[np.count_nonzero(region < 0) :]
        present = np.flatnonzero(np.bincount(region[self._order]))  # np.unique would import numpy.ma
        self._present = present.tolist()
        self._starts = np.searchsorted(region[self._order], present)
        self._ends = np.searchsorted(region[self._order], np.arange(len(REGIONS)), side="right")
        self._levels = Levels()
        self._last_ns: int | None = None
        self._last_n = 0.0
        # Monotonic: when low was last passed upwards, high downwards; each completes one event. The levels move, so
        # that a force can be below the one and above the other twice without passing either again.
        self._low_ns = self._high_ns = _LONG_AGO_NS
        self._previous_contact_ns: int | None = None
        self._off_ns: int | None = None
        self._begin()

    def update(
        self,
        t_mono_ns: int,
        t_ns: int,
        f_z_n: float | None,
        pressure_pa: NDArray[np.floating],
        valid: NDArray[np.uint8] | NDArray[np.bool_],
    ) -> GaitEvent | None:
        """Take in one cycle and return the event that it completes, or None.

        `t_mono_ns` and `t_ns` are its monotonic and epoch time, `pressure_pa` and `valid` (n_triangles, 12); `f_z_n` is
        None where it is not known.
        """
        last_ns, last_n = self._last_ns, self._last_n
        if f_z_n is None:
            self._last_ns = None
            return None
        self._levels.update(t_mono_ns, f_z_n)
        low_n, high_n = self._levels.low_n, self._levels.high_n
        self._last_ns, self._last_n = t_mono_ns, f_z_n
        if last_ns is None or not 0 < t_mono_ns - last_ns <= _GAP_S * 1e9:
            self.contact_ns = self._off_ns = None  # what was before is of another time
            self._low_ns = self._high_ns = _LONG_AGO_NS
            self.loaded = f_z_n >= high_n
            return None

        segment = last_ns, last_n, t_mono_ns, f_z_n
        if not self.loaded and last_n < low_n <= f_z_n:
            self._low_ns = _crossed_ns(low_n, *segment)
            self._begin()
        if f_z_n < high_n <= last_n:
            self._high_ns = _crossed_ns(high_n, *segment)
        if f_z_n >= low_n:
            self._press((t_mono_ns - last_ns) * 1e-9, f_z_n, pressure_pa, valid)
        if not self.loaded and f_z_n >= high_n:
            self.loaded = True
            if t_mono_ns - self._low_ns <= QUICK_S * 1e9:
                return self._contact(t_mono_ns, t_ns)
        elif self.loaded and f_z_n < low_n:
            self.loaded = False
            off_ns = _crossed_ns(low_n, *segment) if last_n >= low_n else t_mono_ns
            quick = off_ns - self._high_ns <= QUICK_S * 1e9
            self._high_ns = _LONG_AGO_NS
            if quick:
                return self._toe_off(off_ns, t_mono_ns, t_ns)
            self.contact_ns = self._off_ns = None
        return None

    def _contact(self, t_mono_ns: int, t_ns: int) -> GaitEvent:
        contact_ns, self._low_ns = self._low_ns, _LONG_AGO_NS
        figures: dict[str, float | None] = {
            "swing_s": _span_s(self._off_ns, contact_ns),
            "stride_s": _span_s(self._previous_contact_ns, contact_ns),
        }
        stride_s = figures["stride_s"]
        figures["cadence_per_min"] = None if stride_s is None else 120.0 / stride_s
        self.contact_ns = self._previous_contact_ns = contact_ns
        return self._event("initial_contact", contact_ns, t_mono_ns, t_ns, figures)

    def _toe_off(self, off_ns: int, t_mono_ns: int, t_ns: int) -> GaitEvent:
        self.stance_s = _span_s(self.contact_ns, off_ns)
        figures: dict[str, float | None] = {
            "stance_s": self.stance_s,
            "peak_force_n": self._peak_force_n,
            "valid_fraction": self._valid_fraction,
        }
        for name, peak_pa, integral_pa_s in zip(REGIONS, self._peak_pa, self._integral_pa_s, strict=True):
            figures[f"{name}_peak_pa"] = float(peak_pa)
            figures[f"{name}_integral_pa_s"] = float(integral_pa_s)
        self._off_ns, self.contact_ns = off_ns, None
        return self._event("toe_off", off_ns, t_mono_ns, t_ns, figures)

    def _event(
        self, kind: Kind, happened_ns: int, t_mono_ns: int, t_ns: int, figures: dict[str, float | None]
    ) -> GaitEvent:
        after_ns = t_mono_ns - happened_ns
        return GaitEvent(self.foot, kind, t_ns - after_ns, after_ns * 1e-9, figures)

    def _begin(self) -> None:
        """Forget the step before."""
        self._peak_pa = np.zeros(len(REGIONS))
        self._integral_pa_s = np.zeros(len(REGIONS))
        self._peak_force_n, self._valid_fraction = 0.0, 1.0

    def _press(
        self,
        seconds: float,
        f_z_n: float,
        pressure_pa: NDArray[np.floating],
        valid: NDArray[np.uint8] | NDArray[np.bool_],
    ) -> None:
        """Peak pressure and its integral, the customary one of the region's peak (Melai et al. 2011)."""
        if kernel is not None and pressure_pa.itemsize == 4:
            n_usable = kernel.press(
                pressure_pa, valid, self._order, self._ends, seconds, self._peak_pa, self._integral_pa_s
            )
        else:
            highest_pa = np.zeros(len(REGIONS))
            usable = valid.ravel()[self._order]
            pressed = np.where(usable, pressure_pa.ravel()[self._order], 0.0)
            highest_pa[self._present] = np.maximum.reduceat(pressed, self._starts)
            n_usable = int(np.count_nonzero(usable))
            np.maximum(self._peak_pa, highest_pa, out=self._peak_pa)
            self._integral_pa_s += highest_pa * seconds
        self._peak_force_n = max(self._peak_force_n, f_z_n)
        self._valid_fraction = min(self._valid_fraction, n_usable / len(self._order))


class Gait:
    """Detects the steps of both feet, and adds the figures that need both to the events of one."""

    def __init__(self, layouts: list[Layout]) -> None:
        """`layouts`: one a foot, of one foot or both."""
        self._feet = {layout.foot: FootGait(layout) for layout in layouts}

    def update(
        self,
        foot: Foot,
        t_mono_ns: int,
        t_ns: int,
        f_z_n: float | None,
        pressure_pa: NDArray[np.floating],
        valid: NDArray[np.uint8] | NDArray[np.bool_],
    ) -> GaitEvent | None:
        """As FootGait.update. Cycles of one foot come in order, those of both about as they were measured."""
        event = self._feet[foot].update(t_mono_ns, t_ns, f_z_n, pressure_pa, valid)
        if event is None or event.kind != "toe_off":
            return event
        other = self._feet.get("right" if foot == "left" else "left")
        off_ns = t_mono_ns - round(event.noticed_after_s * 1e9)
        both_s = None if other is None else _span_s(other.contact_ns, off_ns)
        event.figures["double_support_s"] = both_s if both_s is None or both_s >= 0 else None
        event.figures["stance_symmetry_percent"] = self._symmetry_percent()
        return event

    def _symmetry_percent(self) -> float | None:
        """Return by how many percent of their mean the left foot's last stance was longer (Robinson et al. 1987)."""
        stances = [self._feet[foot].stance_s if foot in self._feet else None for foot in ("left", "right")]
        left_s, right_s = stances
        return 200.0 * (left_s - right_s) / (left_s + right_s) if left_s and right_s else None


def _crossed_ns(level_n: float, last_ns: int, last_n: float, now_ns: int, now_n: float) -> int:
    """Return when, between the last cycle and this one, the force was `level_n`."""
    part = (level_n - last_n) / (now_n - last_n)  # the level itself may have moved since
    return last_ns + round((now_ns - last_ns) * min(max(part, 0.0), 1.0))


def _span_s(first_ns: int | None, last_ns: int) -> float | None:
    """Return the time in s between two moments; None where the first is not known or longer ago than a stride."""
    seconds = math.inf if first_ns is None else (last_ns - first_ns) * 1e-9
    return seconds if seconds <= LONGEST_STRIDE_S else None
