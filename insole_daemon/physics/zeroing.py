"""Taking a zero: cycles of a few seconds without load into mean and noise of every taxel, or a refusal.

The numbers come from the public recordings of this insole (Belli et al. 2023), quiet 3 s windows of three of
its recordings with the chamber open, and from the emulated person:

    activation (baseline − mean) of a triangle's median taxel, unloaded   −2.1 … 5.9 counts, a common shift of up
                                                                          to 5.4 between sessions among it
    … above the level of the foot's quieter quarter, unloaded             at most 2.7, and once 5.8 on one triangle
    … the same, 63 kg standing on both feet (emulated)                    more than 5 on 7 of 28 triangles, up to 9.6
    … the same, 40 kg                                                     more than 5 on 4 of 28 triangles, up to 6.1
    standard deviation of a taxel                                         0.95 to 1.0 median; 5 % of them beyond 5
    standard deviation of a taxel, walking (emulated)                     up to 10 and more

So a load shows as a pattern, not as a level: a level that all taxels share is drift, and to remove it is what a
zero is for. One count is about 8 kPa. A strapped shoe that presses evenly is far below the bars (1 to 3 counts
for 10 to 20 kPa) and becomes part of the zero; one that presses two triangles with more than 40 kPa is refused
unless forced. The paper left out up to 30 counts for a strapped shoe, on one taxel, at another gain: single
taxels therefore decide nothing.
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

LOADED_COUNT = 5.0  # a triangle above the quieter quarter of the foot by this is loaded where another is too
LOADED_ALONE_COUNT = 10.0  # … and by this all by itself; so is the foot where even the quieter quarter is
NOISY_COUNT = 3.0  # standard deviation of a triangle's median taxel: three times the noise at rest
MIN_READINGS = 15  # of a triangle: the mean is then good to a quarter of a count
_VALID_SHARE = 0.9  # of a taxel's readings, else it is left out
_ENOUGH_SHARE = 0.5  # of the usable taxels must be there to speak of the foot at all

Taxel = tuple[int, int, int]  # board, triangle, taxel


@dataclass(frozen=True, slots=True)
class ZeroOutcome:
    """What came of it: a zero, or none and why not; and every taxel that is not as it should be."""

    zero: Zero | None
    refusals: tuple[str, ...]  # sentences; with a zero in spite of them, it was forced
    loaded: tuple[Taxel, ...]
    noisy: tuple[Taxel, ...]  # each by itself; in the zero all the same, its noise is stated there
    left_out: dict[str, list[Taxel]] = field(default_factory=dict)  # by reason; they keep their baseline
    shift_count: float | None = None  # mean change of the baseline over the taxels of the zero
    largest_shift_count: float | None = None
    noise_count: float | None = None  # median over the taxels of the zero


class Zeroing:
    """Gathers the readings of one foot; a board's repeated reading counts once."""

    def __init__(self, layout: Layout, calibration: Calibration, validity: Validity) -> None:
        """`calibration`: the one in use, whose baselines are what the foot should read."""
        self._layout, self._calibration, self._validity = layout, calibration, validity
        self._seen_t_ns = np.zeros(len(layout), np.int64)
        self._readings = np.zeros(len(layout), np.int64)
        shape = calibration.usable.shape
        self._n = np.zeros(shape, np.int64)
        # Sums of whole numbers: exact, whatever their order and however long it takes.
        self._sum, self._squares, self._zeros = np.zeros(shape), np.zeros(shape), np.zeros(shape)

    def add(self, cycles: Cycles) -> None:
        """Take in cycles; what has not arrived anew since the cycle before is no reading."""
        if not len(cycles):
            return
        before = np.concatenate([self._seen_t_ns[None], cycles.triangle_t_ns[:-1]])
        new = (cycles.triangle_t_ns != before) & (cycles.age_ns >= 0)
        self._seen_t_ns = cycles.triangle_t_ns[-1].copy()
        valid = self._validity(cycles.counts, cycles.status, cycles.age_ns) & new[..., None]
        counts = cycles.counts.astype(np.float64)
        self._readings += new.sum(axis=0)
        self._n += valid.sum(axis=0)
        self._sum += np.where(valid, counts, 0).sum(axis=0)
        self._squares += np.where(valid, counts**2, 0).sum(axis=0)
        # Clamped at 0 with nothing wrong reported: the load is beyond the range, not the taxel.
        saturated = (cycles.counts == 0) & ((cycles.status & 0xF == 0) & new)[..., None]
        self._zeros += saturated.sum(axis=0)

    def outcome(self, t_ns: int, force: bool = False) -> ZeroOutcome:
        """The zero of what was gathered; with `force` also of a foot that is loaded or moves."""
        usable = self._calibration.usable & PRESSURE_TAXELS
        heard = (self._readings >= MIN_READINGS)[:, None] & usable
        saturated = heard & (self._zeros > self._readings[:, None] / 2)
        good = heard & (self._n >= _VALID_SHARE * self._readings[:, None]) & (self._n > 1)
        n = np.maximum(self._n, 1)
        mean = self._sum / n
        noise = np.sqrt(np.maximum(self._squares / n - mean**2, 0) * n / np.maximum(n - 1, 1))
        activation = np.where(good, self._calibration.baseline_count - mean, np.nan)
        left_out = {
            "no data": self._taxels(usable & ~heard),
            "invalid readings": self._taxels(heard & ~good & ~saturated),
        }
        refusals: list[str] = []
        enough = bool((good | saturated).sum() >= _ENOUGH_SHARE * max(1, usable.sum()))
        if not enough:
            refusals.append(
                f"only {int((good | saturated).sum())} of {int(usable.sum())} taxels gave {MIN_READINGS} valid "
                "readings: do all boards stream, and was the time long enough? 'insole status' tells"
            )
        loaded = self._loaded(activation, saturated)
        if loaded.any():
            row: NDArray[np.bool_] = np.logical_or.reduce(loaded, axis=1)
            most = np.nanmax(np.where(saturated, self._calibration.baseline_count, activation)[row])
            refusals.append(
                f"the foot is loaded at {self._triangles(row)}, by up to {most:.0f} counts: lift it, or loosen the shoe"
            )
        restless: NDArray[np.bool_] = np.nan_to_num(_rows_median(np.where(good, noise, np.nan))) > NOISY_COUNT
        if restless.any():
            refusals.append(
                f"the foot moves: the readings of {self._triangles(restless)} vary by more than "
                f"{NOISY_COUNT:g} counts: keep it still in the air"
            )
        given = good.any() and enough and (force or not refusals)
        shift = (mean - self._calibration.baseline_count)[good]
        return ZeroOutcome(
            Zero(
                self._layout.foot, t_ns, np.where(good, mean, np.nan), np.where(good, noise, np.nan)
            ) if given else None,
            tuple(refusals),
            self._taxels(loaded),
            self._taxels(good & (noise > NOISY_COUNT)),
            {reason: list(taxels) for reason, taxels in left_out.items() if taxels},
            float(shift.mean()) if shift.size else None,
            float(shift[np.abs(shift).argmax()]) if shift.size else None,
            float(np.median(noise[good])) if shift.size else None,
        )  # fmt: skip

    def _loaded(self, activation: NDArray[np.float64], saturated: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(n_triangles, 12) taxels that make the foot a loaded one; none where it is not."""
        median = _rows_median(activation)
        known = median[~np.isnan(median)]
        if not known.size:
            return saturated
        # What the quieter quarter shares is drift. Where part of the insole was zeroed under load that quarter
        # reads far below nothing, and is no measure of the rest.
        level = max(float(np.percentile(known, 25)), min(0.0, float(np.median(known))))
        excess = np.nan_to_num(median - level)
        high = excess > LOADED_COUNT
        if level > LOADED_ALONE_COUNT:
            high = np.nan_to_num(median) > LOADED_ALONE_COUNT
        elif high.sum() < 2 and not (excess > LOADED_ALONE_COUNT).any():
            high[:] = False
        with np.errstate(invalid="ignore"):
            taxels: NDArray[np.bool_] = high[:, None] & (activation - min(level, 0.0) > LOADED_COUNT / 2)
        # One taxel at 0 may be a defect; several in a triangle are a load.
        taxels |= saturated & (saturated.sum(axis=1) > 1)[:, None]
        return taxels

    def _taxels(self, marked: NDArray[np.bool_]) -> tuple[Taxel, ...]:
        identities = self._layout.identities.tolist()
        return tuple((*identities[row], taxel) for row, taxel in np.argwhere(marked).tolist())

    def _triangles(self, marked: NDArray[np.bool_]) -> str:
        return name_triangles(self._layout.identities[marked].tolist())


def name_triangles(identities: list[list[int]]) -> str:
    """[[5, 0], [5, 1], [6, 4]] as "board 5 triangles 0, 1; board 6 triangle 4"."""
    words = []
    for board in dict.fromkeys(board for board, _ in identities):
        own = [str(triangle) for address, triangle in identities if address == board]
        words.append(f"board {board} triangle{'s' if len(own) > 1 else ''} {', '.join(own)}")
    return "; ".join(words)


def _rows_median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n_triangles,) median of the numbers of every row; NaN where there are none."""
    median = np.full(len(values), np.nan)
    some = ~np.isnan(values).all(axis=1)
    median[some] = np.nanmedian(values[some], axis=1)
    return median
