"""The figures of every stance of one foot: times, forces, CoP, and pressure by region.

Standard deviations carry the uncertainty of the wrench, which is that of the calibration and of missing taxels. It is
the same calibration in every cycle, so the errors of one step are taken as fully correlated: integrals add standard
deviations, not variances, and a mean over steps does not shrink them. NaN: the calibration carries no uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...skin.layout import Foot
from ..region_map import RegionMap
from ..wrench import WrenchSeries
from .contacts import Contacts, find_contacts
from .material_memory import MaterialMemory, estimate_memory
from .swing_offset import swing_offset, swing_samples

PERCENT: NDArray[np.float64] = np.linspace(0.0, 100.0, 101)  # of stance
COP_FRACTION = 0.1  # of the peak force: where less is borne, the CoP is mostly noise
COP_FIGURES = ("cop_path_m", "cop_path_std_m", "cop_width_m", "cop_width_std_m", "cop_mean_y_m", "cop_mean_y_std_m")
CURVES = ("f_z_n", "f_z_std_n", "cop_x_m", "cop_y_m")
OF_REGION = ("peak_pa", "peak_std_pa", "integral_pa_s", "integral_std_pa_s", "area_m2", "area_std_m2")
RATE_FROM, RATE_TO = 0.2, 0.8  # of the first peak's force
FIRST_PEAK_WITHIN = 0.5  # of stance

Array = NDArray[np.float64]
Variance = Callable[[slice], Array | None]


@dataclass(frozen=True, slots=True, eq=False)
class FootCourse:
    """The measured load of one foot: n cycles in order of time."""

    foot: Foot
    t_s: Array  # (n,) moment of the load, not of the message; increasing
    wrench: WrenchSeries
    pressure_pa: NDArray[np.float32]  # (n, n_triangles, 12)
    valid: NDArray[np.bool_]  # (n, n_triangles, 12)
    variance_pa2: Variance  # (k, n_triangles, 12) of the cycles in the slice; None: not known
    regions: RegionMap
    taxel_area_m2: float
    min_pressure_pa: float  # a taxel is in contact from here
    calibration: str  # which one made the pressure of the counts: the same text, the same errors


@dataclass(frozen=True, slots=True, eq=False)
class Stances:
    """The n stances of one foot."""

    foot: Foot
    memory: MaterialMemory | None  # of the material, that was undone
    contacts: Contacts
    first_s: Array  # (n,) of the first and the last cycle of each
    last_s: Array
    columns: dict[str, Array]  # (n,) each
    curves: dict[str, Array]  # (n, 101) each, at PERCENT of stance


def stances(course: FootCourse) -> Stances:
    """Return contacts, figures and curves of every stance in `course`.

    The memory of the material that the swings show is undone first; the wrench is above that of the swings around.
    """
    wrench, t_s = course.wrench, course.t_s
    loads = np.stack([wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm])
    swings = swing_samples(t_s, find_contacts(t_s, loads[0]))
    in_swing = np.zeros(len(t_s), np.bool_)
    in_swing[np.concatenate([*swings, np.empty(0, np.intp)])] = True
    memory = estimate_memory(t_s, loads[0], in_swing)
    if memory is not None:
        loads = memory.undo(t_s, loads.T).T
        course = replace(course, pressure_pa=memory.undo(t_s, course.pressure_pa))
    offset = swing_offset(t_s, loads, swings)
    contacts = find_contacts(t_s, loads[0], wrench.f_z_std_n, offset[0])
    rows = [_stance(course, loads - offset, contacts, number) for number in range(len(contacts))]
    names = _figure_names(course.regions.names)
    columns = {name: np.array([figures[name] for figures, _ in rows], np.float64) for name in names}
    curves = {
        name: np.array([curve[name] for _, curve in rows], np.float64).reshape(-1, len(PERCENT)) for name in CURVES
    }
    return Stances(course.foot, memory, contacts, t_s[contacts.first], t_s[contacts.last], columns, curves)


def no_stances(region_names: Sequence[str]) -> Stances:
    """Return the stances of a recording without force: none, with all columns and curves."""
    nothing, no_rows = np.empty(0), np.empty(0, np.intp)
    contacts = Contacts(nothing, nothing, nothing, nothing, no_rows, no_rows)
    columns = dict.fromkeys(_figure_names(region_names), nothing)
    return Stances(
        "left", None, contacts, nothing, nothing, columns, dict.fromkeys(CURVES, np.empty((0, len(PERCENT))))
    )


def _figure_names(region_names: Sequence[str]) -> list[str]:
    """Return the columns of one foot, in the order of the table."""
    names = [
        *("peak_force_n", "peak_force_std_n", "impulse_n_s", "impulse_std_n_s", "loading_rate_n_s"),
        *("loading_rate_std_n_s", *COP_FIGURES, "contact_area_m2", "contact_area_std_m2", "valid_fraction"),
    ]
    for region in region_names:
        names += [f"{region}_{figure}" for figure in OF_REGION]
    return names


def _stance(
    course: FootCourse, loads: Array, contacts: Contacts, number: int
) -> tuple[dict[str, float], dict[str, Array]]:
    """Return figures and curves of stance `number`.

    `loads` (3, n) are f_z in N, m_x and m_y in N·m, less the offset in swing.
    """
    rows = slice(int(contacts.first[number]), int(contacts.last[number]) + 1)
    wrench, t_s = course.wrench, course.t_s[rows]
    # The ends of a stance that began before the recording or goes on after it are its first and last cycle.
    begin_s = float(np.nan_to_num(contacts.contact_s[number], nan=t_s[0]))
    end_s = float(np.nan_to_num(contacts.toe_off_s[number], nan=t_s[-1]))
    inside = (t_s > begin_s) & (t_s < end_s)
    whole_s = np.concatenate([[begin_s], t_s[inside], [end_s]])
    whole = np.pad(loads[:, rows][:, inside], ((0, 0), (1, 1)))
    stds = np.stack([wrench.f_z_std_n, wrench.m_x_std_nm, wrench.m_y_std_nm])[:, rows][:, inside]
    whole_std = np.pad(stds, ((0, 0), (1, 1)), mode="edge") if inside.any() else np.full((3, 2), np.nan)
    force, force_std = whole[0], whole_std[0]
    peak = int(np.nanargmax(force))
    rate, rate_std = _loading_rate(whole_s, force, force_std)
    at_s = begin_s + PERCENT / 100.0 * (end_s - begin_s)
    at_percent, std_at_percent, smooth = (
        np.stack([np.interp(at_s, whole_s, column) for column in columns])
        for columns in (whole, whole_std, _smooth(whole))
    )
    borne = at_percent[0] >= COP_FRACTION * force[peak]
    bearing = np.where(borne, smooth[0], np.nan)
    cop = np.stack([-smooth[2] / bearing, smooth[1] / bearing])
    cop_std = np.hypot(std_at_percent[[2, 1]], cop * std_at_percent[0]) / bearing
    figures = {
        "peak_force_n": float(force[peak]),
        "peak_force_std_n": float(force_std[peak]),
        "impulse_n_s": _integral(force, whole_s),
        "impulse_std_n_s": _integral(force_std, whole_s),
        "loading_rate_n_s": rate,
        "loading_rate_std_n_s": rate_std,
        **_cop_figures(cop, cop_std, at_percent[0]),
        **_pressure_figures(course, rows),
        "valid_fraction": float(wrench.valid_fraction[rows].min()),
    }
    curves = {"f_z_n": at_percent[0], "f_z_std_n": std_at_percent[0], "cop_x_m": cop[0], "cop_y_m": cop[1]}
    return figures, curves


def _loading_rate(t_s: Array, force: Array, std: Array) -> tuple[float, float]:
    """Return the mean slope in N/s from 20 % to 80 % of the first peak's force, and its standard deviation."""
    early = t_s - t_s[0] <= FIRST_PEAK_WITHIN * (t_s[-1] - t_s[0])
    peak = int(np.nanargmax(np.where(early, force, -np.inf)))
    first_s, last_s = (_first_crossing_s(t_s, force, fraction * force[peak]) for fraction in (RATE_FROM, RATE_TO))
    run_s = last_s - first_s
    if not run_s > 0:
        return np.nan, np.nan
    change_std = abs(float(np.interp(last_s, t_s, std)) - float(np.interp(first_s, t_s, std)))
    return float((RATE_TO - RATE_FROM) * force[peak] / run_s), change_std / run_s


