"""The unloaded count of every taxel (`insole-zero/1`), which replaces the calibration's baselines."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..documents import Key, Reading, Section, at_least, read, spell, within
from ..files import write_text
from ..skin.geometry import N_TAXELS, THERMAL_PADS
from ..skin.layout import Layout
from .calibration import Calibration

FORMAT = "insole-zero/1"

Foot = Literal["left", "right"]


@dataclass(frozen=True, slots=True, eq=False)
class Zero:
    """Mean and noise of every unloaded taxel of a layout, in the layout's order."""

    foot: Foot
    t_ns: int  # time of the measurement, CLOCK_REALTIME
    baseline_count: NDArray[np.float64]  # (n_triangles, 12) NaN: not listed
    noise_count: NDArray[np.float64]  # (n_triangles, 12) standard deviation of one reading; NaN: not listed

    def __post_init__(self) -> None:
        for array in (self.baseline_count, self.noise_count):
            array.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Taxel(Section):
    board: Annotated[int, within(1, 14)]
    triangle: Annotated[int, within(0, 15)]
    taxel: Annotated[int, within(0, N_TAXELS - 1)]
    baseline_count: Annotated[float, within(0, 255)]
    noise_count: Annotated[float, within(0, 255)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _File(Section):
    foot: Foot
    t_ns: Annotated[int, within(0, 2**63 - 1)]
    taxels: Annotated[tuple[_Taxel, ...], at_least(1)]


def load(path: str | PathLike[str], layout: Layout) -> Zero:
    """Load the zero in file `path` for the taxels of `layout`; DocumentError lists all problems."""
    file = read(path, _File, FORMAT, _check(layout))
    baseline = np.full((len(layout), N_TAXELS), np.nan)
    noise = baseline.copy()
    for entry in file.taxels:
        index = layout.rows[entry.board, entry.triangle], entry.taxel
        baseline[index], noise[index] = entry.baseline_count, entry.noise_count
    return Zero(file.foot, file.t_ns, baseline, noise)


def document(zero: Zero, layout: Layout) -> dict[str, Any]:
    """Return the file's content as plain maps, lists and numbers; `layout` is the one the zero was measured with."""
    identities = layout.identities.tolist()
    return {
        "format": FORMAT,
        "foot": zero.foot,
        "t_ns": zero.t_ns,
        "taxels": [
            {
                "board": identities[row][0],
                "triangle": identities[row][1],
                "taxel": taxel,
                "baseline_count": round(float(zero.baseline_count[row, taxel]), 4),
                "noise_count": round(float(zero.noise_count[row, taxel]), 4),
            }
            for row, taxel in np.argwhere(~np.isnan(zero.baseline_count)).tolist()
        ],
    }


def save(path: str | PathLike[str], zero: Zero, layout: Layout) -> None:
    """Write `zero` to `path`, all or nothing: after a power cut the file is the old or the new one.

    Raises OSError if it cannot be written, and then leaves nothing behind.
    """
    content = document(zero, layout)
    rows = ",\n  ".join(json.dumps(taxel, allow_nan=False) for taxel in content.pop("taxels"))
    write_text(Path(path), f'{json.dumps(content)[:-1]}, "taxels": [\n  {rows}\n]}}\n')


def apply(calibration: Calibration, zero: Zero) -> Calibration:
    """Return `calibration` with the baselines of `zero`; taxels that are not in the zero keep theirs.

    A taxel that the calibration does not list stays unusable, because a zero does not contain its sensitivity.
    """
    listed = ~np.isnan(zero.baseline_count) & calibration.usable
    baseline = np.where(listed, zero.baseline_count, calibration.baseline_count)
    baseline.setflags(write=False)
    return dataclasses.replace(calibration, baseline_count=baseline)


def _check(layout: Layout) -> Callable[[Reading], None]:
    """Return a check across the whole file."""

    def check(reading: Reading) -> None:
        file_foot = reading.document.get("foot")
        if file_foot in ("left", "right") and file_foot != layout.foot:
            reading.problem(
                ("foot",), f"expected the zero of the {layout.foot} foot, found that of the {file_foot} foot"
            )
        rows = layout.rows
        first: dict[tuple[int, int, int], Key] = {}
        unknown_triangles: set[tuple[int, int]] = set()
        for key, entry in reading.of(_Taxel):
            identity = (entry.board, entry.triangle, entry.taxel)
            if entry.taxel in THERMAL_PADS:
                reading.problem(
                    (*key, "taxel"), f"taxel {entry.taxel} is a thermal pad: it has no pressure, leave it out"
                )
            if identity in first:
                reading.problem(
                    key,
                    f"taxel {entry.taxel} of triangle {entry.triangle} of board {entry.board} is listed twice, "
                    f"first in {spell(first[identity])}",
                )
            first.setdefault(identity, key)
            if identity[:2] not in rows and identity[:2] not in unknown_triangles:
                unknown_triangles.add(identity[:2])  # report each triangle once
                reading.problem(
                    key,
                    f"triangle {entry.triangle} of board {entry.board} is not in the layout: "
                    "is this the zero of another insole? Take a new one with 'insole zero'",
                )

    return check
