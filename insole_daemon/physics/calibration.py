"""Counts into pressure, taxel by taxel: `insole-calibration/1`, or the built-in default.

    P_i = Σ_k coefficients_pa[k] · (baseline_count − count)^k

A taxel that is not listed is unusable. `effects` are the physics beyond this static curve (`physics.effects`); a file
with one that is not known is refused, since its coefficients are only right together with it.

Documented extensions of a taxel; a reader that does not know them loses nothing else:
`coefficients_covariance_pa2: [[…], …]`, the covariance of its coefficients, with a row and a column for each;
`valid_range: {activation_count: [0, highest]}`, where its curve was seen when it was fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from ..documents import Key, Reading, Section, at_least, entries, read, spell, within
from ..errors import InsoleError
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS, THERMAL_PADS
from ..skin.layout import Layout
from . import effects_document
from .effect import Effect

FORMAT = "insole-calibration/1"
COVARIANCE = "coefficients_covariance_pa2"
VALID_RANGE = "valid_range"
_MOST_BASELINE_COUNT = 510.0  # a fit may leave the 8-bit range, but not by much; the activation at a count of 0
MOST_COEFFICIENTS = 32  # of a taxel: the arrays of all taxels are as wide as the longest
BEGAN = "began_t_ns"  # in `provenance`: from when the times of effects count, ns of CLOCK_REALTIME

# The public insole recordings lose about 12 counts a bar, with baselines near 240: 8 kPa a count.
DEFAULT_PA_PER_COUNT = 8000.0

Foot = Literal["left", "right"]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The static curve of every taxel of a layout, in the layout's order; k coefficients a taxel."""

    foot: Foot
    baseline_count: NDArray[np.float64]  # (n_triangles, 12) NaN where no taxel is listed
    coefficients_pa: NDArray[np.float64]  # (n_triangles, 12, k) of the powers 0 to k−1; NaN as above
    covariance_pa2: NDArray[np.float64] | None  # (n_triangles, 12, k, k) NaN where a taxel has none
    usable: NDArray[np.bool_]  # (n_triangles, 12) listed; never a thermal pad
    provenance: Mapping[str, Any]
    effects: tuple[Effect, ...] = ()
    builtin: bool = False
    extensions: Mapping[str, Any] = field(default_factory=dict, repr=False)
    highest_count: NDArray[np.float64] | None = None  # (n_triangles, 12) activation seen in the fit; inf: not known

    @property
    def lowest_count(self) -> NDArray[np.uint8] | None:
        """(n_triangles, 12) a count below that is beyond what the curve was fitted to; None where nobody said."""
        if self.highest_count is None:
            return None
        lowest = np.ceil(np.nan_to_num(self.baseline_count) - self.highest_count)
        below: NDArray[np.uint8] = np.clip(lowest, 0, 255).astype(np.uint8)  # no limit: 0, below which nothing is
        return below


