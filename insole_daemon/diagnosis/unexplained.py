"""What no set of terms explains: how much it is, and the finding that says so."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..physics.effect import Where
from ..physics.law import Array
from . import outcome
from .finding import Finding, heldout_of
from .model.blocks import BlockDesign
from .model.design import Design
from .model.placement import place_of
from .model.refine import Refined
from .model.regression import Timing
from .observations.wrench import WrenchObservation
from .places import place_in_words
from .select import left_over
from .select.wrench_figures import Figures

PER_TAXEL = 4.0  # a taxel's share of a triangle's excess that counts as much as a channel's of a wrench
UNKNOWN_EXCESS = 1.0  # mean squares of the noise that are left
UNKNOWN_SHARE = 0.08  # of what a set explains, that it may leave: no law is met exactly
UNKNOWN_OF_MEMORY = 0.12  # the same with a memory, where the load is known: materials follow their laws less nearly
UNKNOWN_TO_FAMILIES = 0.4  # of the mismatch: more than this not explained by the memories themselves is `unknown`
STRONGER = 4.0  # times what is left without a name, that an effect beside it explains
MOST_NULL = 1.12  # times the noise floor: what a recording without a mismatch may leave


def is_unexplained(found: Figures, whole: Design | BlockDesign, refined: Refined[Any], timing: Timing) -> bool:
    """Whether a mismatch is left that no set of terms explains."""
    if refined.shares and explains_little(found, whole):
        return True
    explained = refined.gain + timing_energy(whole, timing)
    share = UNKNOWN_OF_MEMORY if _has_memory(refined) and isinstance(whole, BlockDesign) else UNKNOWN_SHARE
    return bool(excess(found, whole).max() > UNKNOWN_EXCESS and squared_rest(found, whole) > share * explained)


def is_left_by_families(whole: Design | BlockDesign, refined: Refined[Any]) -> bool:
    """Whether a set with a memory explains the readings only together with the columns that stand beside its terms."""
    return _has_memory(refined) and left_by_families(refined, whole) > UNKNOWN_TO_FAMILIES * mismatch(whole)


def _has_memory(refined: Refined[Any]) -> bool:
    return any(each.term.is_memory for each in refined.design.candidates)


def least_beside(found: Figures, whole: Design | BlockDesign, left: float) -> float:
    """Squared sum that an effect has to explain to be named beside `unknown`: less may be a part of what is `left`."""
    return float(np.inf) if explains_little(found, whole) else STRONGER * left


def mismatch(whole: Design | BlockDesign) -> float:
    """Squared residual of the static model beyond the noise, in its variances."""
    return whole.total - float(np.count_nonzero(whole.weights))


def left_by_families(refined: Refined[Any], whole: Design | BlockDesign) -> float:
    """Squared residual beyond the noise that a set leaves by itself, in variances of the noise; 0 where it is small.

    Without the columns for uneven materials and for a load before the recording. These are many and free: they describe
    most of what decays or depends on the load, whatever it is.
    """
    noise = float(np.count_nonzero(whole.weights))
    left = mismatch(whole) - refined.of_families.gain
    return left if isinstance(whole, BlockDesign) and left > UNKNOWN_EXCESS * noise else 0.0


def explains_little(found: Figures, whole: Design | BlockDesign) -> bool:
    """Whether so little is better on held-out rows of a known load that the verdict is `unexplained`."""
    if not isinstance(whole, BlockDesign):
        return False  # the force may be right and the moments wrong
    before, after, floor = (float(each[0]) for each in (found.before, found.after, found.floor))
    return before**2 - after**2 < outcome.LEAST_EXPLAINED * (before**2 - floor**2)


def most_null(every: Iterable[tuple[Figures, Design | BlockDesign]]) -> float:
    """The largest error before, in floors, that recordings show where nothing differs.

    A clock that is off within its prior leaves as much, but nowhere more than noise.
    """
    is_calm = all(float(np.max(excess(found, whole))) < UNKNOWN_EXCESS for found, whole in every)
    return MOST_NULL if is_calm else 1.0


def squared_rest(found: Figures, whole: Design | BlockDesign) -> float:
    """Squared residual beyond the noise, in its variances."""
    return float(whole.n_rows * found.left.excess.sum())


def timing_energy(whole: Design | BlockDesign, timing: Timing) -> float:
    """Squared residual that a delay and a lag of the whole insole take away; a clock's free offset is neither."""
    aligned = Timing(timing.delay_s if whole.load.observation.offset_is_free else 0.0)
    return float(whole.retimed(aligned).total - whole.total)


def excess(found: Figures, whole: Design | BlockDesign) -> Array:
    """(c,) of what is left, by channel, in mean squares of its noise; of one taxel's where channels are triangles."""
    noise = np.where(found.left.noise > 0, found.left.noise, np.inf)
    if not isinstance(whole, BlockDesign):
        return np.asarray(found.left.excess / noise)
    taxels = np.maximum(whole.seen.usable.sum(axis=1), 1)
    return np.asarray(found.left.excess / noise / taxels * PER_TAXEL)


def unknown(seen: WrenchObservation, found: Figures, whole: Design | BlockDesign) -> Finding:
    """The finding on what is left, with the place and the part of the load where it is largest."""
    channel = 0
    if isinstance(whole, BlockDesign):
        left_there = excess(found, whole)
        where = place_of(left_there > 0.3 * float(left_there.max()), whole.seen)
        text = "readings differ from the model by more than noise; no known effect explains it"
    else:
        channel = int(np.argmax(excess(found, whole)))
        name = ("the force", "the moment m_x", "the moment m_y")[channel]
        where, text = Where(), f"{name} differs from the model by more than noise; no known effect explains it"
    load = seen.reference.at(seen.reference_s)
    load = load.mean(axis=1) if seen.load_is_known else load[:, 0]
    left = np.where(found.known, found.course_after[:, channel], 0.0)
    regime, equation = left_over.regime_and_equation(load, left, seen.step_s, seen.load_is_known)
    if regime:
        (low, high), phase = list(regime.values())
        of, unit = (1e-3, "kPa") if seen.load_is_known else (1.0, "N")
        text += f"; most of it is there while {phase} between {low * of:.0f} and {high * of:.0f} {unit}"
    place = place_in_words(where)
    before, after, floor = (float(each[0]) for each in (found.before, found.after, found.floor))
    return Finding(
        effect="unknown", foot=seen.layout.foot, where=where, recordings=(seen.name,), confidence=0.8,
        left=after**2 - floor**2,
        regime=regime, equation=equation, sentence=f"{place[0].upper()}{place[1:]}: {text}.",
        **heldout_of(seen.load_is_known, before, after),
    )  # fmt: skip
