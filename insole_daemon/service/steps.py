"""The steps of the wearer as events, published after the cycle in which they are detected."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..mechanics.gait import Gait, GaitEvent
from ..wire.messages import Event
from .foot import Foot, PublishedLoad


class StepEvents:
    """Watches both feet of the wearer for steps."""

    def __init__(self, feet: Sequence[Foot]) -> None:
        self._feet = feet
        self._begin()

    def _begin(self) -> None:
        self._layouts = {foot.name: foot.layout for foot in self._feet}
        self._gait = Gait(list(self._layouts.values()))

    def take(self, foot: Foot, t_mono_ns: int, load: PublishedLoad) -> Event | None:
        """Return the event that one cycle of `foot`, closed at `t_mono_ns`, brings; a repeat brings none."""
        if load.repeated:
            return None
        if foot.layout is not self._layouts[foot.name]:  # a reload moved the taxels
            self._begin()
        f_z_n = load.f_z_n if math.isfinite(load.f_z_n) else None
        event = self._gait.update(foot.name, t_mono_ns, load.t_ns, f_z_n, load.pressure_pa, load.valid)
        if event is None:
            return None
        return Event(event.foot, event.t_ns, event.kind, _text(event), [], figures=event.figures)


def _text(event: GaitEvent) -> str:
    figures = event.figures
    if event.kind == "initial_contact":
        items = [("swing", figures["swing_s"], "{:.2f} s"), ("cadence", figures["cadence_per_min"], "{:.0f} steps/min")]
    else:
        items = [("stance", figures["stance_s"], "{:.2f} s"), ("peak force", figures["peak_force_n"], "{:.0f} N")]
    known = [f"{name} {form.format(value)}" for name, value, form in items if value is not None]
    words = "touches the ground" if event.kind == "initial_contact" else "leaves the ground"
    return f"the {event.foot} foot {words}" + (f": {', '.join(known)}" if known else "")
