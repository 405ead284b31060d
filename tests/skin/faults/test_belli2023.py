"""The public insole recording: what is loose in it is found, and never valid."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from insole_daemon.skin.geometry import PRESSURE_TAXELS

ROOT = Path(__file__).parents[3]
FOLDER = ROOT.parent / "shared" / "data" / "belli2023"


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no public recordings beside the repository")
def test_loose_triangles_are_told_and_never_valid() -> None:
    spec = importlib.util.spec_from_file_location("belli2023", ROOT / "benchmarks" / "belli2023.py")
    assert spec is not None
    assert spec.loader is not None
    belli2023 = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(belli2023)
    found = belli2023.play(FOLDER, 3000)
    rails = belli2023.on_rails(found.counts)
    assert rails.sum() > 3000
    assert not (found.valid[..., PRESSURE_TAXELS].any(axis=2) & rails).any()
    told = {
        (event.boards[0], event.triangle): (event.t_ns - belli2023.START_NS) * 1e-9
        for event in reversed(found.events)
        if event.kind == "triangle_loose"
    }
    for row in np.flatnonzero(rails.any(axis=0)):
        triangle = belli2023.LAYOUT.triangles[row]
        first_s = found.t_s[rails[:, row].argmax()]
        assert told[triangle.board, triangle.triangle] <= first_s + 0.001