def _first_crossing_s(t_s: Array, force: Array, level: float) -> float:
    above = int(np.argmax(force >= level))
    if above == 0:
        return float(t_s[0])
    part = (level - force[above - 1]) / (force[above] - force[above - 1])
    return float(t_s[above - 1] + part * (t_s[above] - t_s[above - 1]))


def _cop_figures(cop: Array, cop_std: Array, force: Array) -> dict[str, float]:
    """Return path length, width and mean y of the CoP in m.

    `cop` and `cop_std` (2, 101) in m are NaN where too little is borne; `force` (101,) weighs the mean.
    """
    known = np.flatnonzero(np.isfinite(cop).all(axis=0))
    if len(known) < 2:
        return dict.fromkeys(COP_FIGURES, np.nan)
    (x, y), (x_std, y_std) = cop[:, known], cop_std[:, known]
    ends = [0, -1]
    widest, narrowest = int(y.argmax()), int(y.argmin())
    return {
        "cop_path_m": float(np.hypot(np.diff(x), np.diff(y)).sum()),
        "cop_path_std_m": float(np.sqrt((x_std[ends] ** 2 + y_std[ends] ** 2).sum())),
        "cop_width_m": float(y[widest] - y[narrowest]),
        "cop_width_std_m": float(np.hypot(y_std[widest], y_std[narrowest])),
        "cop_mean_y_m": float(np.average(y, weights=force[known])),
        "cop_mean_y_std_m": float(np.average(y_std, weights=force[known])),
    }


