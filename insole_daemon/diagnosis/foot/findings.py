"""What walks were explained by, as findings: effects, rests that wander, and gains that recalibration removes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Effect, Where
from ...physics.effect import effect as effect_of
from ...physics.effects import laws
from ...physics.law import Array
from ..finding import Finding, Quantity
from ..places import said
from . import figures, modelling
from .deciding import Decided
from .evidence import Evidence
from .naming import Naming, Tried
from .part import EVERY, LOADED

PHASES = {"loading": (0.0, 0.25), "mid-stance": (0.25, 0.7), "push-off": (0.7, 1.0)}  # of a stance
LEAST_DRIFT_COUNT, DRIFT_SIGMAS, LEAST_DRIFT = 0.4, 6.0, 0.5  # the last in units of the noise of f_z
LEAST_GAIN, GAIN_SIGMAS = 0.08, 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """Walks with what was decided of them."""

    evidence: Evidence
    names: tuple[str, ...]  # of the recordings
    naming: Naming
    decided: Decided  # fitted as it is undone
    material: Tried  # the same effects as the material has them: free of what noise does to a fit
    recalibration: Array  # (j,) by the best set
    gains_of_nulls: Array  # mean square that the best single effect takes away of noise alone

    @property
    def words(self) -> frozenset[str]:
        """What is said of them."""
        return frozenset({"unknown"}) if self.decided.unknown else self.decided.best.words

    def rms(self, tried: Tried, channel: int = 0) -> float:
        """Of held-out rows, with the noise that the kernel took away: N, or N·m."""
        assert tried.heldout is not None
        return figures.rms(self.evidence, tried.heldout, channel)


def named(explained: Explained) -> tuple[list[Finding], list[Effect]]:
    """The effects, what each explains, and as a model has them."""
    decided, evidence = explained.decided, explained.evidence
    foot = evidence.parts[0].walk.layout.foot
    found, effects = [], []
    for term in decided.best.fitted.terms:
        without = decided.alone[term.word]
        place, parameters = modelling.place(term, evidence), modelling.quantities(term, explained.material)
        effects.append(modelling.effect(term, modelling.quantities(term, decided.best), evidence))
        if decided.unknown:
            continue
        others = decided.alternatives[term.word]
        before, after = explained.rms(without), explained.rms(decided.best)
        or_else = f", or {' or '.join(others)}, which these recordings cannot tell from it" if others else ""
        against = contradicted(explained, without)
        found.append(
            Finding(
                effect=term.word, alternatives=others, foot=foot, where=place, equation=laws()[term.word].equation,
                recordings=tuple(name for name in explained.names if name not in against), contradicted_by=against,
                regime=_regime(explained, without), parameters=parameters, explains=before**2 - after**2,
                heldout_n=(before, after), confidence=decided.confidence[term.word],
                sentence=f"{said(place)}: {term.word}{or_else}. On steps that were held out it takes the error of the "
                f"force from {before:.1f} to {after:.1f} N.",
            )
        )  # fmt: skip
    if decided.unknown:
        nearest = " and ".join(sorted(decided.best.words)) or "none of the known effects"
        left = (decided.best.left - 1) / max(explained.naming.static.left - 1, 1e-9)
        before, after = explained.rms(explained.naming.static), explained.rms(decided.best)
        found.append(
            Finding(
                effect="unknown", foot=foot, where=Where(), recordings=explained.names, confidence=0.9,
                regime=_regime(explained, explained.naming.static),
                explains=before**2 - after**2, heldout_n=(before, after),
                sentence=f"The insole differs from its static model by {before:.1f} N, and no known effect "
                f"explains it; {nearest} comes nearest and leaves {min(left, 1.0):.0%} of it.",
            )
        )  # fmt: skip
    return found, effects


def drifts(explained: Explained) -> tuple[list[Finding], list[Effect]]:
    """Boards whose rest wanders, of each recording; a model has those of the first."""
    evidence, found, effects = explained.evidence, list[Finding](), list[Effect]()
    heldout = explained.decided.best.heldout
    assert heldout is not None
    # What no effect explains is no drift either.
    left = float(np.sqrt(np.clip(np.mean(heldout[evidence.judged] ** 2), 1.0, None)))
    std = left * np.sqrt(np.diag(evidence.covariance))
    for i, (part, name) in enumerate(zip(evidence.parts, explained.names, strict=True)):
        rests, stds = evidence.rests(explained.recalibration, i), evidence.rests(std, i)
        added = part.drifting[:, 0, 3:].reshape(len(part.rows_s), len(rests), -1)
        wandering: list[int] = []
        moved = np.zeros(len(part.rows_s))
        for j, (shift, own_std) in enumerate(zip(rests, stds, strict=True)):
            # What a rest loses, the static model reads as pressure: the activation grows as the count falls.
            adds = added[:, j] @ shift[1:]
            sigmas = np.abs(shift[1:]) / own_std[1:]
            significant = np.abs(shift).max() > LEAST_DRIFT_COUNT and sigmas.max() > DRIFT_SIGMAS
            if (
                significant
                and adds.std() > LEAST_DRIFT * left * np.hypot(part.walk.noise, part.walk.shoe.noise)[0] / part.noise[0]
            ):
                wandering.append(j)
                moved += adds
        if not wandering:
            continue
        boards = tuple((evidence.boards[j],) for j in wandering)
        place = Where() if len(wandering) == len(evidence.boards) else Where("board", boards)
        shift, own_std = rests[wandering].mean(axis=0), stds[wandering].mean(axis=0)
        knots = part.knots_s
        after = explained.rms(explained.decided.best)
        before = float(np.hypot(after, (moved * part.noise[0]).std()))
        parameters = {
            "t_s": Quantity(knots, np.zeros_like(knots), "s"), "shift_count": Quantity(shift, own_std, "count")
        }  # fmt: skip
        found.append(
            Finding(
                effect="drift", foot=part.walk.layout.foot, where=place, recordings=(name,), parameters=parameters,
                equation=laws()["drift"].equation, heldout_n=(before, after), explains=before**2 - after**2,
                sentence=f"{said(place)}: its rest wanders by up to {np.ptp(shift):.1f} counts, which takes the error "
                f"of the force from {before:.1f} to {after:.1f} N.",
            )
        )  # fmt: skip
        if i == 0:
            for j, board in zip(wandering, boards, strict=True):
                # The rests of the model's curves are in the middle of the walk.
                middle = np.interp(part.rows_s, knots, rests[j]).mean()
                effects.append(effect_of("drift", Where("board", (board,)), t_s=knots, shift_count=rests[j] - middle))
    return found, effects


def gains(explained: Explained) -> list[Finding]:
    """A gain that the whole insole shares, curvature included: recalibration removes it."""
    evidence = explained.evidence
    common = explained.recalibration[: evidence.n_common]
    force = np.concatenate([np.sum(list(p.sums.values()), axis=0)[::EVERY, 0] / p.noise[0] for p in evidence.parts])
    added = evidence.nuisance[:, 0, : evidence.n_common] @ common
    mean = float(added @ force) / float(force @ force)
    of_gains = common[:: len(evidence.freedom.powers)]
    std = float(np.std(of_gains) / np.sqrt(len(of_gains)))
    if abs(mean) < max(LEAST_GAIN, GAIN_SIGMAS * std):
        return []
    moved = mean * float(np.sqrt(np.mean(np.concatenate([p.force_n for p in evidence.parts]) ** 2)))
    return [
        Finding(
            effect="gain", foot=evidence.parts[0].walk.layout.foot, where=Where(), recordings=explained.names,
            equation=laws()["gain"].equation, parameters={"gain": Quantity(1 / (1 + mean), std, "1")},
            explains=moved**2,
            sentence=f"The whole insole answers {1 / (1 + mean):.2f} times as much as its calibration says: "
            "recalibration removes it.",
        )
    ]  # fmt: skip


def contradicted(explained: Explained, without: Tried) -> tuple[str, ...]:
    """Recordings that the effect, which `without` is left out of, makes worse."""
    evidence, best = explained.evidence, explained.decided.best
    assert best.square is not None
    assert without.square is not None
    worse = best.square - without.square
    found = []
    for i, name in enumerate(explained.names):
        rows = evidence.judged & (evidence.of_part == i)
        if rows.any() and np.mean(worse[rows]) > explained.naming.price:
            found.append(name)
    return tuple(found)


def _regime(explained: Explained, without: Tried) -> dict[str, Any]:
    """In which phase of the step it matters most."""
    evidence, best = explained.evidence, explained.decided.best
    assert best.square is not None
    assert without.square is not None
    left = without.square - (best.square if without is not best else 0.0)
    phase = np.concatenate([phases(part.force_n, part.contacts) for part in evidence.parts])
    share = {
        name: float(left[(phase >= low) & (phase < high) & evidence.asked].sum())
        for name, (low, high) in PHASES.items()
    }
    return {"phase": max(share, key=lambda name: share[name])}


def phases(force_n: Array, contacts: NDArray[np.intp]) -> Array:
    """(n,) which share of the stance is over, 0 to 1; NaN in the air."""
    found = np.full(len(force_n), np.nan)
    low = LOADED[0] * float(force_n.max())
    for a, b in zip(contacts.tolist(), [*contacts[1:].tolist(), len(force_n)], strict=True):
        loaded = a + np.flatnonzero(force_n[a:b] > low)
        if loaded.size > 1:
            found[loaded] = (loaded - loaded[0]) / (loaded[-1] - loaded[0] + 1)
    return found
