"""Delay: readings arrive late by a constant time."""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Moments, Parameter, Site, Values
from ..past import SignalHistory


class _Delay:
    """Returns each column as it was its delay ago."""

    def __init__(self, values: Values, site: Site) -> None:
        delays = np.broadcast_to(values["delay_s"], site.columns.shape)
        self._groups = [(float(d), np.flatnonzero(delays == d)) for d in np.unique(delays)]
        self._history = SignalHistory()

    def __call__(self, x: Array, moments: Moments) -> Array:
        wanted = [(moments.t_s - delay_s, columns) for delay_s, columns in self._groups]
        return self._history.at(x, moments.t_s, wanted)


LAW = Law(
    word="delay",
    order=10,
    domain="count",
    equation="c(t) ← c(t − d)",
    source="the bus, the host and the converters' own 37 ms: icub-firmware, AD7147.c; AD7147 data sheet, table 10",
    parameters=(Parameter("delay_s", "s", 0.0, 10.0, (0.005, 0.08), "delay of the readings"),),
    forward=_Delay,
    inverse=None,
    inverse_is="none: it would need future readings. Stamp the readings with t − delay_s instead",
    late_s=lambda values: values["delay_s"],
)
