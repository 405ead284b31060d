"""Load a calibration (`insole-calibration/1`) or build the default one: the curve from count to pressure of every
taxel.

    P_i = Σ_k coefficients_pa[k] · (baseline_count − count)^k

A taxel that is not listed is unusable. `effects` are the physics beyond this static curve (`physics.effects`). A file
with an unknown effect is refused, because its coefficients are correct only together with that effect.

Extensions of a taxel, which readers may ignore: `coefficients_covariance_pa2: [[…], …]`, the covariance of its
coefficients; `valid_range: {activation_count: [0, highest]}`, the range in which its curve was fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from ..documents import Key, Reading, Section, at_least, entries, read, spell, within
from ..errors import CalibrationError, InsoleError
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS, THERMAL_PADS
from ..skin.layout import Layout
from . import effects_document
from .effect import Effect

FORMAT = "insole-calibration/1"
COVARIANCE = "coefficients_covariance_pa2"
VALID_RANGE = "valid_range"
_MAX_BASELINE_COUNT = (
    510.0  # a fitted baseline may exceed the 8-bit range, but not by much; also the highest activation
)
MAX_COEFFICIENTS = 32  # per taxel; the longest list determines the width of the arrays of all taxels
BEGAN = "began_t_ns"  # key in `provenance`: origin of the effects' times, ns of CLOCK_REALTIME

# Counts of the public insole recordings fall by about 12 per bar, from baselines near 240: 8 kPa per count.
DEFAULT_PA_PER_COUNT = 8000.0

Foot = Literal["left", "right"]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The static curve of every taxel of a layout, in the layout's order, with k coefficients each."""

    foot: Foot
    baseline_count: NDArray[np.float64]  # (n_triangles, 12) NaN: not listed
    coefficients_pa: NDArray[np.float64]  # (n_triangles, 12, k) powers 0 to k−1; NaN: not listed
    covariance_pa2: NDArray[np.float64] | None  # (n_triangles, 12, k, k) NaN: taxel without covariance
    usable: NDArray[np.bool_]  # (n_triangles, 12) listed; never a thermal pad
    provenance: Mapping[str, Any]
    effects: tuple[Effect, ...] = ()
    builtin: bool = False
    extensions: Mapping[str, Any] = field(default_factory=dict, repr=False)
    highest_count: NDArray[np.float64] | None = None  # (n_triangles, 12) highest fitted activation; inf: unknown

    @property
    def lowest_count(self) -> NDArray[np.uint8] | None:
        """Return (n_triangles, 12) the lowest count within the range of the fit, or None if the ranges are unknown."""
        if self.highest_count is None:
            return None
        lowest = np.ceil(np.nan_to_num(self.baseline_count) - self.highest_count)
        lowest_count: NDArray[np.uint8] = np.clip(lowest, 0, 255).astype(np.uint8)  # 0 where there is no limit
        return lowest_count


