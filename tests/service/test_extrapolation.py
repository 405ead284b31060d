"""A cycle is counted where a valid taxel reads beyond what its curve was fitted to."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.service.foot import Foot, load_feet
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))


def cycles(counts: np.ndarray) -> Cycles:
    n = len(counts)
    wide, flags = np.zeros((n, len(LAYOUT)), np.int64), np.zeros(n, bool)
    t_ns = 10**18 + 20_000_000 * np.arange(n)
    return Cycles(
        t_ns, t_ns, counts, wide.astype(np.uint16), wide, wide, wide + 2 * np.arange(n)[:, None], wide > 0, flags, flags
    )


@pytest.fixture
def foot(tmp_path: Path) -> Foot:
    """Every taxel rests at 240; the curve of taxel 0 of the first triangle was seen to 30 counts, others have none."""
    curve = {"baseline_count": 240.0, "coefficients_pa": [0, 8e3]}
    taxels: list[dict[str, object]] = [
        {"board": t.board, "triangle": t.triangle, "taxel": int(taxel), **curve}
        for t in LAYOUT.triangles
        for taxel in np.flatnonzero(PRESSURE_TAXELS)
    ]
    taxels[0]["extensions"] = {"valid_range": {"activation_count": [0, 30]}}
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps({"format": "insole-calibration/1", "foot": "left", "taxels": taxels}))
    insole = replace(Config().insoles[0], calibration=path)
    return load_feet(replace(Config(), insoles=(insole,)))[0]


def test_counted_are_cycles_in_which_a_valid_taxel_is_beyond(foot: Foot) -> None:
    counts = np.full((5, len(LAYOUT), 12), 240, np.uint8)
    counts[1, 0, 0] = 210  # 30: as far as it was seen
    counts[2, 0, 0] = 209
    counts[3, 0, 0] = 0  # clamped: not valid, so no pressure is made of it
    counts[4, 0, 1] = 100  # of a taxel of which nobody said how far
    seen = []
    for at in range(5):
        foot.messages(cycles(counts), at)
        seen.append(foot.extrapolated)
    assert seen == [0, 0, 1, 1, 1]
