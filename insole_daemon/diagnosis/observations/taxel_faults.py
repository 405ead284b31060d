"""Single taxels that answer more or less than they were calibrated for, or rest at another count.

Where the load is known, all taxels of a triangle are off by the same pressure, whatever memory it goes through: what
one says otherwise than their median is its own. The regression sees means of triangles, in which a taxel is a tenth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.effects import laws
from ...physics.law import Array
from ...skin.geometry import N_TAXELS
from ..finding import Finding, Quantity
from ..places import said
from .chamber import ChamberObservation
from .spread import spread
from .wrench import WrenchObservation

LEAST_TAXELS = 6  # of a triangle, that a median is taken of
MOST_ODD = 0.35  # of them, that may be off: with half of them nobody knows which half
LEAST_SIZE = 0.6  # of a reading's noise: what a correction moves its readings by, RMS
CLEAR = 8.0  # times what most taxels are off by (median absolute deviation as a standard deviation)
LEAST_SHARE = 0.6  # of what is off beyond noise, that one static word explains
LEAST_ROWS = 200


def with_taxels(seen: WrenchObservation, working: NDArray[np.bool_]) -> tuple[WrenchObservation, list[Finding]]:
    """`seen` with the readings of such taxels put right, among the `working` ones (T, 12), and what is said of them."""
    if not isinstance(seen, ChamberObservation) or seen.has_own_curves:
        return seen, []
    off, known = _off_count(seen, working), np.isfinite(seen.weight_variance)
    expected, beside = seen.expected_count, _spread_count(seen)
    shape = seen.usable.shape
    gain, shift = np.full(shape, np.nan), np.full(shape, np.nan)
    for row, taxel in np.argwhere(working).tolist():
        rows = known[:, row] & np.isfinite(off[:, row, taxel])
        if rows.sum() > LEAST_ROWS:
            gain[row, taxel], shift[row, taxel] = _static(expected[rows, row, taxel], off[rows, row, taxel])
    findings: list[Finding] = []
    activation = seen.activation_count.copy()
    words: dict[str, list[tuple[int, float, float]]] = {"gain": [], "baseline": []}
    odd = _odd(gain) | _odd(shift)
    odd &= odd.sum(axis=1, keepdims=True) <= MOST_ODD * working.sum(axis=1, keepdims=True)
    for row, taxel in np.argwhere(odd).tolist():
        rows = known[:, row] & np.isfinite(off[:, row, taxel])
        noise_count = float(seen.noise_count[row, taxel])
        told = _told(expected[rows, row, taxel], beside[rows, row, taxel], off[rows, row, taxel], noise_count)
        if told is None:
            continue
        word, value, square = told
        words[word].append((row * N_TAXELS + taxel, value, square))
        own = activation[:, row, taxel]
        activation[:, row, taxel] = own / (1.0 + value) if word == "gain" else own + value
    total = max(int(seen.usable.sum()), 1)
    for word, every in words.items():
        if every:
            findings.append(_finding(seen, word, every, total))
    return replace(seen, activation_count=activation) if findings else seen, findings


def _off_count(seen: ChamberObservation, working: NDArray[np.bool_]) -> Array:
    """(N, T, 12) counts by which taxels read more than their triangle's others say; NaN where too few do."""
    above = seen.pressure_pa - seen.load_pa(seen.reference_s)
    above = np.where(working & ~seen.cut_off, above, np.nan)
    enough = np.isfinite(above).sum(axis=2, keepdims=True) >= LEAST_TAXELS
    middle = np.nanmedian(np.where(enough, above, 0.0), axis=2, keepdims=True)
    return np.asarray(np.where(enough, above - middle, np.nan) / np.maximum(seen.slope_pa, 1e-9))


def _spread_count(seen: ChamberObservation) -> Array:
    """(N, T, 12, k) counts by which taxels would read more, other than their triangle, if load were spread so far."""
    if seen.is_uniform:
        return np.zeros((*seen.slope_pa.shape, 0))
    load, *further = spread(seen, seen.load_pa(seen.reference_s))
    more = [np.where(seen.usable, each - load, 0.0) for each in further]
    apart = np.stack([each - np.median(each, axis=2, keepdims=True) for each in more], axis=-1)
    return np.asarray(apart / np.maximum(seen.slope_pa, 1e-9)[..., None])


def _static(expected: Array, off: Array) -> tuple[float, float]:
    """How much more than 1 the gain is, and the counts that are missing at rest."""
    design = np.stack([expected, -np.ones_like(expected)], axis=1)
    found = np.linalg.lstsq(design, off, rcond=None)[0]
    return float(found[0]), float(found[1])


def _odd(values: Array) -> NDArray[np.bool_]:
    """(T, 12) far from what most are."""
    known = values[np.isfinite(values)]
    if known.size < LEAST_TAXELS:
        return np.zeros(values.shape, bool)
    away = np.abs(values - np.median(known))
    scale = 1.4826 * float(np.median(away[np.isfinite(values)]))
    return np.asarray(np.nan_to_num(away) > CLEAR * max(scale, 1e-9))


def _told(expected: Array, beside: Array, off: Array, noise_count: float) -> tuple[str, float, float] | None:
    """The one static word that explains what a taxel is off by, its value and mean square; None: none does.

    Nor where load of its neighbours explains as much, `beside` (n, k): that a cover spreads, or another shoe.
    """
    whole = float(np.mean(off**2))
    noise = float(np.mean(np.diff(off) ** 2) / 2.0)
    gain = float(expected @ off / max(float(expected @ expected), 1e-12))
    shift = -float(np.mean(off))
    squares = {"gain": gain**2 * float(np.mean(expected**2)), "baseline": shift**2}
    word = max(squares, key=lambda each: squares[each])
    by_spread = (off @ beside) ** 2 / np.maximum(np.sum(beside**2, axis=0), 1e-12) / len(off)
    if np.any(by_spread >= squares[word]):
        return None
    if squares[word] < (LEAST_SIZE * noise_count) ** 2 or squares[word] < LEAST_SHARE * (whole - noise):
        return None
    return word, gain if word == "gain" else shift, squares[word]


def _finding(seen: WrenchObservation, word: str, every: list[tuple[int, float, float]], total: int) -> Finding:
    identities = seen.layout.identities
    where = Where(
        "taxel", tuple((*(int(x) for x in identities[slot // N_TAXELS]), slot % N_TAXELS) for slot, _, _ in every)
    )
    values = np.array([value for _, value, _ in every])
    middle, spread = float(np.median(values)), float(np.std(values))
    if word == "gain":
        parameters = {"gain": Quantity(1.0 + middle, max(spread, 0.01), "1")}
        text = f"answers {1.0 + middle:.2f} times as much as calibrated"
    else:
        parameters = {"shift_count": Quantity(middle, max(spread, 0.1), "count")}
        text = f"rests {middle:+.1f} counts from where it was calibrated"
    return Finding(
        effect=word, foot=seen.layout.foot, where=where, equation=laws()[word].equation, recordings=(seen.name,),
        parameters=parameters, explains=sum(square for _, _, square in every) / total, confidence=0.95,
        sentence=f"{said(where)}: {text}, other than the rest of its triangle.",
    )  # fmt: skip
