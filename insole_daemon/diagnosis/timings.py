"""Findings on delay and lag of the whole insole, and on the clock of the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
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
from .observations.wrench import LEAST_TIMING_S, WrenchObservation
from .result import RecordingResult
from .select import confidence
from .select.timing_search import TimingFit, TimingHypothesis
from .select.wrench_errors import HeldoutErrors
from .terms.clock import LEAST_RATE

FAST_S = 0.05  # time constant of a viscoelasticity that is a delay to the first order
LEAST_DRIFT_S = 0.05  # of the clock until the end of the recording
GOOD_RATE_STD = 2e-5  # prior of the rate of good clocks against each other (formats.md)
LEAST_OFFSET_STD_S = 0.01  # of a clock's offset in the middle of the recording
# Of the instant that a row without times means, which may be any of its cycle: root mean square distance from the
# cycle's end, where it is put, in periods.
OF_A_CYCLE = 3**-0.5
LEAST_ROWS_OFF_S = 0.1  # of a reference whose rows should match the cycles


def is_nuisance(word: str, parameters: dict[str, Quantity], latest_s: float) -> bool:
    """Return whether a delay or a clock is within the tolerance of a declared clock.

    A delay also is if the readings may have been taken `latest_s` before their times. So is a viscoelasticity that
    is too fast to differ from one of a·τ.
    """
    if word == "delay":
        return float(parameters["delay_s"].value) < LEAST_TIMING_S + latest_s
    if word == "viscoelasticity":
        share, tau_s = (np.asarray(parameters[name].value, float) for name in ("a", "tau_s"))
        return bool(np.max(tau_s) < FAST_S and np.sum(share * tau_s) < latest_s)
    if word == "clock":
        offset_s, rate = float(parameters["offset_s"].value), float(parameters["rate"].value)
        return abs(rate) < LEAST_RATE and abs(offset_s) < LEAST_TIMING_S
    return False


def timing_findings(
    seen: WrenchObservation,
    first: TimingFit[Any],
    further: Sequence[TimingHypothesis],
    named: Sequence[str],
    figures: HeldoutErrors,
    least_gain: float,
) -> list[Finding]:
    """Return the findings on those of delay, lag and clock of the whole insole whose words are in `named`.

    `first`: the best timing hypothesis; `further`: the others, of which those that fit as well give the alternatives.
    `least_gain`: gain of the smallest effect, in variances of the noise.
    """
    findings, after = [], float(figures.after[0])
    values = {
        "delay": {"delay_s": first.timing.delay_s}, "lag": {"tau_s": first.timing.lag_s},
        "clock": {"offset_s": -first.timing.delay_s},
    }  # fmt: skip
    for word in named:
        residual_without = min((timed.criterion for timed in further if word not in timed.words), default=np.inf)
        margin = (residual_without - first.criterion) / least_gain
        as_good = [
            timed for timed in further
            if word not in timed.words and timed.criterion - first.criterion < confidence.EQUAL_SCORE * least_gain
        ]  # fmt: skip
        alternative = next(
            (word_of_other for timed in as_good for word_of_other in timed.words if word_of_other not in first.words),
            None,
        )
        parameters = {name: Quantity(value, 0.03 * abs(value) + 5e-4, "s") for name, value in values[word].items()}
        if word == "clock":
            parameters["rate"] = Quantity(0.0, LEAST_RATE, "1")
        findings.append(
            Finding(
                effect=word, alternatives=() if alternative is None else (alternative,), foot=seen.layout.foot,
                where=Where(), equation=laws()[word].equation, recordings=(seen.name,), parameters=parameters,
                explains=figures.timing_gain / len(first.words), margin=margin,
                sentence=sentences.of_effect(word, Where(), parameters),
                **heldout_of(seen.load_is_known, float(np.sqrt(after**2 + figures.timing_gain)), after),
            )
        )  # fmt: skip
    return findings


def timing_effects(first: TimingFit[Any], named: Sequence[str]) -> list[Effect]:
    """Return the effects of the model for the timings that are in `named`."""
    effects = []
    if "lag" in named:
        effects.append(as_effect("lag", Where(), {"tau_s": Quantity(first.timing.lag_s, 0.0, "s")}))
    if "delay" in named and first.timing.delay_s > 0:
        effects.append(as_effect("delay", Where(), {"delay_s": Quantity(first.timing.delay_s, 0.0, "s")}))
    return effects


def clock_of(result: RecordingResult) -> tuple[float, float]:
    """Return offset, s, and rate of the reference's clock; if one was declared, relative to that."""
    seen = result.seen
    declared_s = seen.declared_offset_s
    offset_s = seen.reference.start_s + seen.offset_s if declared_s is None else seen.offset_s - declared_s
    rate = seen.rate
    if seen.offset_is_free:  # the rows may already be shifted by a part of the delay
        moved_s = result.design.moved_s if isinstance(result.design, BlockDesign) else 0.0
        offset_s -= result.timing.delay_s - moved_s
    nuisance_names = _nuisance_names(result.design)
    for name, share in zip(nuisance_names, result.figures.base_shares.tolist(), strict=True):
        if name == "offset_s":
            offset_s += share
        if name == "rate":
            rate, offset_s = rate + share, offset_s - share * float(seen.t_s.mean())
    if declared_s is not None and not seen.offset_is_free:
        return 0.0, 0.0
    return offset_s, rate


