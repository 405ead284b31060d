"""Detect single taxels with another gain or baseline than calibrated, under a known load.

The taxels of a triangle share its load and memory, so the deviation of one from their median is its own. The regression
uses means of triangles, in which a taxel has a tenth of the weight.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.effects import laws
from ...physics.law import Array
from ...skin.geometry import N_TAXELS
from ..finding import Finding, Quantity
from ..places import place_in_words
from .chamber import ChamberObservation
from .load_field import Move
from .paired import PairedObservation
from .spread import STEPS, spread
from .wrench import WrenchObservation

LEAST_TAXELS = 6  # of a triangle, for a median
MOST_ODD_SHARE = 0.35  # of them: with half of them odd, the right half is unknown
LEAST_NOISE_RATIO = 0.6  # RMS of a correction over the noise of a reading
LEAST_DEVIATION = 8.0  # from the median of all taxels, in median absolute deviations as standard deviations
LEAST_EXPLAINED = 0.8  # of the mean square deviation beyond noise, by one effect
ALMOST = 0.9  # of what an effect explains: a displacement that explains so much may be the cause
MOST_DISPLACED_MM = 2.0  # displacements beyond it change the load of many taxels, and are fitted before
LEAST_ROWS = 200

Correction: TypeAlias = tuple[int, float, float]  # slot, gain less 1 or counts that are missing, mean square in counts²


@dataclass(frozen=True, slots=True, eq=False)
class OddTaxels:
    """Taxels with another gain or baseline than the rest of their triangle, and the readings that show it."""

    seen: WrenchObservation  # before the correction
    working: NDArray[np.bool_]  # (T, 12)
    findings: tuple[Finding, ...]

    def beside(self, model_pa: Array) -> list[Finding]:
        """Return the findings with those of their taxels that are odd beside the effects of a model, too.

        `model_pa` (N, T, 12) is the pressure that the static curves should read by it. An effect that depends on the
        load, or on the slope of a curve, is not the same on all taxels of a triangle.
        """
        if not self.findings or not isinstance(self.seen, ChamberObservation):
            return []
        odd = _odd_taxels(self.seen, self.working, model_pa)
        remaining = []
        for finding in self.findings:
            slots = set(finding.where.slots(self.seen.layout).tolist())
            corrections = [correction for correction in odd[finding.effect] if correction[0] in slots]
            if corrections:
                remaining.append(_finding(self.seen, finding.effect, corrections))
        return remaining


def correct_taxels(seen: WrenchObservation, working: NDArray[np.bool_]) -> tuple[WrenchObservation, OddTaxels]:
    """Return `seen` with such taxels among the `working` ones (T, 12) corrected, and findings on them."""
    if not isinstance(seen, ChamberObservation) or seen.has_own_curves:
        return seen, OddTaxels(seen, working, ())
    activation = seen.activation_count.copy()
    findings = []
    for effect, corrections in _odd_taxels(seen, working, seen.load_pa(seen.reference_s)).items():
        for slot, value, _ in corrections:
            row, taxel = divmod(slot, N_TAXELS)
            reading = activation[:, row, taxel]
            activation[:, row, taxel] = reading / (1.0 + value) if effect == "gain" else reading + value
        if corrections:
            findings.append(_finding(seen, effect, corrections))
    odd = OddTaxels(seen, working, tuple(findings))
    return replace(seen, activation_count=activation) if findings else seen, odd


def _odd_taxels(seen: ChamberObservation, working: NDArray[np.bool_], model_pa: Array) -> dict[str, list[Correction]]:
    """Return by effect the taxels whose readings deviate from `model_pa` by other counts than their triangle."""
    deviation, known = _deviation_count(seen, working, model_pa), np.isfinite(seen.weight_variance)
    expected = seen.expected_count
    shape = seen.usable.shape
    gain, shift = np.full(shape, np.nan), np.full(shape, np.nan)
    for row, taxel in np.argwhere(working).tolist():
        used = known[:, row] & np.isfinite(deviation[:, row, taxel])
        if used.sum() > LEAST_ROWS:
            gain[row, taxel], shift[row, taxel] = _fit_gain_and_baseline(
                expected[used, row, taxel], deviation[used, row, taxel]
            )
    by_effect: dict[str, list[Correction]] = {"gain": [], "baseline": []}
    is_odd = _is_odd(gain) | _is_odd(shift)
    is_odd &= is_odd.sum(axis=1, keepdims=True) <= MOST_ODD_SHARE * working.sum(axis=1, keepdims=True)
    triangles = np.flatnonzero(is_odd.any(axis=1))
    spread_count, displaced_count = (
        _deviations_count(seen, changes_by(seen), triangles)
        for changes_by in (_changes_by_spread, _changes_by_displacement)
    )
    for row, taxel in np.argwhere(is_odd).tolist():
        used = known[:, row] & np.isfinite(deviation[:, row, taxel])
        explanation = _explanation(
            expected[used, row, taxel], spread_count[row][used, taxel], displaced_count[row][used, taxel],
            deviation[used, row, taxel], float(seen.noise_count[row, taxel]),
        )  # fmt: skip
        if explanation is not None:
            effect, value, square = explanation
            by_effect[effect].append((row * N_TAXELS + taxel, value, square))
    return by_effect


def _deviation_count(seen: ChamberObservation, working: NDArray[np.bool_], model_pa: Array) -> Array:
    """Return by how many counts taxels deviate from the median of their triangle, (N, T, 12); NaN if unknown."""
    deviation = seen.pressure_pa
    deviation -= model_pa
    deviation[~working | seen.cut_off] = np.nan
    for of_triangle in deviation.transpose(1, 0, 2):  # one at a time: arrays of all taxels are large
        is_enough = np.isfinite(of_triangle).sum(axis=1, keepdims=True) >= LEAST_TAXELS
        of_triangle -= np.nanmedian(np.where(is_enough, of_triangle, 0.0), axis=1, keepdims=True)
        of_triangle[~is_enough[:, 0]] = np.nan
    deviation /= np.maximum(seen.slope_pa, 1e-9)
    return deviation


def _deviations_count(
    seen: ChamberObservation, changes_pa: Iterable[Array], triangles: NDArray[np.intp]
) -> dict[int, Array]:
    """Return the deviations (N, 12, k) in counts that k changes of the load (N, T, 12) would cause, by triangle."""
    if not triangles.size:
        return {}
    of_usable = (np.where(seen.usable, change_pa, 0.0)[:, triangles] for change_pa in changes_pa)
    from_median = [change_pa - np.median(change_pa, axis=2, keepdims=True) for change_pa in of_usable]
    steepness = np.maximum(seen.slope_pa[:, triangles], 1e-9)[..., None]
    deviations = np.stack(from_median, axis=-1) / steepness if from_median else np.zeros((*steepness.shape[:3], 0))
    return {triangle: deviations[:, i] for i, triangle in enumerate(triangles.tolist())}


def _changes_by_spread(seen: ChamberObservation) -> Iterator[Array]:
    """Yield the changes of the load if it is spread to neighbours over several numbers of steps."""
    if seen.is_uniform:
        return
    load_pa = seen.load_pa(seen.reference_s)
    for n_steps in STEPS[1:]:
        yield spread(seen, load_pa, (n_steps,))[0] - load_pa


def _changes_by_displacement(seen: ChamberObservation) -> Iterator[Array]:
    """Yield the changes of a simulated load if the insole is displaced by 1 mm, in four directions."""
    if not isinstance(seen, PairedObservation) or seen.field is None:
        return
    x_pa, y_pa = (seen.field.change_by(move).at(seen.reference_s) for move in (Move(x_mm=1.0), Move(y_mm=1.0)))
    yield x_pa
    yield y_pa
    yield (x_pa + y_pa) / np.sqrt(2.0)
    yield (x_pa - y_pa) / np.sqrt(2.0)


def _fit_gain_and_baseline(expected: Array, deviation: Array) -> tuple[float, float]:
    """Return the gain less 1 and the counts missing at rest, by least squares."""
    design = np.stack([expected, -np.ones_like(expected)], axis=1)
    coefficients = np.linalg.lstsq(design, deviation, rcond=None)[0]
    return float(coefficients[0]), float(coefficients[1])


def _is_odd(values: Array) -> NDArray[np.bool_]:
    """Return which values (T, 12) are outliers among all."""
    known = values[np.isfinite(values)]
    if known.size < LEAST_TAXELS:
        return np.zeros(values.shape, bool)
    distance = np.abs(values - np.median(known))
    scale = 1.4826 * float(np.median(distance[np.isfinite(values)]))
    return np.asarray(np.nan_to_num(distance) > LEAST_DEVIATION * max(scale, 1e-9))


def _explanation(
    expected: Array, spread: Array, displaced: Array, deviation: Array, noise_count: float
) -> tuple[str, float, float] | None:
    """Return the one effect that explains the deviation of a taxel, its value and mean square; None if none does.

    None also if load from its neighbours explains as much, `spread` (n, k): a cover or another shoe spreads it; or if
    a displacement explains nearly as much, `displaced` (n, m) for 1 mm in each of m directions.
    """
    mean_square = float(np.mean(deviation**2))
    noise = float(np.mean(np.diff(deviation) ** 2) / 2.0)
    gain = float(expected @ deviation / max(float(expected @ expected), 1e-12))
    shift = -float(np.mean(deviation))
    squares = {"gain": gain**2 * float(np.mean(expected**2)), "baseline": shift**2}
    effect = max(squares, key=lambda name: squares[name])
    by_spread, _ = _explained(deviation, spread)
    by_displacement, displacement_mm = _explained(deviation, displaced)
    is_displaced = np.abs(displacement_mm) < MOST_DISPLACED_MM
    if np.any(by_spread >= squares[effect]) or np.any(by_displacement[is_displaced] >= ALMOST * squares[effect]):
        return None
    if squares[effect] < (LEAST_NOISE_RATIO * noise_count) ** 2 or squares[effect] < LEAST_EXPLAINED * (
        mean_square - noise
    ):
        return None
    return effect, gain if effect == "gain" else shift, squares[effect]


def _explained(deviation: Array, columns: Array) -> tuple[Array, Array]:
    """Return mean squares (k,) of `deviation` (n,) that each of `columns` (n, k) explains, and coefficients (k,)."""
    products, squares = deviation @ columns, np.maximum(np.sum(columns**2, axis=0), 1e-12)
    return products**2 / squares / len(deviation), products / squares


def _finding(seen: WrenchObservation, effect: str, corrections: list[Correction]) -> Finding:
    identities = seen.layout.identities
    where = Where(
        "taxel",
        tuple(
            (*(int(number) for number in identities[slot // N_TAXELS]), slot % N_TAXELS) for slot, _, _ in corrections
        ),
    )
    values = np.array([value for _, value, _ in corrections])
    median, std = float(np.median(values)), float(np.std(values))
    if effect == "gain":
        parameters = {"gain": Quantity(1.0 + median, max(std, 0.01), "1")}
        text = f"answers {1.0 + median:.2f} times as much as calibrated"
    else:
        parameters = {"shift_count": Quantity(median, max(std, 0.1), "count")}
        text = f"rests {median:+.1f} counts from where it was calibrated"
    return Finding(
        effect=effect, foot=seen.layout.foot, where=where, equation=laws()[effect].equation, recordings=(seen.name,),
        parameters=parameters, explains=sum(square for _, _, square in corrections) / max(int(seen.usable.sum()), 1),
        sentence=f"{place_in_words(where)}: {text}, other than the rest of its triangle.",
    )  # fmt: skip
