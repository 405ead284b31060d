"""Copy an insole's layout, calibration and zero into a recording's folder, so that the folder is self-contained."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Board, Foot
from ..files import write_text
from ..physics import calibration as calibrations
from ..physics import effects_document
from ..physics import zero as zeros
from ..physics.calibration import Calibration
from ..physics.zero import Zero
from ..skin import geometry
from ..skin import layout as layouts
from ..skin.layout import Layout, Triangle
from .document import RecordedBoard

BUILTIN_LAYOUT = "the layout of the {foot} foot: the built-in approximation, not measured on this insole"
BUILTIN_CALIBRATION = (
    "the calibration of the {foot} foot: the built-in line, not measured on this insole; "
    "forces are of the right order and no more"
)


@dataclass(frozen=True, slots=True, eq=False)
class InsoleContents:
    """One insole of a recording to be written.

    `calibration` is a file to copy or an object to write. A built-in calibration is written too, and listed as
    invented.
    """

    foot: Foot
    boards: Sequence[Board | RecordedBoard]
    layout: Layout
    calibration: Path | Calibration | None = None
    zero: Zero | None = None


def write_insoles(folder: Path, insoles: Sequence[InsoleContents]) -> tuple[list[dict[str, Any]], list[str]]:
    """Write the copies into `folder`; return the `insoles` of recording.yaml and a sentence per invented item."""
    entries, invented = [], []
    for insole in insoles:
        prefix = f"{insole.foot}-" if len(insoles) > 1 else ""
        entry: dict[str, Any] = {"foot": insole.foot, "layout": f"{prefix}layout.yaml"}
        remark = ""
        if insole.layout.builtin:
            remark = BUILTIN_LAYOUT.format(foot=insole.foot)
            invented.append(remark)
        layouts.write(folder / entry["layout"], insole.layout, remark)
        if isinstance(insole.calibration, Path):
            entry["calibration"] = f"{prefix}calibration.json"
            shutil.copyfile(insole.calibration, folder / entry["calibration"])
        elif insole.calibration is not None:
            entry["calibration"] = f"{prefix}calibration.json"
            if insole.calibration.builtin:
                invented.append(BUILTIN_CALIBRATION.format(foot=insole.foot))
            write_calibration(folder / entry["calibration"], insole.calibration, insole.layout)
        if insole.zero is not None:
            entry["zero"] = f"{prefix}zero.json"
            zeros.save(folder / entry["zero"], insole.zero, insole.layout)
        entry["boards"] = [
            {
                "address": board.address,
                "interface": board.interface,
                "period_ms": board.period_ms,
                "shift": board.shift,
                "no_load": board.no_load,
                "skin_type": board.skin_type,
            }
            for board in insole.boards
        ]
        entries.append(entry)
    return entries, invented


def write_calibration(path: Path, calibration: Calibration, layout: Layout) -> None:
    """Write `calibration` as a file that `calibration.load` reads, all or nothing; OSError if that fails."""
    identities = layout.identities.tolist()
    rows = []
    for row, taxel in np.argwhere(calibration.usable).tolist():
        board, triangle = identities[row]
        entry: dict[str, Any] = {
            "board": board,
            "triangle": triangle,
            "taxel": taxel,
            "baseline_count": float(calibration.baseline_count[row, taxel]),
            "coefficients_pa": calibration.coefficients_pa[row, taxel].tolist(),
        }
        if calibration.covariance_pa2 is not None and not np.isnan(calibration.covariance_pa2[row, taxel]).any():
            entry["extensions"] = {calibrations.COVARIANCE: calibration.covariance_pa2[row, taxel].tolist()}
        rows.append(json.dumps(entry, allow_nan=False))
    head: dict[str, Any] = {"format": calibrations.FORMAT, "foot": calibration.foot}
    tail: dict[str, Any] = {
        "effects": effects_document.document(calibration.effects, layout),
        "provenance": dict(calibration.provenance),
    }
    if calibration.extensions:
        tail["extensions"] = dict(calibration.extensions)
    taxels = ",\n  ".join(rows)
    write_text(path, f'{json.dumps(head)[:-1]}, "taxels": [\n  {taxels}\n], {json.dumps(tail)[1:]}\n')


def layout_of_meta(meta: Mapping[str, Any], xy_m: NDArray[np.floating[Any]]) -> Layout:
    """Reconstruct the layout from a daemon's `meta` and its taxel positions `xy_m` (n_triangles, 12, 2).

    Fits the triangle's geometry to the positions of each triangle, with and without mirroring, and takes the better
    fit.
    """
    local = geometry.TAXELS_MM[:, 0] + 1j * geometry.TAXELS_MM[:, 1]
    triangles = []
    for described, positions_mm in zip(meta["triangles"], np.asarray(xy_m, np.float64) * 1e3, strict=True):
        position = positions_mm[:, 0] + 1j * positions_mm[:, 1]
        centred = position - position[3]  # taxel 3 is the centre
        fits = []
        for mirrored in (False, True):
            template = -local.conjugate() if mirrored else local
            angle = float(np.angle(np.vdot(template, centred)))
            fits.append((float(np.abs(centred - template * np.exp(1j * angle)).sum()), mirrored, math.degrees(angle)))
        _, mirrored, rotation_deg = min(fits)
        triangles.append(
            Triangle(
                board=described["board"],
                triangle=described["triangle"],
                patch=described["patch"],
                x_mm=round(float(position[3].real), 3),
                y_mm=round(float(position[3].imag), 3),
                rotation_deg=round(rotation_deg % 360.0, 3) % 360.0,
                mirrored=mirrored,
            )
        )
    return layouts.of(
        meta["foot"], meta["taxel_area_m2"], meta["area_meaning"], tuple(triangles), meta["layout_builtin"]
    )
