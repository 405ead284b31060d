"""What recalibration removes, under its own word: gain, baseline, stiffening, a wrong bit shift.

The curve that was fitted to each taxel is compared with the one it is believed to have, over the loads that were there:
activation ≈ shift + gain · believed. What all taxels of a part share is a finding; what scatters from taxel to taxel is
how well each was calibrated, and none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.calibration import Calibration
from ..physics.curve_inverse import CurveInverse
from ..physics.effects.stiffening import LAW as STIFFENING
from ..physics.law import Array, Moments, Site
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout

LEAST = 1.0  # of a reading's noise: what a shared change has to move the readings by
ALONE = 0.35  # of a reading's noise, RMS: what gain or baseline may leave beside the two together, to be named alone
SCATTERS = 3.0  # of the calibration's own scatter between taxels
APART = 6.0  # of that scatter: a single taxel
SHIFT_NEAR = 0.025  # of a power of two: a wrong shift and not just a gain
SHARPER = 0.7  # of what gain and baseline leave, that a knee has to take away
LEAST_STIFF = 0.6  # of a reading's noise
STRETCHES = np.linspace(1.0, 2.0, 21)  # of the load, that a creep may hide
KNEES = (0.2, 0.9)  # of the highest load: a knee has a curve on either side


@dataclass(frozen=True, slots=True, eq=False)
class Static:
    """How the curves differ from the believed ones: m taxels over a grid of g loads."""

    slots: NDArray[np.intp]  # (m,)
    load_pa: Array  # (g,)
    believed: Array  # (m, g) activation
    fitted: Array  # (m, g)
    stretched: Array  # (k, g) of the typical taxel as it is believed, at loads stretched by what a creep may hide
    gain: Array  # (m,)
    shift_count: Array  # (m,) added to the count


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """One change that a part of the insole shares."""

    word: str
    slots: NDArray[np.intp]
    parameters: dict[str, tuple[float, float]]  # value, standard deviation
    moves_count: float  # RMS over the loads that were there


def compare(
    slots: NDArray[np.intp],
    load_pa: Array,
    fitted: Array,
    calibration: Calibration,
    creeps: bool,
    noise_count: float,
) -> Static:
    """`fitted` (m, g): the believed baseline less the count, at `load_pa`.

    `creeps`: what of a creep goes on for longer than was recorded is no memory there, but a share of the load that
    never comes: the curve beside it is stretched along the load.
    """
    coefficients = calibration.coefficients_pa.reshape(-1, calibration.coefficients_pa.shape[-1])[slots]
    if coefficients.shape[1] == 1:
        coefficients = np.concatenate([coefficients, np.zeros_like(coefficients)], axis=1)
    inverse = CurveInverse(coefficients)
    believed = inverse(np.broadcast_to(load_pa[:, None], (len(load_pa), len(slots)))).T
    stretches = STRETCHES if creeps else STRETCHES[:1]
    far_pa = np.outer(stretches, load_pa)
    stretched = inverse(np.broadcast_to(far_pa.reshape(-1, 1), (far_pa.size, len(slots)))).mean(axis=1)
    gain, shift = _gain_and_shift(believed, fitted, noise_count)
    return Static(slots, load_pa, believed, fitted, stretched.reshape(far_pa.shape), gain, shift)


def _gain_and_shift(believed: Array, fitted: Array, noise_count: float) -> tuple[Array, Array]:
    """(m,) gain and what is added to the count, of each taxel; one of them alone where it says nearly all.

    The two are hardly told apart where little load is: what one of them explains is not two changes that cancel.
    """
    mean, centre = believed.mean(axis=1), fitted.mean(axis=1)
    varies = np.maximum(((believed - mean[:, None]) ** 2).sum(axis=1), 1e-12)
    both = ((believed - mean[:, None]) * (fitted - centre[:, None])).sum(axis=1) / varies
    gain = (believed * fitted).sum(axis=1) / np.maximum((believed**2).sum(axis=1), 1e-12)
    still, unmoved = np.ones_like(gain), np.zeros_like(gain)
    models = [(gain, unmoved), (still, mean - centre), (both, both * mean - centre)]
    off = np.sqrt(np.mean((fitted - believed) ** 2, axis=1))
    asked = off > LEAST * noise_count if np.count_nonzero(off > LEAST * noise_count) > N_TAXELS / 2 else off > -1.0
    left = [
        float(np.mean((fitted - g[:, None] * believed + s[:, None])[asked] ** 2)) - (ALONE * noise_count) ** 2 * (i < 2)
        for i, (g, s) in enumerate(models)
    ]
    return models[int(np.argmin(left))]


def changes(static: Static, noise_count: float, layout: Layout, bits: Sequence[int]) -> list[Change]:
    """What parts of the insole share; `bits`: the boards' believed shifts."""
    found: list[Change] = []
    rms = np.sqrt(np.mean(static.believed**2))
    for word, value, neutral, size in (
        ("gain", static.gain, 1.0, rms),
        ("baseline", static.shift_count, 0.0, 1.0),
    ):
        off = value - neutral
        scatter = 1.4826 * float(np.median(np.abs(off - np.median(off))))
        for slots in _parts(static.slots, off, scatter, LEAST * noise_count / size, layout):
            own = value[np.isin(static.slots, slots)]
            typical = float(np.median(own))
            std = 1.2533 * max(scatter, 1e-9) / np.sqrt(len(own))
            moves = abs(typical - neutral) * size
            name = "gain" if word == "gain" else "shift_count"
            power = round(np.log2(typical)) if word == "gain" and typical > 0 else 0
            whole_boards = len(slots) >= N_TAXELS
            if power and whole_boards and abs(typical / 2.0**power - 1) < SHIFT_NEAR and bits:
                found.append(Change("bit_shift", slots, {"shift": (bits[0] - power, 0.0)}, moves))
            else:
                found.append(Change(word, slots, {name: (typical, std)}, moves))
    stiff = _stiffening(static, noise_count, layout)
    if stiff is not None:
        found.append(stiff)
    return found