def of_wrong_clock(rate: Quantity) -> Quantity:
    """Return the rate of the fault: the measured `rate` also contains that of good clocks, an unknown part of it."""
    return replace(rate, std=float(np.hypot(rate.std, GOOD_RATE_STD)))


def off_by_clock(seen: WrenchObservation) -> Array:
    """Return the mean square error of the static curves that a wrong declared clock causes, (1,) or (3,).

    Its unit is counts² if the load is known, else N² and N²·m². It is 0 without a declared clock, or if its offset was
    kept.
    """
    declared_s = seen.declared_offset_s
    if declared_s is None or not seen.offset_is_free:
        return np.zeros(1 if seen.load_is_known else 3)
    return np.maximum(_mean_square_error(seen.with_clock(declared_s, 0.0)) - _mean_square_error(seen), 0.0)


def _mean_square_error(seen: WrenchObservation) -> Array:
    if not isinstance(seen, ChamberObservation):
        return seen.mean_square_error
    known = seen.reference.is_known(seen.reference_s)[:, None, None] & seen.usable
    off_count = seen.expected_count - seen.activation_count
    return np.array([np.mean(np.square(off_count), where=known)])


def _nuisance_names(whole: Design | BlockDesign) -> tuple[str, ...]:
    return whole.nuisance.shared_names if isinstance(whole, BlockDesign) else whole.base.names


def clock_findings(result: RecordingResult) -> list[Finding]:
    """Return the finding on the reference's clock, if its rate or offset cannot be those of a good clock.

    These are a rate beyond that of two quartzes, rows that do not match the cycles, and a declared CAN clock that is
    wrong. The rate is not reported beside an unknown effect on most of the insole, because that effect changes the
    fitted rate.
    """
    seen = result.seen
    is_named = any(finding.effect == "clock" for finding in result.findings)
    if isinstance(seen, PairedObservation) or not seen.offset_is_free or is_named:
        return []
    offset_s, rate = clock_of(result)
    drift_s = abs(rate) * float(seen.t_s[-1])
    is_by_row = not seen.reference.has_times
    is_bent = any(
        finding.effect == "unknown" and 2 * finding.where.slots(seen.layout).size > seen.usable.size
        for finding in result.findings
    )
    has_rate = not is_bent and abs(rate) > LEAST_RATE + 3.0 * seen.rate_std and drift_s > LEAST_DRIFT_S
    is_stated = is_by_row or seen.declared_offset_s is not None
    if not (has_rate or (is_stated and max(abs(offset_s), drift_s) > LEAST_ROWS_OFF_S)):
        return []
    offset_std_s = float(np.hypot(LEAST_OFFSET_STD_S, seen.rate_std * seen.t_s.mean()))  # extrapolated from the middle
    if is_by_row:
        offset_std_s = float(np.hypot(offset_std_s, OF_A_CYCLE * np.median(seen.period_s[seen.usable.any(axis=1)])))
    parameters = {
        "offset_s": Quantity(offset_s, offset_std_s, "s"), "rate": of_wrong_clock(Quantity(rate, seen.rate_std, "1"))
    }  # fmt: skip
    sentence_part = (
        f"runs {abs(rate):.3%} {'fast' if rate > 0 else 'slow'} against the CAN frames' and"
        if has_rate
        else "is off: it"
    )
    return [
        Finding(
            effect="clock", foot=seen.layout.foot, where=Where(), recordings=(seen.name,), parameters=parameters,
            equation=laws()["clock"].equation, explains=float(off_by_clock(seen)[0]),
            sentence=f"The reference's clock {sentence_part} says {offset_s:+.2f} s at the first of the CAN frames.",
        )
    ]  # fmt: skip
