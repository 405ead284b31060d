"""Measure a zero: mean and noise of every taxel over some seconds without load, or a refusal.

The limits come from the public recordings of this insole (Belli et al. 2023), quiet 3 s windows of three of its
recordings with the chamber open, and from the emulated person:

    activation (baseline − mean) of a triangle's median taxel, unloaded   −2.1 … 5.9 counts, including a common
                                                                          shift of up to 5.4 between sessions
    … above the level of the foot's quieter quarter, unloaded             at most 2.7, and once 5.8 on one triangle
    … the same, 63 kg standing on both feet (emulated)                    more than 5 on 7 of 28 triangles, up to 9.6
    … the same, 40 kg                                                     more than 5 on 4 of 28 triangles, up to 6.1
    standard deviation of a taxel                                         0.95 to 1.0 median; 5 % of them beyond 5
    standard deviation of a taxel, walking (emulated)                     up to 10 and more

So a load is recognised by its pattern, not by its level: a level common to all taxels is drift, which a zero is meant
to remove. One count is about 8 kPa. A strapped shoe that presses evenly (1 to 3 counts for 10 to 20 kPa) is far below
the limits and becomes part of the zero; a shoe that presses two triangles with more than 40 kPa is refused unless
forced. The paper masked up to 30 counts for a strapped shoe, on one taxel and at another gain; therefore a single taxel
never decides.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..skin.cycles import Cycles
from ..skin.geometry import PRESSURE_TAXELS
from ..skin.layout import Layout
from ..skin.validity import Validity
from .calibration import Calibration
from .zero import Zero

LOADED_COUNT = 5.0  # a triangle this far above the foot's quieter quarter is loaded, if another one is too
LOADED_ALONE_COUNT = 10.0  # … and this far, even if alone; or the foot, if the quieter quarter is above it
NOISY_COUNT = 3.0  # standard deviation of a triangle's median taxel: three times the noise at rest
MIN_READINGS = 15  # per triangle; the mean is then accurate to a quarter of a count
_MIN_VALID_SHARE = 0.9  # least fraction of valid readings of a taxel in the zero
_MIN_TAXEL_SHARE = 0.5  # least fraction of usable taxels with readings

Taxel = tuple[int, int, int]  # board, triangle, taxel


@dataclass(frozen=True, slots=True)
class ZeroOutcome:
    """Result of a measurement: a zero or the reasons of its refusal, and every irregular taxel."""

    zero: Zero | None
    refusals: tuple[str, ...]  # sentences; if there is a zero nevertheless, it was forced
    loaded: tuple[Taxel, ...]
    noisy: tuple[Taxel, ...]  # part of the zero, which states their noise
    left_out: dict[str, list[Taxel]] = field(default_factory=dict)  # by reason; these keep their baseline
    shift_count: float | None = None  # mean change of the baseline over the taxels of the zero
    largest_shift_count: float | None = None
    noise_count: float | None = None  # median over the taxels of the zero


class Zeroing:
    """Collects the readings of one foot; a repeated reading counts once."""

    def __init__(self, layout: Layout, calibration: Calibration, validity: Validity) -> None:
        """`calibration` is the one in use; its baselines are the expected unloaded counts."""
        self._layout, self._calibration, self._validity = layout, calibration, validity
        self._seen_t_ns = np.zeros(len(layout), np.int64)
        self._readings = np.zeros(len(layout), np.int64)
        shape = calibration.usable.shape
        self._n = np.zeros(shape, np.int64)
        # Sums of integers are exact, in any order and for any duration.
        self._sum, self._squares, self._zeros = np.zeros(shape), np.zeros(shape), np.zeros(shape)

    def add(self, cycles: Cycles) -> None:
        """Add cycles; a triangle that did not arrive anew in a cycle is not counted."""
        if not len(cycles):
            return
        previous_t_ns = np.concatenate([self._seen_t_ns[None], cycles.triangle_t_ns[:-1]])
        is_new = (cycles.triangle_t_ns != previous_t_ns) & (cycles.age_ns >= 0)
        self._seen_t_ns = cycles.triangle_t_ns[-1].copy()
        valid = self._validity(cycles.counts, cycles.status, cycles.age_ns) & is_new[..., None]
        counts = cycles.counts.astype(np.float64)
        self._readings += is_new.sum(axis=0)
        self._n += valid.sum(axis=0)
        self._sum += np.where(valid, counts, 0).sum(axis=0)
        self._squares += np.where(valid, counts**2, 0).sum(axis=0)
        # A count of 0 without an error flag means a load beyond the range, not a defective taxel.
        saturated = (cycles.counts == 0) & ((cycles.status & 0xF == 0) & is_new)[..., None]
        self._zeros += saturated.sum(axis=0)

    def outcome(self, t_ns: int, force: bool = False) -> ZeroOutcome:
        """Return the zero of the collected readings; with `force`, also for a loaded or moving foot."""
        usable = self._calibration.usable & PRESSURE_TAXELS
        has_readings = (self._readings >= MIN_READINGS)[:, None] & usable
        saturated = has_readings & (self._zeros > self._readings[:, None] / 2)
        is_good = has_readings & (self._n >= _MIN_VALID_SHARE * self._readings[:, None]) & (self._n > 1)
        n = np.maximum(self._n, 1)
        mean = self._sum / n
        noise = np.sqrt(np.maximum(self._squares / n - mean**2, 0) * n / np.maximum(n - 1, 1))
        activation = np.where(is_good, self._calibration.baseline_count - mean, np.nan)
        left_out = {
            "no data": self._list_taxels(usable & ~has_readings),
            "invalid readings": self._list_taxels(has_readings & ~is_good & ~saturated),
        }
        refusals: list[str] = []
        is_sufficient = bool((is_good | saturated).sum() >= _MIN_TAXEL_SHARE * max(1, usable.sum()))
        if not is_sufficient:
            refusals.append(
                f"only {int((is_good | saturated).sum())} of {int(usable.sum())} taxels gave {MIN_READINGS} valid "
                "readings: do all boards stream ('insole status' shows it), and was the time long enough?"
            )
        loaded = self._find_loaded(activation, saturated)
        if loaded.any():
            is_row_loaded: NDArray[np.bool_] = np.logical_or.reduce(loaded, axis=1)
            highest_count = np.nanmax(np.where(saturated, self._calibration.baseline_count, activation)[is_row_loaded])
            refusals.append(
                f"the foot is loaded at {self._triangle_names(is_row_loaded)}, by up to {highest_count:.0f} counts: "
                "lift it, or loosen the shoe"
            )
        is_moving: NDArray[np.bool_] = np.nan_to_num(_row_medians(np.where(is_good, noise, np.nan))) > NOISY_COUNT
        if is_moving.any():
            refusals.append(
                f"the foot moves: the readings of {self._triangle_names(is_moving)} vary by more than "
                f"{NOISY_COUNT:g} counts: keep it still in the air"
            )
        is_accepted = is_good.any() and is_sufficient and (force or not refusals)
        shift = (mean - self._calibration.baseline_count)[is_good]
        return ZeroOutcome(
            Zero(
                self._layout.foot, t_ns, np.where(is_good, mean, np.nan), np.where(is_good, noise, np.nan)
            ) if is_accepted else None,
            tuple(refusals),
            self._list_taxels(loaded),
            self._list_taxels(is_good & (noise > NOISY_COUNT)),
            {reason: list(taxels) for reason, taxels in left_out.items() if taxels},
            float(shift.mean()) if shift.size else None,
            float(shift[np.abs(shift).argmax()]) if shift.size else None,
            float(np.median(noise[is_good])) if shift.size else None,
        )  # fmt: skip

    def _find_loaded(self, activation: NDArray[np.float64], saturated: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return (n_triangles, 12) the taxels that show a load; none if the foot is unloaded."""
        median = _row_medians(activation)
        finite = median[~np.isnan(median)]
        if not finite.size:
            return saturated
        # The level of the quieter quarter is drift. If a part of the insole was zeroed under load, that quarter is far
        # below 0 and does not represent the rest.
        level = max(float(np.percentile(finite, 25)), min(0.0, float(np.median(finite))))
        above_level = np.nan_to_num(median - level)
        is_high = above_level > LOADED_COUNT
        if level > LOADED_ALONE_COUNT:
            is_high = np.nan_to_num(median) > LOADED_ALONE_COUNT
        elif is_high.sum() < 2 and not (above_level > LOADED_ALONE_COUNT).any():
            is_high[:] = False
        with np.errstate(invalid="ignore"):
            taxels: NDArray[np.bool_] = is_high[:, None] & (activation - min(level, 0.0) > LOADED_COUNT / 2)
        # One taxel at 0 may be defective; several in a triangle are a load.
        taxels |= saturated & (saturated.sum(axis=1) > 1)[:, None]
        return taxels

    def _list_taxels(self, marked: NDArray[np.bool_]) -> tuple[Taxel, ...]:
        identities = self._layout.identities.tolist()
        return tuple((*identities[row], taxel) for row, taxel in np.argwhere(marked).tolist())

    def _triangle_names(self, marked: NDArray[np.bool_]) -> str:
        return name_triangles(self._layout.identities[marked].tolist())


def name_triangles(identities: list[list[int]]) -> str:
    """Format [[5, 0], [5, 1], [6, 4]] as "board 5 triangles 0, 1; board 6 triangle 4"."""
    words = []
    for board in dict.fromkeys(board for board, _ in identities):
        triangles = [str(triangle) for address, triangle in identities if address == board]
        words.append(f"board {board} triangle{'s' if len(triangles) > 1 else ''} {', '.join(triangles)}")
    return "; ".join(words)


def _row_medians(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n_triangles,) the median of the numbers in every row; NaN if there are none."""
    median = np.full(len(values), np.nan)
    has_numbers = ~np.isnan(values).all(axis=1)
    median[has_numbers] = np.nanmedian(values[has_numbers], axis=1)
    return median
