"""The steps of a recording as a table: a row a stance, with its label, its figures and its curves over stance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InsoleError
from .contacts import Contacts
from .events import LONGEST_STRIDE_S
from .figures import PERCENT, FootCourse, Stances, no_stances, stances
from .labels import Walking, label_steps

if TYPE_CHECKING:
    import pandas as pd

TEXT_COLUMNS = ("foot", "label")

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Steps:
    """n stances of one foot or both, in order of contact. NaN: not known."""

    columns: Mapping[str, NDArray[Any]]  # (n,) each: foot, label, contact_s, toe_off_s, stance_s …, see docs/gait.md
    curves: Mapping[str, Array]  # (n, 101) each, at 0, 1 … 100 % of stance: f_z_n, f_z_std_n, cop_x_m, cop_y_m
    start_ns: int  # epoch time of 0 s
    remarks: tuple[str, ...]  # what is missing, and why
    calibrations: Mapping[str, str] = field(default_factory=dict)  # by foot: the same text, the same errors

    def __len__(self) -> int:
        """Return the number of stances."""
        return len(self.columns["foot"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return the column `name`, (n,)."""
        if name not in self.columns:
            raise KeyError(f"expected one of {', '.join(self.columns)}, found {name!r}")
        return self.columns[name]

    def __repr__(self) -> str:
        """Return five lines: counts by label, and mean ± SD of the steady steps."""
        labels, counts = np.unique(self["label"], return_counts=True)
        kinds = ", ".join(f"{count} {label}" for label, count in zip(labels, counts, strict=True)) or "none"
        lines = [f"Steps: {len(self)} stances ({kinds})"]
        for foot in ("left", "right"):
            steady = self.of(foot).steady
            figures = ", ".join(
                f"{word} {scale * np.nanmean(steady[name]):.{digits}f} ± "
                f"{scale * np.nanstd(steady[name], ddof=1):.{digits}f} {unit}"
                for word, name, scale, digits, unit in (
                    ("stance", "stance_s", 1, 3, "s"), ("peak", "peak_force_n", 1, 0, "N"),
                    ("impulse", "impulse_n_s", 1, 0, "N·s"), ("CoP path", "cop_path_m", 1e3, 0, "mm"),
                )
                if np.count_nonzero(np.isfinite(steady[name])) > 1
            )  # fmt: skip
            lines.append(f"  {foot}: {len(steady)} steady" + (f": {figures}" if figures else ""))
        lines.append(
            f"  {len(self.columns)} columns: {', '.join(list(self.columns)[:8])} …; curves: {', '.join(self.curves)}"
        )
        lines.append(f"  remarks: {'; '.join(self.remarks) or 'none'}")
        return "\n".join(lines)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Steps:
        """Return the stances of `rows`, a mask (n,) or row numbers."""
        columns = {name: column[rows] for name, column in self.columns.items()}
        return replace(self, columns=columns, curves={name: curve[rows] for name, curve in self.curves.items()})

    def of(self, foot: str) -> Steps:
        """Return the stances of the "left" or the "right" foot."""
        calibrations = {side: text for side, text in self.calibrations.items() if side == foot}
        return replace(self.select(self["foot"] == foot), calibrations=calibrations)

    @property
    def steady(self) -> Steps:
        """The steady steps: what means and comparisons are made of."""
        return self.select(self["label"] == "steady")

    @property
    def known_ns(self) -> NDArray[np.int64]:
        """Epoch time (n,) of toe-off, at which a stance is known; of contact where toe-off is not."""
        at_s = np.where(np.isnan(self["toe_off_s"]), self["contact_s"], self["toe_off_s"])
        return self.start_ns + np.rint(np.nan_to_num(at_s) * 1e9).astype(np.int64)

    @property
    def figure_names(self) -> tuple[str, ...]:
        """The columns that are figures of a step: no labels, no moments, no standard deviations."""
        others = {*TEXT_COLUMNS, "number", "contact_s", "toe_off_s"}
        return tuple(name for name in self.columns if name not in others and "_std_" not in name)

    def check_figure(self, figure: str) -> None:
        """Raise InsoleError where `figure` is none of figure_names."""
        if figure not in self.figure_names:
            raise InsoleError(f"expected a figure of steps ({', '.join(self.figure_names)}), found {figure!r}")

    def std(self, figure: str) -> Array:
        """Return the standard deviation (n,) of `figure` by the uncertainty of the wrench; NaN: not known."""
        for at, letter in enumerate(figure):
            column = self.columns.get(f"{figure[:at]}_std{figure[at:]}") if letter == "_" else None
            if column is not None:
                return column
        return np.full(len(self), np.nan)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the columns as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(
            {name: list(column) if name in TEXT_COLUMNS else column for name, column in self.columns.items()}
        )


