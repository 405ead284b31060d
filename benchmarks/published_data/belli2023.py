"""The published trials, read by the project's own importer."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insole_daemon
from insole_daemon.recording.import_matlab import import_matlab
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import Layout

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "belli2023"
CALIBRATION = Path("left_insole", "calibration_dataset.mat")


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One file: n cycles of 280 taxels, and a reference of m rows without times."""

    name: str
    layout: Layout
    t_s: NDArray[np.float64]  # (n,) from the first cycle
    counts: NDArray[np.float64]  # (n, 280)
    pressure_pa: NDArray[np.float64]  # (m,)


def slots(layout: Layout) -> NDArray[np.intp]:
    """(280,) the slot, 12 · row + taxel, of each of the published columns."""
    return np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout)))


def read(path: Path) -> Trial:
    """The trial in the MATLAB file `path`."""
    with tempfile.TemporaryDirectory() as folder:
        side = "right" if path.parent.name.startswith("right") else "left"
        foot = insole_daemon.load(import_matlab(path, Path(folder) / "trial", side, None))[side]
        assert foot.reference is not None
        return Trial(
            path.stem,
            foot.layout,
            (foot.t_ns - foot.t_ns[0]) * 1e-9,
            foot.counts.reshape(len(foot), -1)[:, slots(foot.layout)].astype(float),
            np.array(foot.reference["pressure_pa"]),
        )
