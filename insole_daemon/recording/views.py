"""Convert a loaded recording to other forms: steps, a DataFrame, an xarray Dataset, a short description."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..mechanics.region_map import load_regions, map_regions
from ..mechanics.region_pressure import region_pressures
from .lab import need

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from ..mechanics.gait.steps import Steps
    from .loading import FootRecording, Recording

_REFERENCE_LIMIT_S = 0.1  # a cycle gets no reference value if the nearest reading is farther away


def steps_of_recording(recording: Recording) -> Steps:
    """Return the steps; see Recording.steps."""
    from .steps import step_table

    return step_table(recording.feet)


def describe(recording: Recording) -> str:
    """Describe the recording: what it is, one line per foot, and the numbers of warnings and invented items."""
    seconds = max((float(foot.t_ns[-1] - foot.t_ns[0]) * 1e-9 for foot in recording.feet if len(foot)), default=0.0)
    lines = [f"Recording {recording.folder}: {recording.kind}, {recording.can_origin}, {seconds:.1f} s"]
    lines += [f"  {describe_foot(foot).splitlines()[0]}" for foot in recording.feet]
    lines.append(f"  {len(recording.warnings)} warnings, {len(recording.invented)} invented items")
    lines.append("  .steps  .to_dataframe()  .to_xarray()  ['left'].pressure_pa")
    return "\n".join(lines)


def describe_foot(foot: FootRecording) -> str:
    """Describe one foot in two lines: its size and its arrays."""
    columns = "no reference" if foot.reference is None else f"reference: {', '.join(foot.reference.columns)}"
    calibrated = "no calibration, so no pressure" if foot.wrench is None else f"f_z to {_max_force_n(foot):.0f} N"
    lines = [f"{foot.foot} foot: {len(foot)} cycles, {len(foot.layout)} triangles, {calibrated}; {columns}"]
    arrays = ["t_ns", "counts", "valid", "pressure_pa", "wrench"]
    lines.append(f"  {', '.join(arrays if foot.wrench is not None else arrays[:3])}: one row per cycle")
    return "\n".join(lines)


def to_dataframe(recording: Recording) -> pd.DataFrame:
    """Return the DataFrame of all feet; see Recording.to_dataframe."""
    pandas = need("pandas", "pandas", "a DataFrame")
    frames = [foot_to_dataframe(foot) for foot in recording.feet]
    for foot, frame in zip(recording.feet, frames, strict=True):
        frame.insert(0, "foot", foot.foot)
    joined: pd.DataFrame = pandas.concat(frames).sort_index(kind="stable")
    return joined


def foot_to_dataframe(foot: FootRecording) -> pd.DataFrame:
    """Return the DataFrame of one foot; see FootRecording.to_dataframe."""
    pandas = need("pandas", "pandas", "a DataFrame")
    columns: dict[str, Any] = {"t_ns": foot.t_ns}
    if foot.wrench is not None:
        columns |= {name: getattr(foot.wrench, name) for name in type(foot.wrench).__slots__}
    else:
        columns["valid_fraction"] = foot.valid.sum(axis=(1, 2)) / (10 * len(foot.layout))
    columns |= {"late": foot.late, "repeated": foot.repeated}
    reference = foot.reference
    if reference is not None and reference.clock == "can" and reference.time_s is not None:
        t_s = foot.t_ns * 1e-9
        for name, values in reference.columns.items():
            known = np.isfinite(values)
            if not known.any():
                continue
            times = reference.time_s[known]
            nearest = np.abs(times[np.clip(np.searchsorted(times, t_s), 0, len(times) - 1)] - t_s)
            columns[f"reference_{name}"] = np.where(
                nearest <= _REFERENCE_LIMIT_S, np.interp(t_s, times, values[known]), np.nan
            )
    index = pandas.to_datetime(foot.t_ns, unit="ns", utc=True)
    frame: pd.DataFrame = pandas.DataFrame(columns, index=pandas.Index(index, name="time"))
    return frame


def foot_to_dataset(foot: FootRecording) -> xr.Dataset:
    """Return the Dataset of one foot; see FootRecording.to_xarray."""
    xarray = need("xarray", "xarray", "an xarray Dataset")
    by_taxel, by_triangle, by_cycle = ("cycle", "triangle", "taxel"), ("cycle", "triangle"), ("cycle",)
    variables: dict[str, Any] = {
        "counts": (by_taxel, foot.counts, {"units": "count"}),
        "valid": (by_taxel, foot.valid),
        "status": (by_triangle, foot.status),
        "age_ns": (by_triangle, foot.age_ns, {"units": "ns"}),
        "missing": (by_triangle, foot.missing),
        "late": (by_cycle, foot.late),
        "repeated": (by_cycle, foot.repeated),
    }
    if foot.pressure_pa is not None and foot.wrench is not None:
        variables["pressure_pa"] = (by_taxel, foot.pressure_pa, {"units": "Pa"})
        for name in type(foot.wrench).__slots__:
            variables[name] = (by_cycle, getattr(foot.wrench, name), {"units": _unit_of(name)})
    coordinates = {
        "time": (by_cycle, foot.t_ns.astype("datetime64[ns]")),
        "board": (("triangle",), foot.layout.identities[:, 0]),
        "triangle_of_board": (("triangle",), foot.layout.identities[:, 1]),
        "x_m": (("triangle", "taxel"), foot.layout.xy_m[..., 0], {"units": "m"}),
        "y_m": (("triangle", "taxel"), foot.layout.xy_m[..., 1], {"units": "m"}),
    }
    dataset: xr.Dataset = xarray.Dataset(variables, coordinates, {"foot": foot.foot})
    return dataset


def pressures_by_region(foot: FootRecording) -> dict[tuple[str, str], NDArray[np.float64]]:
    """Return `region_pressures` of a foot with a calibration, for the regions of the table of steps."""
    spans = load_regions()
    assert foot.pressure_pa is not None
    return region_pressures(
        foot.pressure_pa, foot.valid, map_regions(spans, foot.layout), [region.name for region in spans]
    )


def _unit_of(name: str) -> str:
    return {"n": "N", "nm": "N·m", "m": "m", "m2": "m²"}.get(name.rpartition("_")[2], "1")


def _max_force_n(foot: FootRecording) -> float:
    assert foot.wrench is not None
    known = foot.wrench.f_z_n[np.isfinite(foot.wrench.f_z_n)]
    return float(known.max()) if len(known) else 0.0
