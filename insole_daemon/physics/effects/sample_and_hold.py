"""Sample and hold: converters run freely, so a board reads the result of their last sequence."""

from __future__ import annotations

import numpy as np

from ...skin.geometry import N_TAXELS
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values
from ..past import SignalHistory
from ..sampling import conversion_time_s, draw_phases_s


def _forward(values: Values, site: Site) -> Operator:
    """Return each triangle's columns as they were at its converter's last sequence."""
    rates_hz = np.broadcast_to(values["rate_hz"], site.columns.shape)
    converters = []
    for row in np.unique(site.columns // N_TAXELS).tolist():
        board, triangle = site.layout.identities[row].tolist()
        triangle_columns = np.flatnonzero(site.columns // N_TAXELS == row)
        hz = float(rates_hz[triangle_columns[0]])
        converters.append((float(draw_phases_s(site.seed, board, hz)[triangle]), hz, triangle_columns))
    history = SignalHistory()

    def forward(x: Array, moments: Moments) -> Array:
        wanted = [(conversion_time_s(moments.t_s, phase_s, hz), columns) for phase_s, hz, columns in converters]
        return history.at(x, moments.t_s, wanted)

    return forward


LAW = Law(
    word="sample_and_hold",
    order=9,
    domain="count",
    equation="c(t) ← c(φ + ⌊(t − φ)·f⌋/f), each triangle's phase φ from the seed",
    source="AD7147 data sheet, table 10: twelve stages in 36.864 ms at decimation 256; icub-firmware, AD7147.c 71",
    parameters=(
        Parameter("rate_hz", "Hz", 1.0, 1000.0, (27.0, 27.3), "f: 27.127 Hz; 54 and 109 at other decimations"),
    ),
    forward=_forward,
    inverse=None,
    inverse_is="none: the load between conversions was not read. Stamp the readings with t − 1/(2·rate_hz) instead",
    late_s=lambda values: 0.5 / values["rate_hz"],
    scopes=("insole", "board"),
)
