"""Readings that arrive late, all by the same time."""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Moments, Parameter, Site, Values


class _Delay:
    """c(t − d), between two samples by interpolation: exact where the signal is linear there."""

    def __init__(self, values: Values, site: Site) -> None:
        delays = np.broadcast_to(values["delay_s"], site.columns.shape)
        self._groups = [(float(d), np.flatnonzero(delays == d)) for d in np.unique(delays)]
        self._longest_s = float(delays.max())
        self._past_t_s = np.empty(0)
        self._past: Array | None = None

    def __call__(self, x: Array, moments: Moments) -> Array:
        t_s = np.concatenate([self._past_t_s, moments.t_s])
        known = x if self._past is None else np.concatenate([self._past, x])
        late = np.empty_like(x)
        for delay_s, columns in self._groups:
            wanted = moments.t_s - delay_s
            after = np.searchsorted(t_s, wanted, side="left").clip(0, len(t_s) - 1)
            before = np.maximum(after - 1, 0)
            gap = t_s[after] - t_s[before]
            share = np.where(gap > 0, (wanted - t_s[before]) / np.where(gap > 0, gap, 1.0), 0.0).clip(0.0, 1.0)
            since, until = known[before[:, None], columns], known[after[:, None], columns]
            late[:, columns] = since + share[:, None] * (until - since)
        # The newest sample that is older than all that will be asked for, and what came after it.
        keep = max(int(np.searchsorted(t_s, moments.t_s[-1] - self._longest_s, side="right")) - 1, 0)
        self._past_t_s, self._past = t_s[keep:].copy(), known[keep:].copy()
        return late


LAW = Law(
    word="delay",
    order=10,
    domain="count",
    equation="c(t) ← c(t − d)",
    source="the bus, the host and the converters' own 37 ms: icub-firmware, AD7147.c; AD7147 data sheet, table 10",
    parameters=(Parameter("delay_s", "s", 0.0, 10.0, (0.005, 0.08), "how late"),),
    forward=_Delay,
    inverse=None,
    inverse_is="none: it would need the future. Stamp the readings with t − delay_s instead",
)
