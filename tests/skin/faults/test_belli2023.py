"""The public insole recording: what is loose in it is found, and never valid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.published_data import faults
from insole_daemon.skin.geometry import PRESSURE_TAXELS

EXCERPT = Path(__file__).parents[2] / "data" / "belli2023"


def test_loose_triangles_are_reported_and_never_valid() -> None:
    played = faults.play(EXCERPT)
    rails = faults.on_rails(played.counts)
    assert rails.sum() > 3000
    assert not (played.valid[..., PRESSURE_TAXELS].any(axis=2) & rails).any()
    reported_s = {
        (event.boards[0], event.triangle): (event.t_ns - faults.START_NS) * 1e-9
        for event in reversed(played.events)
        if event.kind == "triangle_loose"
    }
    for row in np.flatnonzero(rails.any(axis=0)):
        triangle = faults.LAYOUT.triangles[row]
        first_s = played.t_s[rails[:, row].argmax()]
        assert reported_s[triangle.board, triangle.triangle] <= first_s + 0.001
