"""Delay and lag of the whole insole, and the reference's clock, as findings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..physics.effect import Effect, Where
from ..physics.effects import laws
from ..physics.law import Array
from . import sentences
from .export.as_effect import as_effect
from .finding import Finding, Quantity, heldout_of
from .model.blocks import BlockDesign
from .model.design import Design
from .observations.chamber import ChamberObservation
from .observations.paired import PairedObservation
from .observations.wrench import WrenchObservation
from .result import RecordingResult
from .select import confidence
from .select.timing_search import Timed, TimedSet
from .select.wrench_figures import Figures
from .terms.clock import LEAST_RATE

LEAST_DELAY_S = 0.003  # three standard deviations of a declared clock's offset
LEAST_LATE_S = 0.05  # that it makes by the end, at the least
LEAST_ROWS_OFF_S = 0.1  # of a reference whose rows were to go with the cycles


def is_nuisance(word: str, parameters: dict[str, Quantity]) -> bool:
    """Whether it is no more than what a declared clock may be off by."""
    if word == "delay":
        return float(parameters["delay_s"].value) < LEAST_DELAY_S
    if word == "clock":
        offset_s, rate = float(parameters["offset_s"].value), float(parameters["rate"].value)
        return abs(rate) < LEAST_RATE and abs(offset_s) < LEAST_DELAY_S
    return False


def timing_findings(
    seen: WrenchObservation,
    first: TimedSet[Any],
    further: Sequence[Timed],
    named: Sequence[str],
    found: Figures,
    least_gain: float,
) -> list[Finding]:
    """Delay and lag of the whole insole, those of them `named`; `further` hypotheses as good are alternatives."""
    findings, after = [], float(found.after[0])
    values = {
        "delay": {"delay_s": first.timing.delay_s}, "lag": {"tau_s": first.timing.lag_s},
        "clock": {"offset_s": -first.timing.delay_s},
    }  # fmt: skip
    for word in named:
        without = min((each.left for each in further if word not in each.words), default=np.inf)
        margin = (without - first.left) / least_gain
        others = [
            each for each in further
            if word not in each.words and each.left - first.left < confidence.SAME * least_gain
        ]  # fmt: skip
        other = next((w for each in others for w in each.words if w not in first.words), None)
        parameters = {name: Quantity(x, 0.03 * abs(x) + 5e-4, "s") for name, x in values[word].items()}
        if word == "clock":
            parameters["rate"] = Quantity(0.0, LEAST_RATE, "1")
        findings.append(
            Finding(
                effect=word, alternatives=() if other is None else (other,), foot=seen.layout.foot, where=Where(),
                equation=laws()[word].equation, recordings=(seen.name,), parameters=parameters,
                explains=found.timing_gain / len(first.words),
                confidence=confidence.confidence(margin, other is not None), margin=margin,
                sentence=sentences.of_effect(word, Where(), parameters),
                **heldout_of(seen.load_is_known, float(np.sqrt(after**2 + found.timing_gain)), after),
            )
        )  # fmt: skip
    return findings


def timing_effects(first: TimedSet[Any], named: Sequence[str]) -> list[Effect]:
    """Those `named`, as a chain runs them."""
    effects = []
    if "lag" in named:
        effects.append(as_effect("lag", Where(), {"tau_s": Quantity(first.timing.lag_s, 0.0, "s")}))
    if "delay" in named and first.timing.delay_s > 0:
        effects.append(as_effect("delay", Where(), {"delay_s": Quantity(first.timing.delay_s, 0.0, "s")}))
    return effects


def clock_of(result: RecordingResult) -> tuple[float, float]:
    """Offset and rate of the reference's clock; against what was declared, where that was."""
    seen = result.seen
    declared_s = seen.declared_offset_s
    offset_s = seen.reference.start_s + seen.offset_s if declared_s is None else seen.offset_s - declared_s
    rate = seen.rate
    if seen.offset_is_free:  # the rows' load may be moved already
        moved_s = result.design.moved_s if isinstance(result.design, BlockDesign) else 0.0
        offset_s -= result.timing.delay_s - moved_s
    names = _base_names(result.design)
    for name, share in zip(names, result.figures.base_shares.tolist(), strict=True):
        if name == "offset_s":
            offset_s += share
        if name == "rate":
            rate, offset_s = rate + share, offset_s - share * float(seen.t_s.mean())
    if declared_s is not None and not seen.offset_is_free:
        return 0.0, 0.0
    return offset_s, rate


def off_by_clock(seen: WrenchObservation) -> Array:
    """(1,) counts² or (3,) N² and N²·m²: mean square error of the static curves that a wrong declared clock makes.

    0 where no clock was declared, or the one that was is near.
    """
    declared_s = seen.declared_offset_s
    if declared_s is None or not seen.offset_is_free:
        return np.zeros(1 if seen.load_is_known else 3)
    return np.maximum(_square(seen.with_clock(declared_s, 0.0)) - _square(seen), 0.0)


def _square(seen: WrenchObservation) -> Array:
    if not isinstance(seen, ChamberObservation):
        return seen.mean_square_error
    known = seen.reference.is_known(seen.reference_s)[:, None, None] & seen.usable
    off_count = seen.expected_count - seen.activation_count
    return np.array([np.mean(np.square(off_count), where=known)])


def _base_names(whole: Design | BlockDesign) -> tuple[str, ...]:
    return whole.nuisance.shared_names if isinstance(whole, BlockDesign) else whole.base.names


def own_clock(result: RecordingResult) -> list[Finding]:
    """A clock of the reference's own that runs as no two quartzes do, rows that do not go with the cycles, or a clock
    that is not the one of the CAN frames, as was declared.
    """
    seen = result.seen
    is_named = any(each.effect == "clock" for each in result.findings)
    if isinstance(seen, PairedObservation) or not seen.offset_is_free or is_named:
        return []
    offset_s, rate = clock_of(result)
    late_s = abs(rate) * float(seen.t_s[-1])
    by_row = not seen.reference.has_times
    runs = abs(rate) > LEAST_RATE + 3.0 * seen.rate_std and late_s > LEAST_LATE_S
    is_stated = by_row or seen.declared_offset_s is not None
    if not (runs or (is_stated and max(abs(offset_s), late_s) > LEAST_ROWS_OFF_S)):
        return []
    parameters = {"offset_s": Quantity(offset_s, 0.01, "s"), "rate": Quantity(rate, seen.rate_std, "1")}
    pace = (
        f"runs {abs(rate):.3%} {'fast' if rate > 0 else 'slow'} against the CAN frames' and" if runs else "is off: it"
    )
    return [
        Finding(
            effect="clock", foot=seen.layout.foot, where=Where(), recordings=(seen.name,), parameters=parameters,
            equation=laws()["clock"].equation, confidence=0.95, explains=float(off_by_clock(seen)[0]),
            sentence=f"The reference's clock {pace} says {offset_s:+.2f} s at the first of the CAN frames.",
        )
    ]  # fmt: skip
