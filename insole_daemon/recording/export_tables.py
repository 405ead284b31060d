"""Export a recording as tables: a folder of CSV or Parquet, one CSV file, .npz for numpy, .mat for MATLAB."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError
from ..files import unfinished, write_text
from ..mechanics.gait.steps import Steps
from ..mechanics.wrench import WrenchSeries
from ..skin import layout as layouts
from . import reference as references
from .lab import need
from .loading import FootRecording, Recording
from .reference import TIME
from .views import pressures_by_region
from .writer import whole_folder


def export_csv(recording: Recording, out: Path, progress: Callable[[float], None] = lambda share: None) -> None:
    """Write the folder `out` with one table per foot and quantity, all or nothing.

    `left-counts.csv` can be read by `insole import`, together with `left-layout.yaml`. `progress` is called with the
    fraction written.
    """
    with whole_folder(out) as folder:
        for number, foot in enumerate(recording.feet):
            identities = foot.layout.identities.tolist()
            taxels = [f"{board}_{triangle}_{taxel}" for board, triangle in identities for taxel in range(12)]
            times = _format_times(foot.t_ns)
            flat = foot.counts.reshape(len(foot), -1)
            _write_csv(folder / f"{foot.foot}-counts.csv", [f"count_{name}" for name in taxels], times, flat.tolist())
            _write_csv(
                folder / f"{foot.foot}-valid.csv",
                [f"valid_{name}" for name in taxels],
                times,
                foot.valid.reshape(len(foot), -1).astype(np.uint8).tolist(),
            )
            progress((number + 0.4) / len(recording.feet))  # pressures take longest
            if foot.pressure_pa is not None and foot.wrench is not None:
                pressure = foot.pressure_pa.reshape(len(foot), -1)
                _write_csv(
                    folder / f"{foot.foot}-pressure.csv", [f"pressure_pa_{name}" for name in taxels], times, pressure
                )
                wrench = {name: getattr(foot.wrench, name) for name in type(foot.wrench).__slots__}
                _write_csv(
                    folder / f"{foot.foot}-wrench.csv", list(wrench), times, np.stack(list(wrench.values()), axis=-1)
                )
            if foot.reference is not None:
                columns = dict(foot.reference.columns)
                if foot.reference.time_s is not None:
                    columns = {TIME: foot.reference.time_s, **columns}
                write_text(folder / f"{foot.foot}-reference.csv", references.text(columns))
            layouts.write(folder / f"{foot.foot}-layout.yaml", foot.layout)
            progress((number + 1) / len(recording.feet))
        write_text(folder / "steps.csv", format_steps(recording.steps))


def export_cycle_table(recording: Recording, out: Path) -> None:
    """Write wrench and pressure by region as CSV, one row per foot and cycle in order of time.

    Columns after those of the wrench: `peak_pa` and `mean_pa` of the sole, and `heel_peak_pa`, `heel_mean_pa` … of each
    region. Raises FileError if no foot has a calibration.
    """
    feet = [foot for foot in recording.feet if foot.wrench is not None]
    if not feet:
        raise FileError(
            f"{recording.folder}: no foot has a calibration, so there is no force for {out.name}; "
            f"'insole export {recording.folder} {out.stem} --to csv' writes the counts"
        )
    columns_by_foot = [_cycle_columns(foot) for foot in feet]
    t_ns = np.concatenate([foot.t_ns for foot in feet])
    foot_of_row = np.concatenate([np.full(len(foot), foot.foot) for foot in feet])
    rows = np.concatenate([np.stack(list(columns.values()), axis=-1) for columns in columns_by_foot])
    order = np.argsort(t_ns, kind="stable")
    lines = [",".join((TIME, "foot", *columns_by_foot[0]))]
    for time, foot, row in zip(
        _format_times(t_ns[order]), foot_of_row[order].tolist(), rows[order].tolist(), strict=True
    ):
        lines.append(",".join((time, foot, *("" if value != value else f"{value:.9g}" for value in row))))
    write_text(out, "\n".join(lines) + "\n")


def _cycle_columns(foot: FootRecording) -> dict[str, NDArray[np.float64]]:
    """Return the wrench and the pressures by region of a foot with a calibration, (n_cycles,) each, by column."""
    wrench = {name: getattr(foot.wrench, name) for name in WrenchSeries.__slots__}
    pressures = pressures_by_region(foot)
    return wrench | {"_".join(filter(None, (*key, "pa"))): values for key, values in pressures.items()}


def export_npz(recording: Recording, out: Path) -> None:
    """Write `out` as .npz: for one foot in the format of counts.npz, for two with the prefixes left_ and right_."""
    arrays: dict[str, Any] = dict(_metadata(recording))
    for foot in recording.feet:
        prefix = f"{foot.foot}_" if len(recording.feet) > 1 else ""
        arrays |= {f"{prefix}{name}": array for name, array in foot_arrays(foot).items()}
    with unfinished(out) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)


def export_matlab(recording: Recording, out: Path) -> None:
    """Write `out` with the structs `left` and `right`, the steps, and the recording's metadata in `recording`."""
    io = need("scipy.io", "scipy", "exporting MATLAB files")
    content: dict[str, Any] = {"recording": _metadata(recording)}
    for foot in recording.feet:
        content[foot.foot] = foot_arrays(foot)
    steps = recording.steps
    content["steps"] = {**steps.columns, **{f"curve_{name}": curve for name, curve in steps.curves.items()}}
    with unfinished(out) as temporary, open(temporary, "wb") as file:
        io.savemat(file, content, do_compression=True, long_field_names=True)


