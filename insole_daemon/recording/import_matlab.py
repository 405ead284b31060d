"""Import the published recordings of Belli et al. 2023 (MATLAB v5): a struct `experiment` with C and, for a chamber, P.

C (n, 2 + columns) is a counter, the time in s at which YARP published the row, and counts. P (m, 1) is the chamber's
pressure in bar, without times and with another number of rows. Source:
ami-iit/paper_belli_2023_sensors_insole-calibration, Code/calibration_taxels.m.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..errors import FileError
from ..skin.layout import Layout
from .columns import counts_of, insole_of_published, to_nanoseconds
from .counts import CountsTable
from .mat5 import read_struct
from .writer import ReferenceContents, write

_PA_PER_BAR = 1e5
_MAX_BAR = 50.0  # the chamber reaches 10 bar, so larger values have another unit


def import_matlab(source: Path, out: Path, foot: Foot, layout: Layout | None) -> Path:
    """Write the recording `out` from the file `source`; FileError if it is not in this format."""
    experiment = _read_experiment(source)
    table = _get_matrix(source, experiment, "C")
    if table.shape[1] < 3:
        raise FileError(f"{source}: C: expected a counter, a time and counts in each row, found {table.shape}")
    invented = ["times: when YARP published the row, in seconds of an unknown epoch; no frame's receive time is known"]
    insole = insole_of_published(foot, layout, invented)
    counts = counts_of(table[:, 2:], insole.layout, f"{source}: C", invented)
    t_ns = to_nanoseconds(table[:, 1], f"{source}: C")
    reference = []
    if "P" in experiment:
        pressure = _get_matrix(source, experiment, "P")[:, 0]
        if np.nanmax(pressure, initial=0.0) > _MAX_BAR:
            raise FileError(
                f"{source}: P: expected bar, up to {_MAX_BAR:g}, found {np.nanmax(pressure):g}: is this another unit?"
            )
        reference = [ReferenceContents(foot, "own", {"pressure_pa": pressure * _PA_PER_BAR})]
    return write(
        out,
        kind="chamber" if reference else "free",
        can_origin="reencoded",
        insoles=[insole],
        counts={foot: CountsTable(t_ns, counts)},
        reference=reference,
        invented=invented,
        source=source.name,
    )


def _read_experiment(source: Path) -> dict[str, NDArray[np.float64] | None]:
    """Read the struct `experiment`; FileError if the file has none with a field C."""
    try:
        matrices = read_struct(source, "experiment")
    except (OSError, ValueError) as error:
        raise FileError(f"{source}: expected a MATLAB file of version 5 to 7, found another: {error}") from error
    if "C" not in matrices:
        raise FileError(
            f"{source}: expected a struct experiment with C and P, found {', '.join(matrices) or 'no such struct'}"
        )
    return matrices


def _get_matrix(source: Path, experiment: dict[str, NDArray[np.float64] | None], name: str) -> NDArray[np.float64]:
    matrix = experiment[name]
    if matrix is None or matrix.ndim != 2 or 0 in matrix.shape:
        kind = "no numbers" if matrix is None else matrix.shape
        raise FileError(f"{source}: {name}: expected a matrix of numbers, found {kind}")
    return matrix
