"""Detect triangles whose frames are lost on the bus."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..contact import joined
from ..finding import Finding
from ..places import place_of_triangles
from .fault_finding import JOINED_S, make_fault_finding
from .wrench import WrenchObservation

REZERO_S = 0.1  # error of the time of a re-zero
USUAL_LOSS = 0.003  # of a triangle's readings, on a bus without a fault
LEAST_REPEATED = 0.005  # share of repeated readings that lost frames make


def detect_lost_frames(
    seen: WrenchObservation, substituted: NDArray[np.bool_], since_s: Mapping[int, float]
) -> list[Finding]:
    """Return the finding on triangles whose readings are missing, or repeat the reading before.

    `since_s` has the times of re-zeros by board, which may send nothing meanwhile.
    """
    rows, shares = [], []
    gaps_s: list[tuple[float, float]] = []
    for row, readings in enumerate(seen.readings):
        if len(readings.t_s) < 50 or substituted[row]:
            continue
        steps = np.diff(readings.t_s)
        rezero_s = since_s.get(int(seen.layout.identities[row, 0]), np.inf)
        is_zeroing = (readings.t_s[:-1] < rezero_s + REZERO_S) & (readings.t_s[1:] > rezero_s - REZERO_S)
        missing = np.where(is_zeroing, 0.0, np.maximum(np.rint(steps / readings.period_s) - 1, 0))
        share = float(missing.sum() / (len(steps) + missing.sum()))
        repeats = (
            readings.held_fraction
            if readings.held_fraction > LEAST_REPEATED and not readings.is_converter_slow
            else 0.0
        )
        if max(share, repeats) > USUAL_LOSS:
            rows.append(row)
            shares.append(max(share, repeats))
            if not gaps_s:
                gaps_s = [(float(readings.t_s[k]), float(readings.t_s[k + 1])) for k in np.flatnonzero(missing)]
    if not rows:
        return []
    where = place_of_triangles(rows, seen.layout)
    is_frequent = len(gaps_s) > 40 or sum(b - a for a, b in gaps_s) > 0.5 * float(np.ptp(seen.t_s))
    text = f"{np.mean(shares):.1%} of the readings did not come, or came again unchanged"
    return [make_fault_finding(seen, "frame_loss", where, () if is_frequent else joined(gaps_s, JOINED_S), text)]