def find_steps(
    courses: Sequence[FootCourse], start_ns: int, remarks: Sequence[str] = (), region_names: Sequence[str] = ()
) -> Steps:
    """Return the table of steps in `courses`, of one foot or both, whose t_s count from `start_ns` (epoch time).

    `remarks` are what the caller has to say of the recording; they come first in the table's. `region_names` name the
    regions of a table without courses, which has no row but all columns.
    """
    feet = [stances(course) for course in courses]
    columns, curves = _joined(feet or [no_stances(region_names)])
    order = np.argsort(_begin_s(columns), kind="stable")
    columns = {name: column[order] for name, column in columns.items()}
    curves = {name: curve[order] for name, curve in curves.items()}
    columns = _with_both_feet(columns, both=len(feet) == 2)
    columns["label"] = label_steps(_walking(columns))
    all_remarks = [*remarks]
    if len(feet) == 1:
        other = "right" if feet[0].foot == "left" else "left"
        all_remarks.append(f"without steps of the {other} foot: no double support, no step time, no symmetry")
    for foot in feet:
        if foot.memory is not None:
            all_remarks.append(
                f"{foot.foot}: the material remembers: {foot.memory.fraction:.0%} of a load comes late, with a time "
                f"constant of {foot.memory.tau_s:.2g} s, as its swings show; the steps are without that"
            )
    labels, counts = np.unique(columns["label"], return_counts=True)
    if len(labels) and "steady" not in labels:
        kinds = ", ".join(f"{count} {label}" for label, count in zip(labels, counts, strict=True))
        all_remarks.append(
            f"no steady step, so no mean, symmetry or comparison: {kinds}; the table has the figures of each stance"
        )
    for course in courses:
        if course.regions.too_small:
            all_remarks.append(f"{course.foot}: too few taxels for {', '.join(course.regions.too_small)}")
        if not np.any(columns["foot"] == course.foot):
            all_remarks.append(
                f"no step of the {course.foot} foot: its force never rises from rest and falls to it again"
            )
    columns = {name: columns[name] for name in ("foot", "number", "label", *columns)}
    hidden = {"first_s", "last_s"}
    return Steps(
        {name: column for name, column in columns.items() if name not in hidden},
        curves,
        start_ns,
        tuple(all_remarks),
        {course.foot: course.calibration for course in courses},
    )


def _joined(feet: Sequence[Stances]) -> tuple[dict[str, NDArray[Any]], dict[str, Array]]:
    """Return columns and curves of all feet, one foot after the other."""
    by_foot = []
    for foot in feet:
        contacts, n = foot.contacts, len(foot.contacts)
        stride_s, stride_std_s = _to_next(contacts.contact_s, contacts.contact_std_s, contacts.contact_s, contacts)
        swing_s, swing_std_s = _to_next(contacts.toe_off_s, contacts.toe_off_std_s, contacts.contact_s, contacts)
        by_foot.append({
            "foot": np.full(n, foot.foot, "<U5"),
            "number": np.arange(1, n + 1),
            "contact_s": contacts.contact_s,
            "contact_std_s": contacts.contact_std_s,
            "toe_off_s": contacts.toe_off_s,
            "toe_off_std_s": contacts.toe_off_std_s,
            "first_s": foot.first_s,
            "last_s": foot.last_s,
            "stance_s": contacts.toe_off_s - contacts.contact_s,
            "stance_std_s": np.hypot(contacts.contact_std_s, contacts.toe_off_std_s),
            "swing_s": swing_s,
            "swing_std_s": swing_std_s,
            "stride_s": stride_s,
            "stride_std_s": stride_std_s,
            "cadence_per_min": 120.0 / stride_s,
            "cadence_std_per_min": 120.0 / stride_s**2 * stride_std_s,
            **foot.columns,
        })  # fmt: skip
    columns: dict[str, NDArray[Any]] = {
        name: np.concatenate([of_foot[name] for of_foot in by_foot]) for name in by_foot[0]
    }
    curves = {name: np.concatenate([foot.curves[name] for foot in feet]) for name in feet[0].curves}
    return columns, curves


