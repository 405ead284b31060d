"""A recording as tables: a folder of CSV, an .npz for numpy, a .mat for MATLAB."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import unfinished, write_text
from ..skin import layout as layouts
from . import reference as references
from .lab import need
from .loading import FootRecording, Recording
from .reference import TIME
from .writer import whole_folder


def export_csv(recording: Recording, out: Path) -> None:
    """Write the folder `out` with a table a foot and kind of value, all or nothing.

    `left-counts.csv` is what `insole import` takes, together with `left-layout.yaml`.
    """
    with whole_folder(out) as folder:
        for foot in recording.feet:
            identities = foot.layout.identities.tolist()
            taxels = [f"{board}_{triangle}_{taxel}" for board, triangle in identities for taxel in range(12)]
            times = [f"{t // 1000 // 10**6}.{t // 1000 % 10**6:06d}" for t in foot.t_ns.tolist()]
            flat = foot.counts.reshape(len(foot), -1)
            _write(folder / f"{foot.foot}-counts.csv", [f"count_{name}" for name in taxels], times, flat.tolist())
            _write(
                folder / f"{foot.foot}-valid.csv",
                [f"valid_{name}" for name in taxels],
                times,
                foot.valid.reshape(len(foot), -1).astype(np.uint8).tolist(),
            )
            if foot.pressure_pa is not None and foot.wrench is not None:
                pressure = foot.pressure_pa.reshape(len(foot), -1)
                _write(
                    folder / f"{foot.foot}-pressure.csv", [f"pressure_pa_{name}" for name in taxels], times, pressure
                )
                wrench = {name: getattr(foot.wrench, name) for name in type(foot.wrench).__slots__}
                _write(
                    folder / f"{foot.foot}-wrench.csv", list(wrench), times, np.stack(list(wrench.values()), axis=-1)
                )
            if foot.reference is not None:
                columns = dict(foot.reference.columns)
                if foot.reference.time_s is not None:
                    columns = {TIME: foot.reference.time_s, **columns}
                write_text(folder / f"{foot.foot}-reference.csv", references.text(columns))
            layouts.write(folder / f"{foot.foot}-layout.yaml", foot.layout)


def export_npz(recording: Recording, out: Path) -> None:
    """Write `out`; of one foot it is a counts.npz too, of two the names begin with left_ and right_."""
    arrays: dict[str, Any] = dict(_about(recording))
    for foot in recording.feet:
        prefix = f"{foot.foot}_" if len(recording.feet) > 1 else ""
        arrays |= {f"{prefix}{name}": array for name, array in fields(foot).items()}
    with unfinished(out) as beside, open(beside, "wb") as file:
        np.savez_compressed(file, **arrays)


def export_matlab(recording: Recording, out: Path) -> None:
    """Write `out`: a struct a foot, `left` and `right`, and what they are in `recording`."""
    io = need("scipy.io", "scipy", "exporting MATLAB files")
    content: dict[str, Any] = {"recording": _about(recording)}
    for foot in recording.feet:
        content[foot.foot] = fields(foot)
    with unfinished(out) as beside, open(beside, "wb") as file:
        io.savemat(file, content, do_compression=True, long_field_names=True)


def fields(foot: FootRecording) -> dict[str, NDArray[Any]]:
    """Everything of one foot by name, the unit in it."""
    found: dict[str, NDArray[Any]] = {
        "t_s": foot.t_ns * 1e-9,
        "t_ns": foot.t_ns,
        "counts": foot.counts,
        "valid": foot.valid.astype(np.uint8),
        "status": foot.status,
        "age_ms": np.where(foot.age_ns < 0, np.nan, foot.age_ns * 1e-6).astype(np.float32),
        "missing": foot.missing.astype(np.uint8),
        "late": foot.late.astype(np.uint8),
        "repeated": foot.repeated.astype(np.uint8),
        "board": foot.layout.identities[:, 0],
        "triangle": foot.layout.identities[:, 1],
        "xy_m": foot.layout.xy_m,
    }
    if foot.pressure_pa is not None and foot.wrench is not None:
        found["pressure_pa"] = foot.pressure_pa
        found |= {name: getattr(foot.wrench, name) for name in type(foot.wrench).__slots__}
    if foot.reference is not None:
        if foot.reference.time_s is not None:
            found["reference_time_s"] = foot.reference.time_s
        found |= {f"reference_{name}": column for name, column in foot.reference.columns.items()}
    return found


def _about(recording: Recording) -> Mapping[str, str]:
    return {
        "kind": recording.kind,
        "can_origin": recording.can_origin,
        "invented": "; ".join(recording.invented),
        "reference_clock": ", ".join(
            f"{foot.foot}: {foot.reference.clock}" for foot in recording.feet if foot.reference is not None
        ),
    }


def _write(path: Path, names: list[str], times: list[str], rows: Any) -> None:
    """A table with the times before the rows; NaN becomes an empty cell."""
    with open(path, "w", encoding="utf-8") as file:
        file.write(",".join((TIME, *names)) + "\n")
        for time, row in zip(times, rows, strict=True):
            if isinstance(row, np.ndarray):
                cells = ["" if value != value else f"{value:.9g}" for value in row.tolist()]
            else:
                cells = list(map(str, row))
            file.write(f"{time},{','.join(cells)}\n")
