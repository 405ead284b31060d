"""A loaded recording in the forms that Python programs like: steps, a DataFrame, an xarray Dataset, a few words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .lab import need

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from ..mechanics.gait.steps import Steps
    from .loading import FootRecording, Recording

_REFERENCE_LIMIT_S = 0.1  # a reading farther from a cycle is not its own


def steps_of_recording(recording: Recording) -> Steps:
    """See Recording.steps."""
    from .steps import step_table

    return step_table(recording.feet)


def describe(recording: Recording) -> str:
    """What the recording is, each foot in a line, and how many remarks there are."""
    seconds = max((float(foot.t_ns[-1] - foot.t_ns[0]) * 1e-9 for foot in recording.feet if len(foot)), default=0.0)
    lines = [f"Recording {recording.folder}: {recording.kind}, {recording.can_origin}, {seconds:.1f} s"]
    lines += [f"  {describe_foot(foot).splitlines()[0]}" for foot in recording.feet]
    lines.append(f"  {len(recording.warnings)} warnings, {len(recording.invented)} things that nobody measured")
    lines.append("  .steps  .to_dataframe()  .to_xarray()  ['left'].pressure_pa")
    return "\n".join(lines)


def describe_foot(foot: FootRecording) -> str:
    """How much there is of one foot, and of what."""
    columns = "no reference" if foot.reference is None else f"reference: {', '.join(foot.reference.columns)}"
    calibrated = "no calibration, so no pressure" if foot.wrench is None else f"f_z to {_highest_n(foot):.0f} N"
    lines = [f"{foot.foot} foot: {len(foot)} cycles, {len(foot.layout)} triangles, {calibrated}; {columns}"]
    arrays = ["t_ns", "counts", "valid", "pressure_pa", "wrench"]
    lines.append(f"  {', '.join(arrays if foot.wrench is not None else arrays[:3])}: one row a cycle")
    return "\n".join(lines)


def dataframe(recording: Recording) -> pd.DataFrame:
    """See Recording.to_dataframe."""
    pandas = need("pandas", "pandas", "a DataFrame")
    parts = [foot_dataframe(foot) for foot in recording.feet]
    for foot, part in zip(recording.feet, parts, strict=True):
        part.insert(0, "foot", foot.foot)
    joined: pd.DataFrame = pandas.concat(parts).sort_index(kind="stable")
    return joined


def foot_dataframe(foot: FootRecording) -> pd.DataFrame:
    """See FootRecording.to_dataframe."""
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


def foot_dataset(foot: FootRecording) -> xr.Dataset:
    """See FootRecording.to_xarray."""
    xarray = need("xarray", "xarray", "an xarray Dataset")
    whole, flat, single = ("cycle", "triangle", "taxel"), ("cycle", "triangle"), ("cycle",)
    variables: dict[str, Any] = {
        "counts": (whole, foot.counts, {"units": "count"}),
        "valid": (whole, foot.valid),
        "status": (flat, foot.status),
        "age_ns": (flat, foot.age_ns, {"units": "ns"}),
        "missing": (flat, foot.missing),
        "late": (single, foot.late),
        "repeated": (single, foot.repeated),
    }
    if foot.pressure_pa is not None and foot.wrench is not None:
        variables["pressure_pa"] = (whole, foot.pressure_pa, {"units": "Pa"})
        for name in type(foot.wrench).__slots__:
            variables[name] = (single, getattr(foot.wrench, name), {"units": _unit(name)})
    coordinates = {
        "time": (single, foot.t_ns.astype("datetime64[ns]")),
        "board": (("triangle",), foot.layout.identities[:, 0]),
        "triangle_of_board": (("triangle",), foot.layout.identities[:, 1]),
        "x_m": (("triangle", "taxel"), foot.layout.xy_m[..., 0], {"units": "m"}),
        "y_m": (("triangle", "taxel"), foot.layout.xy_m[..., 1], {"units": "m"}),
    }
    dataset: xr.Dataset = xarray.Dataset(variables, coordinates, {"foot": foot.foot})
    return dataset


def _unit(name: str) -> str:
    return {"n": "N", "nm": "N·m", "m": "m", "m2": "m²"}.get(name.rpartition("_")[2], "1")


def _highest_n(foot: FootRecording) -> float:
    assert foot.wrench is not None
    known = foot.wrench.f_z_n[np.isfinite(foot.wrench.f_z_n)]
    return float(known.max()) if len(known) else 0.0
