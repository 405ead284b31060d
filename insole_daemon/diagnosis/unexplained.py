"""The mismatch that no set of terms explains: its size, and the finding `unknown`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

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
from .select import confidence, residual_description
from .select.residual_board import residual_board
from .select.wrench_errors import HeldoutErrors

PER_TAXEL = 4.0  # weight of the excess of a triangle per taxel, against that of a channel of the wrench
UNKNOWN_EXCESS = 1.0  # excess in variances of the noise above which a residual is `unknown`
UNKNOWN_SHARE = 0.08  # of the gain of a set: a smaller residual may be the misfit of its laws
# The same with a memory under a known load, because materials follow these laws less closely; and with any effect
# that is reported beside `unknown`.
UNKNOWN_OF_MEMORY = 0.12
LEAST_RELIANCE = 0.4  # of the mismatch: `unknown` if the terms without internal companions leave more
FAR_FLOORS = 3.0  # held-out error, relative to the floor, that no misfit of a law alone causes
MOST_LEFT = 0.5  # of the mismatch, by a set that explains it
MOST_NULL = 1.12  # error of a recording without a mismatch, relative to the noise floor


def is_unexplained(errors: HeldoutErrors, whole: Design | BlockDesign, refined: Refined[Any], timing: Timing) -> bool:
    """Return whether the selected set leaves a mismatch that no set of terms explains."""
    is_much = explains_little(errors, whole) or leaves_much(errors, whole) or leaves_much_of_a_triangle(errors, whole)
    if refined.shares and is_much:
        return True
    explained = refined.gain + timing_energy(whole, timing) + whole.undone
    share = UNKNOWN_OF_MEMORY if _has_memory(refined) and isinstance(whole, BlockDesign) else UNKNOWN_SHARE
    return bool(excess(errors, whole).max() > UNKNOWN_EXCESS and excess_square(errors, whole) > share * explained)


def relies_on_companions(whole: Design | BlockDesign, refined: Refined[Any]) -> bool:
    """Return whether a set with a memory explains the readings only together with its internal companions."""
    return _has_memory(refined) and lack_of_fit_without_companions(refined, whole) > LEAST_RELIANCE * mismatch(whole)


def _has_memory(refined: Refined[Any]) -> bool:
    return any(each.term.is_memory for each in refined.design.candidates)


def least_gain_beside_unknown(errors: HeldoutErrors, whole: Design | BlockDesign, unexplained: float) -> float:
    """Return the least gain with which an effect is reported beside `unknown`.

    A law describes an effect that is there with an error of at most UNKNOWN_OF_MEMORY of its gain. If `unexplained`,
    the squared residual beyond the noise, is larger, the effect may be a part of the unknown one. Gains are in
    variances of the noise.
    """
    if explains_little(errors, whole) or leaves_much(errors, whole):
        return float(np.inf)
    return unexplained / UNKNOWN_OF_MEMORY


def mismatch(whole: Design | BlockDesign) -> float:
    """Return the squared residual of the static model beyond the noise, in variances of the noise."""
    return whole.total - whole.noise


def lack_of_fit_without_companions(refined: Refined[Any], whole: Design | BlockDesign) -> float:
    """Return the squared residual beyond the noise of a set without internal companions, in variances of the noise.

    Internal companions describe uneven materials and loads before the recording. They are many and nearly free, so they
    can describe most mismatches that decay or depend on the load, whatever the cause. 0 if the residual is small, or if
    only the wrench is known.
    """
    noise = whole.noise
    lack = mismatch(whole) - refined.without_internal_companions.gain
    return lack if isinstance(whole, BlockDesign) and lack > UNKNOWN_EXCESS * noise else 0.0


def explains_little(errors: HeldoutErrors, whole: Design | BlockDesign) -> bool:
    """Return whether a set lowers the held-out error of a known load so little that the verdict is `unexplained`."""
    if not isinstance(whole, BlockDesign):
        return False  # an effect may change the moments and not the force
    before, after, floor = (float(each[0]) for each in (errors.before, errors.after, errors.floor))
    return before**2 - after**2 < outcome.LEAST_EXPLAINED * (before**2 - floor**2)


def leaves_much(errors: HeldoutErrors, whole: Design | BlockDesign) -> bool:
    """Return whether a set leaves a held-out error of a known load that the misfit of its laws cannot be.

    Columns for that misfit take a part of it up in the fit, and are in no model.
    """
    if not isinstance(whole, BlockDesign):
        return False
    after, floor = float(errors.after[0]), float(errors.floor[0])
    if after <= outcome.MOST_AFTER * floor:
        return False
    return errors.residual_fraction > (UNKNOWN_OF_MEMORY if after > FAR_FLOORS * floor else MOST_LEFT)


def leaves_much_of_a_triangle(errors: HeldoutErrors, whole: Design | BlockDesign) -> bool:
    """Return whether a set leaves more of the mismatch of any triangle than the misfit of its laws can be.

    In the sum over all triangles, an effect of one is small beside effects of the insole.
    """
    if not isinstance(whole, BlockDesign):
        return False
    mismatch = np.sum(whole.y**2, axis=1) - np.count_nonzero(whole.weights, axis=0)
    is_much = whole.n_rows * errors.lack_of_fit.excess > UNKNOWN_OF_MEMORY * mismatch
    return bool(np.any(is_much & (excess(errors, whole) > UNKNOWN_EXCESS)))


def null_bound(every: Iterable[tuple[HeldoutErrors, Design | BlockDesign]]) -> float:
    """Return the largest error of the model handed in, relative to the noise floor, that is no mismatch.

    It is above 1 only if no residual has an excess over the noise: a clock error within its prior raises the error
    without one.
    """
    is_noise = all(float(np.max(excess(errors, whole))) < UNKNOWN_EXCESS for errors, whole in every)
    return MOST_NULL if is_noise else 1.0


def excess_square(errors: HeldoutErrors, whole: Design | BlockDesign) -> float:
    """Return the slow part of the squared residual beyond the noise, in variances of the noise."""
    return float(whole.n_rows * errors.lack_of_fit.excess.sum())


def timing_energy(whole: Design | BlockDesign, timing: Timing) -> float:
    """Return the reduction of the squared residual by delay and lag of the whole insole, not by a free clock offset."""
    aligned = Timing(timing.delay_s if whole.load.observation.offset_is_free else 0.0)
    return float(whole.retimed(aligned).total - whole.total)


def excess(errors: HeldoutErrors, whole: Design | BlockDesign) -> Array:
    """Return the excess (c,) of the residual over the noise, in variances of the noise of each channel.

    If channels are triangles, it is per taxel: the mean of n taxels has 1/n of the noise variance of one.
    """
    noise = np.where(errors.lack_of_fit.noise > 0, errors.lack_of_fit.noise, np.inf)
    if not isinstance(whole, BlockDesign):
        return np.asarray(errors.lack_of_fit.excess / noise)
    taxels = np.maximum(whole.seen.usable.sum(axis=1), 1)
    return np.asarray(errors.lack_of_fit.excess / noise / taxels * PER_TAXEL)


def unknown_finding(seen: WrenchObservation, errors: HeldoutErrors, whole: Design | BlockDesign) -> Finding:
    """Return the finding `unknown`, with the place and the regime of the load where the residual is largest."""
    channel = 0
    if isinstance(whole, BlockDesign):
        by_triangle = excess(errors, whole)
        where = place_of(by_triangle > 0.3 * float(by_triangle.max()), whole.seen)
        text = "readings differ from the model by more than noise; no known effect explains it"
    else:
        channel = int(np.argmax(excess(errors, whole)))
        name = ("the force", "the moment m_x", "the moment m_y")[channel]
        where = residual_board(seen, np.where(errors.known[:, None], errors.course_after, 0.0), whole.weights)
        text = f"{name} differs from the model by more than noise; no known effect explains it"
    residual = np.where(errors.known, errors.course_after[:, channel], 0.0)
    regime, equation = residual_description.regime_and_equation(
        seen.load_course, residual, seen.step_s, seen.load_is_known
    )
    if regime:
        (low, high), phase = list(regime.values())
        of, unit = (1e-3, "kPa") if seen.load_is_known else (1.0, "N")
        text += f"; most of it is there while {phase} between {low * of:.0f} and {high * of:.0f} {unit}"
    place = place_in_words(where)
    before, after, floor = (float(each[0]) for each in (errors.before, errors.after, errors.floor))
    return Finding(
        effect="unknown", foot=seen.layout.foot, where=where, recordings=(seen.name,), confidence=confidence.UNKNOWN,
        left=after**2 - floor**2,
        regime=regime, equation=equation, sentence=f"{place[0].upper()}{place[1:]}: {text}.",
        **heldout_of(seen.load_is_known, before, after),
    )  # fmt: skip