def export_parquet(recording: Recording, out: Path) -> None:
    """Write the folder `out`: steps.parquet, and per foot a table of cycles with the taxels as lists in a column."""
    arrow = need("pyarrow", "pyarrow", "exporting Parquet")
    parquet = need("pyarrow.parquet", "pyarrow", "exporting Parquet")
    with whole_folder(out) as folder:
        parquet.write_table(_to_arrow_table(arrow, recording.steps.columns, {}), folder / "steps.parquet")
        for foot in recording.feet:
            columns = foot_arrays(foot)
            n = len(foot)
            layout_json = {name: json.dumps(columns.pop(name).tolist()) for name in ("board", "triangle", "xy_m")}
            cycles = {name: column for name, column in columns.items() if not name.startswith("reference_")}
            reference_columns = {
                name.removeprefix("reference_"): columns[name] for name in columns.keys() - cycles.keys()
            }
            flat_columns = {
                name: column.reshape(n, -1) if column.ndim > 1 else column for name, column in cycles.items()
            }
            metadata = {"foot": foot.foot, "triangles": str(len(foot.layout)), **layout_json, **_metadata(recording)}
            parquet.write_table(_to_arrow_table(arrow, flat_columns, metadata), folder / f"{foot.foot}.parquet")
            if reference_columns:
                parquet.write_table(
                    _to_arrow_table(arrow, reference_columns, {}), folder / f"{foot.foot}-reference.parquet"
                )


def _to_arrow_table(arrow: Any, columns: Mapping[str, NDArray[Any]], about: Mapping[str, str]) -> Any:
    arrays = {}
    for name, column in columns.items():
        values = arrow.array(np.ascontiguousarray(column).ravel())
        arrays[name] = values if column.ndim == 1 else arrow.FixedSizeListArray.from_arrays(values, column.shape[1])
    return arrow.table(arrays).replace_schema_metadata(dict(about))


def format_steps(steps: Steps) -> str:
    """Return the table of steps as CSV; unknown values are empty cells."""
    lines = [",".join(steps.columns)]
    for row in zip(*(column.tolist() for column in steps.columns.values()), strict=True):
        lines.append(
            ",".join("" if cell != cell else f"{cell:.9g}" if isinstance(cell, float) else str(cell) for cell in row)
        )
    return "\n".join(lines) + "\n"


def foot_arrays(foot: FootRecording) -> dict[str, NDArray[Any]]:
    """Return all arrays of one foot by name, with the unit in the name."""
    arrays: dict[str, NDArray[Any]] = {
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
        arrays["pressure_pa"] = foot.pressure_pa
        arrays |= {name: getattr(foot.wrench, name) for name in type(foot.wrench).__slots__}
    if foot.reference is not None:
        if foot.reference.time_s is not None:
            arrays["reference_time_s"] = foot.reference.time_s
        arrays |= {f"reference_{name}": column for name, column in foot.reference.columns.items()}
    return arrays


def _metadata(recording: Recording) -> Mapping[str, str]:
    """Return the recording's kind, origin, invented items and reference clocks as text."""
    return {
        "kind": recording.kind,
        "can_origin": recording.can_origin,
        "invented": "; ".join(recording.invented),
        "reference_clock": ", ".join(
            f"{foot.foot}: {foot.reference.clock}" for foot in recording.feet if foot.reference is not None
        ),
    }


def _format_times(t_ns: NDArray[np.int64]) -> list[str]:
    """Return times (n,) in ns as text: seconds with six decimals."""
    return [f"{t // 1000 // 10**6}.{t // 1000 % 10**6:06d}" for t in t_ns.tolist()]


def _write_csv(path: Path, names: list[str], times: list[str], rows: Any) -> None:
    """Write a table with the times in the first column; NaN becomes an empty cell."""
    with open(path, "w", encoding="utf-8") as file:
        file.write(",".join((TIME, *names)) + "\n")
        for time, row in zip(times, rows, strict=True):
            if isinstance(row, np.ndarray):
                cells = ["" if value != value else f"{value:.9g}" for value in row.tolist()]
            else:
                cells = list(map(str, row))
            file.write(f"{time},{','.join(cells)}\n")
