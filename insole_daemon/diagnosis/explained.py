"""What the groups of taxels were explained by, as findings, curves and effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..physics.effect import Effect, Where
from ..physics.effects import laws
from ..physics.law import Array
from ..skin.layout import Layout
from .candidate import Excitation
from .carried import bends
from .deciding import Decided
from .discovery import discover
from .finding import Finding, Quantity
from .fit import Fitted, Hypothesis
from .groups import Located, Named
from .modelling import FAMILIES, N_LOADS, Curves, as_effect, quantities
from .places import merged, said, where
from .regimes import gained, regime, when

LEAST_UNKNOWN = 0.5  # of a reading's noise: less is no mismatch to announce without a name
LOOPS = ("hysteresis", "creep", "viscoelasticity")  # whose amplitude is stated too, as the format wants


@dataclass(frozen=True, slots=True, eq=False)
class Insole:
    """What everything that is said is about."""

    foot: Foot
    layout: Layout
    recordings: tuple[str, ...]
    slots: NDArray[np.intp]  # (m,) taxels that were asked
    noise_count: Array  # (m,) of a reading
    excitation: Excitation

    def noise_of(self, slots: NDArray[np.intp]) -> Array:
        """(k,) noise of some of the taxels, counts."""
        return self.noise_count[np.searchsorted(self.slots, slots)]

    def mean_square(self, named: Named) -> float:
        """What the static model leaves of a group above the noise, counts², spread over all taxels."""
        own = self.noise_of(named.group.slots)
        return named.group.per_taxel(named.naming.excess) * float(np.sum(own**2)) / len(self.slots)


Explained = Sequence[tuple[Named, Decided]]


def held_out(insole: Insole, located: Located, explained: Explained) -> tuple[float, float]:
    """Mean squares above the noise, counts² over all taxels, before and after the explanation."""
    before = after = 0.0
    for named, decided in explained:
        whole = insole.mean_square(named)
        before += whole * max(named.naming.null.left_heldout, 0.0)
        after += whole * max(decided.best.left_heldout, 0.0)
    columns = np.searchsorted(insole.slots, _rest(insole, explained))
    left = float(np.sum((located.excess[columns] * insole.noise_count[columns]) ** 2)) / len(insole.slots)
    return before + left, after + left


def curves(insole: Insole, located: Located, explained: Explained, sure: bool = False) -> list[Curves]:
    """Of every taxel, with the effects of its group taken out; `sure`: bent no further than loads not seen allow."""
    found = []
    for named, decided in explained:
        group, fitted = named.group, decided.best.fitted
        plain = sure and not bends(group.evidence, fitted, group.floor)
        found.append(curves_of(Hypothesis(group.taxels, fitted.candidates, plain), fitted.theta, group.slots, insole))
    rest = _rest(insole, explained)
    if rest.size:
        whole = Hypothesis(located.taxels, ()).at(located.null.theta)
        floor = whole.mean_square() - float(np.mean(located.excess**2))
        plain = sure and not bends(located.taxels, whole, floor)
        every = curves_of(Hypothesis(located.taxels, (), plain), located.null.theta, insole.slots, insole)
        found.append(Curves(rest, every.load_pa, every.activation_count[np.searchsorted(insole.slots, rest)]))
    return found


def findings(insole: Insole, explained: Explained) -> tuple[list[Finding], list[Effect]]:
    """What is named, with the effects of the model, and what is not."""
    found: list[Finding] = []
    effects: list[Effect] = []
    members: dict[str, list[tuple[Named, Decided]]] = {}
    for named, decided in explained:
        for word in decided.best.words:
            members.setdefault(word, []).append((named, decided))
        if decided.unknown and _size(named) > LEAST_UNKNOWN:
            found.append(_unknown(insole, named))
    for word, parts in members.items():
        asserted = [part for part in parts if not part[1].unknown]
        named, decided = max(asserted or parts, key=lambda part: len(part[0].group.slots))
        slots = merged(part[0].group.slots for part in asserted or parts)
        finding, effect = _named(insole, word, where(slots, insole.slots, insole.layout), named, decided)
        if word != "clock" and 2 * len(finding.contradicted_by) <= len(
            insole.recordings
        ):  # else most are predicted better without it
            effects.append(effect)
        if asserted:
            found.append(finding)
    return found, effects


def _named(insole: Insole, word: str, place: Where, named: Named, decided: Decided) -> tuple[Finding, Effect]:
    fitted = decided.best.fitted
    at = [candidate.word for candidate in fitted.candidates].index(word)
    candidate, hypothesis = fitted.candidates[at], Hypothesis(named.group.taxels, fitted.candidates)
    taxels = hypothesis.at(fitted.theta)
    own = insole.noise_of(named.group.slots)
    values, std = taxels.values()[at], taxels.split(decided.best.std)[at]
    knots_s = float(named.group.evidence.observed[0].cycle_s[-1])
    parameters = quantities(candidate, values, std, hypothesis, taxels, own, insole.excitation, knots_s)
    effect = as_effect(word, place, parameters)
    if word in LOOPS:
        parameters = {**parameters, "amplitude_fraction": _amplitude(hypothesis, taxels, at, std, own)}
    left = (decided.alone[word].left_heldout, decided.best.left_heldout)
    above = named.group.per_taxel(named.naming.excess)
    before, after = (float(np.sqrt(np.mean(own**2) * (1.0 + above * max(u, 0.0)))) for u in left)
    shows = tuple(name for i, name in enumerate(insole.recordings) if candidate.works_in(i))
    others_say = tuple(name for name in insole.recordings if name not in shows and not candidate.own_columns)
    but = f" Predicted better without it, and so against it: {', '.join(others_say)}." if others_say else ""
    others = decided.alternatives[word]
    or_else = f", or {' or '.join(others)}, which these recordings cannot tell from it" if others else ""
    gain = gained(named.group.evidence, decided.alone[word], decided.best)
    finding = Finding(
        effect=word, foot=insole.foot, where=place, recordings=shows, contradicted_by=others_say, alternatives=others,
        equation=laws()[word].equation, parameters=parameters, regime=regime(gain),
        when_s=when(gain, insole.recordings.index(shows[0])),
        explains=insole.mean_square(named) * max(left[0] - left[1], 0.0),
        heldout_count=(before, after), confidence=decided.confidence[word],
        sentence=f"{said(place)}: {word}{or_else}. On readings that were held out it takes the error from {before:.2f} "
        f"to {after:.2f} counts.{but}",
    )  # fmt: skip
    return finding, effect


def _size(named: Named) -> float:
    """RMS that the static model leaves of a group above the noise, in units of a reading's noise."""
    return float(np.sqrt(named.group.per_taxel(named.naming.excess)))