@dataclass(frozen=True, slots=True, kw_only=True)
class _Taxel(Section):
    board: Annotated[int, within(1, 14)]
    triangle: Annotated[int, within(0, 15)]
    taxel: Annotated[int, within(0, N_TAXELS - 1)]
    baseline_count: Annotated[float, within(0, _MAX_BASELINE_COUNT)]
    coefficients_pa: Annotated[tuple[float, ...], entries(1, MAX_COEFFICIENTS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _File(Section):
    foot: Foot
    taxels: Annotated[tuple[_Taxel, ...], at_least(1)]
    effects: tuple[Mapping[str, Any], ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)


def files_by_foot(paths: Sequence[Path]) -> dict[Foot, Path]:
    """Return the calibration files `paths` by foot; CalibrationError where one names no foot, or two the same."""
    by_foot: dict[Foot, Path] = {}
    for path in paths:
        document = Reading(path).document
        foot = document.get("foot") if isinstance(document, dict) else None
        if foot != "left" and foot != "right":
            raise CalibrationError(f"{path}: expected a calibration, {FORMAT}, with its foot, left or right")
        if foot in by_foot:
            raise CalibrationError(f"{path}: the {foot} foot has a calibration already, {by_foot[foot]}: leave one out")
        by_foot[foot] = path
    return by_foot


def load(path: str | PathLike[str], layout: Layout) -> Calibration:
    """Load the calibration in file `path` for the taxels of `layout`; DocumentError lists all problems."""
    effects: list[Effect] = []
    file = read(path, _File, FORMAT, _check(layout, effects))
    rows = layout.rows
    row = np.array([rows[entry.board, entry.triangle] for entry in file.taxels])
    column = np.array([entry.taxel for entry in file.taxels])
    lists = [entry.coefficients_pa for entry in file.taxels]
    k = max(map(len, lists))
    baseline = np.full((len(layout), N_TAXELS), np.nan)
    baseline[row, column] = [entry.baseline_count for entry in file.taxels]
    coefficients = np.full((len(layout), N_TAXELS, k), np.nan)
    coefficients[row, column] = [values + (0.0,) * (k - len(values)) for values in lists]
    covariance = None
    if any(COVARIANCE in entry.extensions for entry in file.taxels):
        covariance = np.full((len(layout), N_TAXELS, k, k), np.nan)
        for entry in file.taxels:
            if COVARIANCE in entry.extensions:
                n_coefficients = len(entry.coefficients_pa)
                matrix = np.zeros((k, k))
                matrix[:n_coefficients, :n_coefficients] = entry.extensions[COVARIANCE]
                covariance[rows[entry.board, entry.triangle], entry.taxel] = matrix
    highest = None
    if any(VALID_RANGE in entry.extensions for entry in file.taxels):
        highest = np.full((len(layout), N_TAXELS), np.inf)
        for entry in file.taxels:
            if VALID_RANGE in entry.extensions:
                highest[rows[entry.board, entry.triangle], entry.taxel] = entry.extensions[VALID_RANGE][
                    "activation_count"
                ][1]
    return _freeze(
        Calibration(
            foot=file.foot,
            baseline_count=baseline,
            coefficients_pa=coefficients,
            covariance_pa2=covariance,
            usable=~np.isnan(baseline),
            provenance=file.provenance,
            builtin=file.provenance.get("builtin") is True,
            effects=tuple(effects),
            extensions=file.extensions,
            highest_count=highest,
        )
    )


def valid_up_to(highest_count: float) -> dict[str, Any]:
    """Return the extensions of a taxel whose curve was fitted up to an activation: none if that is inf, unknown."""
    if not np.isfinite(highest_count):
        return {}
    return {VALID_RANGE: {"activation_count": [0.0, max(round(highest_count, 2), 0.0)]}}


def default(layout: Layout, boards: Sequence[Board]) -> Calibration:
    """Return the default calibration: the same straight line for every taxel, good enough for a first look only.

    The mean unloaded count is (1 − 2^−shift)/2 above the board's no-load value, because the firmware sends no_load −
    floor(value / 2^shift).
    """
    baseline_of_board = {board.address: board.no_load + (1 - 2.0**-board.shift) / 2 for board in boards}
    for address in layout.identities[:, 0].tolist():
        if address not in baseline_of_board:
            raise InsoleError(
                f"the layout has triangles on board {address}, expected only this insole's boards "
                f"({', '.join(map(str, sorted(baseline_of_board)))}): correct the layout, or configure the board"
            )
    usable = np.tile(PRESSURE_TAXELS, (len(layout), 1))
    baseline = np.array([baseline_of_board[address] for address in layout.identities[:, 0].tolist()])
    return _freeze(
        Calibration(
            foot=layout.foot,
            baseline_count=np.where(usable, baseline[:, None], np.nan),
            coefficients_pa=np.where(usable[..., None], (0.0, DEFAULT_PA_PER_COUNT), np.nan),
            covariance_pa2=None,
            usable=usable,
            provenance={
                "builtin": True,
                "source": f"built-in: {DEFAULT_PA_PER_COUNT:g} Pa per count for every taxel, not measured",
            },
            builtin=True,
        )
    )


def _freeze(calibration: Calibration) -> Calibration:
    for array in (calibration.baseline_count, calibration.coefficients_pa, calibration.usable,
                  calibration.covariance_pa2, calibration.highest_count):  # fmt: skip
        if array is not None:
            array.setflags(write=False)
    return calibration


def _check(layout: Layout, parsed_effects: list[Effect]) -> Callable[[Reading], None]:
    """Return a check across the whole file; it appends the file's effects to `parsed_effects`."""

    def check(reading: Reading) -> None:
        file_foot = reading.document.get("foot")
        if file_foot in ("left", "right") and file_foot != layout.foot:
            reading.problem(
                ("foot",),
                f"expected the calibration of the {layout.foot} foot, found that of the {file_foot} foot",
            )
        _check_taxels(reading, layout)
        effects = reading.document.get("effects")
        if isinstance(effects, list):
            parsed_effects.extend(effects_document.parse(reading, effects, layout))

    return check


def _check_taxels(reading: Reading, layout: Layout) -> None:
    """Report duplicate taxels, pads, unknown triangles, and invalid numbers."""
    rows = layout.rows
    boards = {board for board, _ in rows}
    first: dict[tuple[int, int, int], Key] = {}
    unknown_identities: set[str] = set()
    for key, entry in reading.of(_Taxel):
        identity = (entry.board, entry.triangle, entry.taxel)
        if entry.taxel in THERMAL_PADS:
            reading.problem((*key, "taxel"), f"taxel {entry.taxel} is a thermal pad: it has no pressure, leave it out")
        if identity in first:
            where = spell(first[identity])
            reading.problem(
                key,
                f"taxel {entry.taxel} of triangle {entry.triangle} of board {entry.board} is listed twice, "
                f"first in {where}",
            )
        first.setdefault(identity, key)
        identity_text = (
            f"triangle {entry.triangle} of board {entry.board}" if entry.board in boards else f"board {entry.board}"
        )
        if identity[:2] not in rows and identity_text not in unknown_identities:
            unknown_identities.add(identity_text)  # report each one once
            reading.problem(key, f"{identity_text} is not in the layout: is this the calibration of another insole?")
        if not _is_within_max_pa(entry.coefficients_pa):
            reading.problem(
                (*key, "coefficients_pa"),
                f"expected a pressure below {_MAX_PA:g} Pa at every count, found coefficients that give more",
            )
        if COVARIANCE in entry.extensions:
            problem = _covariance_problem(entry.extensions[COVARIANCE], len(entry.coefficients_pa))
            if problem:
                reading.problem((*key, "extensions", COVARIANCE), problem)
        if VALID_RANGE in entry.extensions and not _is_range(entry.extensions[VALID_RANGE]):
            reading.problem(
                (*key, "extensions", VALID_RANGE),
                "expected {activation_count: [lowest, highest]}, two numbers that ascend",
            )


_MAX_COUNT = 1e6  # far above any count
_MAX_PA = 1e30  # low enough that sums and squares stay finite


def _is_within_max_pa(coefficients_pa: Sequence[float]) -> bool:
    """Return whether the pressure stays below _MAX_PA at every possible count."""
    return sum(abs(value) * _MAX_BASELINE_COUNT**k for k, value in enumerate(coefficients_pa)) <= _MAX_PA


def _is_range(value: Any) -> bool:
    limits = value.get("activation_count") if isinstance(value, Mapping) else None
    return (
        isinstance(limits, list)
        and len(limits) == 2
        and all(type(limit) in (int, float) and abs(limit) <= _MAX_COUNT for limit in limits)
        and limits[0] <= limits[1]
    )


def _covariance_problem(matrix: Any, k: int) -> str | None:
    """Return what is wrong with a covariance of k coefficients, or None."""
    try:
        values = np.array(matrix, float)
    except (TypeError, ValueError, OverflowError):
        return f"expected {k} rows of {k} numbers"
    if values.shape != (k, k):
        return f"expected {k} rows of {k} numbers, found the shape {values.shape}"
    if not np.isfinite(values).all():
        return "expected finite numbers, found nan or inf"
    scale = np.sqrt(np.abs(np.diag(values)))
    if not _is_within_max_pa(scale.tolist()):
        return f"expected standard deviations below {_MAX_PA:g} Pa at every count, found a covariance that gives more"
    unit = values / np.outer(np.where(scale > 0, scale, 1.0), np.where(scale > 0, scale, 1.0))
    if not np.allclose(unit, unit.T, atol=1e-6):
        return "expected a symmetric matrix, found one that is not"
    if np.linalg.eigvalsh(unit).min() < -1e-6:
        return "expected a covariance, found a matrix with a negative eigenvalue"
    return None