def _parts(slots: NDArray[np.intp], off: Array, scatter: float, least: float, layout: Layout) -> list[NDArray[np.intp]]:
    """Slots that share a change: all, else boards, else triangles, else single taxels that stand out."""

    def shared(own: Array, others: float) -> bool:
        typical = abs(float(np.median(own)))
        return typical > least and typical > SCATTERS * scatter / np.sqrt(len(own)) * others

    if shared(off, 3.0):
        boards = layout.identities[:, 0][slots // N_TAXELS]
        each = [float(np.median(off[boards == board])) for board in np.unique(boards)]
        if min(np.abs(each)) > 0.5 * max(np.abs(each)) and len(np.unique(np.sign(each))) == 1:
            return [slots]
    for depth in (1, 2):
        identities = layout.identities[slots // N_TAXELS][:, :depth]
        found = []
        for part in np.unique(identities, axis=0):
            inside = (identities == part).all(axis=1)
            rest = float(np.median(off[~inside])) if (~inside).any() else 0.0
            if inside.sum() > 2 and abs(rest) < least and shared(off[inside], 3.0):
                agree = np.mean(np.sign(off[inside]) == np.sign(np.median(off[inside])))
                if agree > 0.9:
                    found.append(slots[inside])
        if found:
            return [np.concatenate(found)] if depth > 1 else found
    lone = np.abs(off - np.median(off)) > max(APART * scatter, 2 * least)
    return [slots[lone]] if 0 < lone.sum() < 0.1 * len(slots) else []


def _stiffening(static: Static, noise_count: float, layout: Layout) -> Change | None:
    """Whether the mean curve bends away beyond a knee, as the law says."""
    believed, fitted, load = static.believed.mean(axis=0), static.fitted.mean(axis=0), static.load_pa
    best = (np.inf, 0.0, 0.0)
    plain = min(_left(each, fitted) for each in static.stretched)
    site = Site(layout, layout.xy_m, np.zeros(1, np.intp), np.empty(0, np.int64), np.empty(0, np.int64), 0)
    still = Moments(load, np.zeros_like(load), None)
    top = float(load[-1])
    knees = np.linspace(*KNEES, 18) * top
    for knee in knees:
        for span in np.geomspace(0.15, 20, 16) * top:
            law = STIFFENING.forward({"knee_pa": np.array([knee]), "span_pa": np.array([span])}, site)
            q = law(load[:, None], still)[:, 0]
            left = _left(np.interp(q, load, believed), fitted)
            if left < best[0]:
                best = left, float(knee), float(span)
    left, knee, span = best
    if knee <= knees[0] or plain < LEAST_STIFF * noise_count or left > (1 - SHARPER) * plain:
        return None
    parameters = {"knee_pa": (knee, 0.05 * top), "span_pa": (span, 0.2 * span)}
    return Change("stiffening", static.slots, parameters, plain)


def _left(believed: Array, fitted: Array) -> float:
    """RMS that gain and shift leave."""
    design = np.stack([np.ones_like(believed), believed], axis=1)
    rest = fitted - design @ np.linalg.lstsq(design, fitted, rcond=None)[0]
    return float(np.sqrt(np.mean(rest**2)))