def _unknown(insole: Insole, named: Named) -> Finding:
    place = where(named.group.slots, insole.slots, insole.layout)
    size = _size(named)
    nearest = " and ".join(named.naming.best.words) or "none of the known effects"
    discovered = discover(named.group, named.naming.null.fitted)
    proposal = ""
    if discovered.equation:
        share = f"{discovered.explained:.0%}"
        proposal = f" As {discovered.equation} {share} of it can be written; what it is, that does not say."
    return Finding(
        effect="unknown", foot=insole.foot, where=place, recordings=insole.recordings,
        explains=insole.mean_square(named), confidence=0.9,
        sentence=f"{said(place)}: {size:.1f} × the noise differs from the static model, and no known effect explains "
        f"it; {nearest} comes nearest and leaves {min(named.naming.best.left_heldout, 1.0):.0%} of it.{proposal}",
        equation=discovered.equation, regime=discovered.regime,
    )  # fmt: skip


def _amplitude(hypothesis: Hypothesis, fitted: Fitted, at: int, std: Array, own: Array) -> Quantity:
    """Half the peak-to-peak of what candidate `at` adds to the mean reading and no static curve could, over its span.

    `fitted` to m taxels, `own` (m,) their noise. In readings and not in loads: where the curve is steep it adds more.
    """
    candidate, values = fitted.candidates[at], fitted.values()[at]
    low, high = float(fitted.effective_pa.min()), float(fitted.effective_pa.max())
    grid = np.linspace(low - 0.2 * (high - low), high + 0.2 * (high - low), N_LOADS)
    reading = own @ hypothesis.curve(fitted, grid) / len(own)

    def fraction(theta: Array) -> float:
        assert candidate.act is not None
        found = []
        for each in hypothesis.evidence.observed:
            load = each.load.pressure_pa
            said = np.interp(candidate.act(load, each.load.step_s, theta), grid, reading)
            found.append(_span(hypothesis.beyond_static(load, said)) / _span(said))
        return max(found) / 2

    middle = fraction(values)
    nudged = [np.clip(values + step, candidate.low, candidate.high) for step in np.diag(std)]
    moved = float(np.sqrt(sum((fraction(theta) - middle) ** 2 for theta in nudged)))
    return Quantity(middle, float(np.hypot(moved, FAMILIES["amplitude_fraction"] * middle)), "1")


def _span(x: Array) -> float:
    """Of the taxel that moves most, of (N, m)."""
    return float(np.ptp(x, axis=0).max())


def curves_of(hypothesis: Hypothesis, theta: Array, slots: NDArray[np.intp], insole: Insole) -> Curves:
    """The curves of the taxels `slots`, which `hypothesis` is of, with its values at `theta`."""
    fitted = hypothesis.at(theta)
    loads = np.linspace(float(fitted.effective_pa.min()), float(fitted.effective_pa.max()), N_LOADS)
    return Curves(slots, loads, hypothesis.curve(fitted, loads) * insole.noise_of(slots)[:, None])


def _rest(insole: Insole, explained: Explained) -> NDArray[np.intp]:
    """Taxels that nothing was looked for at."""
    return np.setdiff1d(insole.slots, merged(named.group.slots for named, _ in explained))