def _to_next(from_s: Array, from_std_s: Array, to_s: Array, contacts: Contacts) -> tuple[Array, Array]:
    """Return time in s from a moment of each stance to the contact of the next one, and its standard deviation.

    NaN where that is longer than a stride.
    """
    span_s, std_s = np.full_like(from_s, np.nan), np.full_like(from_s, np.nan)
    span_s[:-1] = to_s[1:] - from_s[:-1]
    std_s[:-1] = np.hypot(contacts.contact_std_s[1:], from_std_s[:-1])
    too_long = ~(span_s <= LONGEST_STRIDE_S)
    span_s[too_long] = std_s[too_long] = np.nan
    return span_s, std_s


def _begin_s(columns: Mapping[str, NDArray[Any]]) -> Array:
    return np.where(np.isnan(columns["contact_s"]), columns["first_s"], columns["contact_s"])


def _with_both_feet(columns: dict[str, NDArray[Any]], *, both: bool) -> dict[str, NDArray[Any]]:
    """Return `columns` with double support and step time after the stride; NaN where only one foot is recorded."""
    n = len(columns["foot"])
    double_s, double_std_s, step_s, step_std_s = np.full((4, n), np.nan)
    if both and n:
        left = columns["foot"] == "left"
        for this, other in ((left, ~left), (~left, left)):
            contact_s, toe_off_s = columns["contact_s"][this], columns["toe_off_s"][this]
            shared_s = np.minimum(toe_off_s[:, None], columns["toe_off_s"][other][None]) - np.maximum(
                contact_s[:, None], columns["contact_s"][other][None]
            )
            meets = shared_s > 0
            double_s[this] = np.where(meets, shared_s, 0.0).sum(axis=1)
            complete = np.count_nonzero(meets, axis=1) == 2  # with the step before and with the step after
            double_s[np.flatnonzero(this)[~complete]] = np.nan
            variance = columns["contact_std_s"][other] ** 2 + columns["toe_off_std_s"][other] ** 2
            this_variance = columns["contact_std_s"][this] ** 2 + columns["toe_off_std_s"][this] ** 2
            double_std_s[this] = np.sqrt(this_variance + np.where(meets, variance[None] / 2, 0.0).sum(axis=1))
            since_s = contact_s[:, None] - columns["contact_s"][other][None]
            last_s = np.where(since_s > 0, since_s, np.inf).min(axis=1, initial=np.inf)
            step_s[this] = np.where(last_s <= LONGEST_STRIDE_S, last_s, np.nan)
            last_std_s = np.where(since_s == last_s[:, None], columns["contact_std_s"][other], 0.0).sum(axis=1)
            step_std_s[this] = np.hypot(columns["contact_std_s"][this], last_std_s) + 0.0 * step_s[this]
    ordered: dict[str, NDArray[Any]] = {}
    for name, column in columns.items():
        ordered[name] = column
        if name == "cadence_std_per_min":
            ordered |= {
                "step_s": step_s,
                "step_std_s": step_std_s,
                "double_support_s": double_s,
                "double_support_std_s": double_std_s,
            }
    return ordered


def _walking(columns: Mapping[str, NDArray[Any]]) -> Walking:
    names = ("stance_s", "step_s", "peak_force_n", "impulse_n_s", "cop_mean_y_m")
    cut = np.isnan(columns["contact_s"]) | np.isnan(columns["toe_off_s"])
    end_s = np.where(np.isnan(columns["toe_off_s"]), columns["last_s"], columns["toe_off_s"])
    figures = {name: columns[name] for name in names}
    return Walking(columns["foot"] == "left", _begin_s(columns), end_s, cut, figures)


def mean_curve(curves: Array) -> tuple[Array, Array]:
    """Return mean and sample standard deviation, (101,), of `curves` (n, 101) over those known at each percent."""
    known = np.isfinite(curves)
    count = np.count_nonzero(known, axis=0)
    total = np.where(known, curves, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count
        spread = np.sqrt(np.where(known, (curves - mean) ** 2, 0.0).sum(axis=0) / (count - 1))
    spread[count < 2] = np.nan
    assert len(mean) == len(PERCENT)
    return mean, spread