@dataclass(frozen=True, slots=True, kw_only=True)
class _Taxel(Section):
    board: Annotated[int, within(1, 14)]
    triangle: Annotated[int, within(0, 15)]
    taxel: Annotated[int, within(0, N_TAXELS - 1)]
    baseline_count: Annotated[float, within(0, _MOST_BASELINE_COUNT)]
    coefficients_pa: Annotated[tuple[float, ...], entries(1, MOST_COEFFICIENTS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _File(Section):
    foot: Foot
    taxels: Annotated[tuple[_Taxel, ...], at_least(1)]
    effects: tuple[Mapping[str, Any], ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)


def load(path: str | PathLike[str], layout: Layout) -> Calibration:
    """The calibration in file `path` for the taxels of `layout`; DocumentError lists all that is wrong."""
    effects: list[Effect] = []
    file = read(path, _File, FORMAT, _check(layout, effects))
    rows = layout.rows
    row = np.array([rows[t.board, t.triangle] for t in file.taxels])
    column = np.array([t.taxel for t in file.taxels])
    lists = [t.coefficients_pa for t in file.taxels]
    k = max(map(len, lists))
    baseline = np.full((len(layout), N_TAXELS), np.nan)
    baseline[row, column] = [t.baseline_count for t in file.taxels]
    coefficients = np.full((len(layout), N_TAXELS, k), np.nan)
    coefficients[row, column] = [values + (0.0,) * (k - len(values)) for values in lists]
    covariance = None
    if any(COVARIANCE in t.extensions for t in file.taxels):
        covariance = np.full((len(layout), N_TAXELS, k, k), np.nan)
        for t in file.taxels:
            if COVARIANCE in t.extensions:
                own = len(t.coefficients_pa)
                matrix = np.zeros((k, k))
                matrix[:own, :own] = t.extensions[COVARIANCE]
                covariance[rows[t.board, t.triangle], t.taxel] = matrix
    highest = None
    if any(VALID_RANGE in t.extensions for t in file.taxels):
        highest = np.full((len(layout), N_TAXELS), np.inf)
        for t in file.taxels:
            if VALID_RANGE in t.extensions:
                highest[rows[t.board, t.triangle], t.taxel] = t.extensions[VALID_RANGE]["activation_count"][1]
    return _frozen(
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


def default(layout: Layout, boards: Sequence[Board]) -> Calibration:
    """The same straight line for every taxel, from what its board rests at: good for a first look only.

    That is (1 − 2^−shift)/2 above the no-load on average: the firmware sends no_load − floor(value / 2^shift).
    """
    rest = {board.address: board.no_load + (1 - 2.0**-board.shift) / 2 for board in boards}
    for address in layout.identities[:, 0].tolist():
        if address not in rest:
            raise InsoleError(
                f"the layout has triangles on board {address}, expected only this insole's boards "
                f"({', '.join(map(str, sorted(rest)))}): correct the layout, or configure the board"
            )
    usable = np.tile(PRESSURE_TAXELS, (len(layout), 1))
    baseline = np.array([rest[address] for address in layout.identities[:, 0].tolist()])
    return _frozen(
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


def _frozen(calibration: Calibration) -> Calibration:
    for array in (calibration.baseline_count, calibration.coefficients_pa, calibration.usable,
                  calibration.covariance_pa2, calibration.highest_count):  # fmt: skip
        if array is not None:
            array.setflags(write=False)
    return calibration


def _check(layout: Layout, found_effects: list[Effect]) -> Callable[[Reading], None]:
    """What looks across the file; the effects it has are added to `found_effects`."""

    def check(reading: Reading) -> None:
        found = reading.document.get("foot")
        if found in ("left", "right") and found != layout.foot:
            reading.problem(
                ("foot",),
                f"expected the calibration of the {layout.foot} foot, found that of the {found} foot",
            )
        _check_taxels(reading, layout)
        effects = reading.document.get("effects")
        if isinstance(effects, list):
            found_effects.extend(effects_document.parse(reading, effects, layout))

    return check


def _check_taxels(reading: Reading, layout: Layout) -> None:
    rows = layout.rows
    boards = {board for board, _ in rows}
    first: dict[tuple[int, int, int], Key] = {}
    strangers: set[str] = set()
    for key, t in reading.of(_Taxel):
        identity = (t.board, t.triangle, t.taxel)
        if t.taxel in THERMAL_PADS:
            reading.problem((*key, "taxel"), f"taxel {t.taxel} is a thermal pad: it has no pressure, leave it out")
        if identity in first:
            where = spell(first[identity])
            reading.problem(
                key,
                f"taxel {t.taxel} of triangle {t.triangle} of board {t.board} stands twice, first in {where}",
            )
        first.setdefault(identity, key)
        who = f"triangle {t.triangle} of board {t.board}" if t.board in boards else f"board {t.board}"
        if identity[:2] not in rows and who not in strangers:
            strangers.add(who)  # once is enough
            reading.problem(key, f"{who} is not in the layout: is this the calibration of another insole?")
        if not _at_most_pa(t.coefficients_pa):
            reading.problem(
                (*key, "coefficients_pa"),
                f"expected a pressure below {_MOST_PA:g} Pa at every count, found coefficients that give more",
            )
        if COVARIANCE in t.extensions:
            wrong = _wrong_covariance(t.extensions[COVARIANCE], len(t.coefficients_pa))
            if wrong:
                reading.problem((*key, "extensions", COVARIANCE), wrong)
        if VALID_RANGE in t.extensions and not _is_range(t.extensions[VALID_RANGE]):
            reading.problem(
                (*key, "extensions", VALID_RANGE),
                "expected {activation_count: [lowest, highest]}, two numbers that ascend",
            )


_MOST_COUNT = 1e6  # far beyond what any board says
_MOST_PA = 1e30  # sums and squares of which are still numbers


def _at_most_pa(coefficients_pa: Sequence[float]) -> bool:
    """Whether the pressure is a number that can be gone on with, whatever the count is."""
    return sum(abs(value) * _MOST_BASELINE_COUNT**k for k, value in enumerate(coefficients_pa)) <= _MOST_PA


def _is_range(value: Any) -> bool:
    limits = value.get("activation_count") if isinstance(value, Mapping) else None
    return (
        isinstance(limits, list)
        and len(limits) == 2
        and all(type(each) in (int, float) and abs(each) <= _MOST_COUNT for each in limits)
        and limits[0] <= limits[1]
    )


def _wrong_covariance(matrix: Any, k: int) -> str | None:
    """What is wrong with a covariance of k coefficients, None if nothing is."""
    try:
        values = np.array(matrix, float)
    except (TypeError, ValueError, OverflowError):
        return f"expected {k} rows of {k} numbers"
    if values.shape != (k, k):
        return f"expected {k} rows of {k} numbers, found the shape {values.shape}"
    if not np.isfinite(values).all():
        return "expected finite numbers, found nan or inf"
    scale = np.sqrt(np.abs(np.diag(values)))
    if not _at_most_pa(scale.tolist()):
        return f"expected standard deviations below {_MOST_PA:g} Pa at every count, found a covariance that gives more"
    unit = values / np.outer(np.where(scale > 0, scale, 1.0), np.where(scale > 0, scale, 1.0))
    if not np.allclose(unit, unit.T, atol=1e-6):
        return "expected a symmetric matrix, found one that is not"
    if np.linalg.eigvalsh(unit).min() < -1e-6:
        return "expected a covariance, found a matrix with a negative eigenvalue"
    return None