def _pressure_figures(course: FootCourse, rows: slice) -> dict[str, float]:
    """Return the contact area of the sole and, by region, peak pressure, pressure–time integral and contact area."""
    t_s, area = course.t_s[rows], course.taxel_area_m2
    pressure = np.where(course.valid[rows], course.pressure_pa[rows], 0.0)
    variance = course.variance_pa2(rows)
    std = np.full(pressure.shape, np.nan) if variance is None else np.sqrt(np.maximum(variance, 0.0))
    touched = pressure >= course.min_pressure_pa
    doubtful = np.abs(pressure - course.min_pressure_pa) <= std
    in_contact = touched.reshape(len(t_s), -1).sum(axis=1)
    widest = int(in_contact.argmax())
    unknown = np.nan if variance is None else 1.0
    none_valid = np.nan if not course.valid[rows].any() else 1.0
    figures = {
        "contact_area_m2": float(none_valid * in_contact[widest] * area),
        "contact_area_std_m2": float(unknown * np.count_nonzero(doubtful[widest]) * area / 2),
    }
    for number, name in enumerate(course.regions.names):
        inside = course.regions.of_taxel == number
        if not (inside & course.valid[rows].any(axis=0)).any():
            figures |= dict.fromkeys((f"{name}_{figure}" for figure in OF_REGION), np.nan)
            continue
        of_region, of_region_std = pressure[:, inside], std[:, inside]
        cycles, most_loaded = np.arange(len(t_s)), of_region.argmax(axis=1)
        highest, highest_std = of_region[cycles, most_loaded], of_region_std[cycles, most_loaded]
        peak = int(highest.argmax())
        ever, maybe = touched[:, inside].any(axis=0), (touched | doubtful)[:, inside].any(axis=0)
        surely = (touched & ~doubtful)[:, inside].any(axis=0)
        figures |= {
            f"{name}_peak_pa": float(highest[peak]),
            f"{name}_peak_std_pa": float(highest_std[peak]),
            f"{name}_integral_pa_s": _integral(highest, t_s),
            f"{name}_integral_std_pa_s": _integral(highest_std, t_s),
            f"{name}_area_m2": float(np.count_nonzero(ever) * area),
            f"{name}_area_std_m2": float(unknown * (np.count_nonzero(maybe) - np.count_nonzero(surely)) * area / 2),
        }
    return figures


def _smooth(loads: Array) -> Array:
    """Return weighted means of three cycles, (k, n): noise makes the path of a CoP longer at every cycle."""
    smooth = loads.copy()
    smooth[:, 1:-1] = (loads[:, :-2] + 2 * loads[:, 1:-1] + loads[:, 2:]) / 4
    return smooth


def _integral(values: Array, t_s: Array) -> float:
    """Return the integral of `values` (n,) over `t_s` (n,), by the trapezoidal rule."""
    return float(np.sum(np.diff(t_s) * (values[1:] + values[:-1]) / 2))
