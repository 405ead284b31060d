"""From the rows of one recording to the set of terms that explains them best, with its timing and places."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import DiagnosisError
from ..physics.effect import Where
from ..physics.law import Array
from ..recording.loading import FootRecording
from .finding import Quantity
from .load_estimate import KnownLoad, LoadEstimate
from .model.blocks import BlockDesign, block_design
from .model.design import design
from .model.nuisance import USUAL, Priors
from .model.refine import refine
from .model.regression import Timing
from .model.signal_path import Changes, load_changes
from .observations.chamber import ChamberObservation
from .observations.load_field import Move
from .observations.paired import PairedObservation, swapped_rows
from .observations.reading_faults import ReadingFaults
from .observations.wrench import WrenchObservation
from .parameters import parameters_of
from .select.count_figures import count_figures
from .select.events import Events, best_events, with_events
from .select.groups import with_groups
from .select.search import SubsetSearch
from .select.thresholds import best_thresholds
from .select.timing_search import Timed, TimedSet, search_timings
from .terms.term import Setting

# Of nothing, of a trial that was measured, of a model of the person, and of a model of any person.
LOAD_ERRORS = (USUAL, Priors(0.005, 0.02), Priors(0.015, 0.06), Priors(0.05, 0.2))
LOOSE = 5.0  # counts that a curve may be off by which a memory was calibrated into
OWN = 0.3  # the same of curves that were fitted to the recordings themselves
WELL = 1.15  # times the noise: what leaves no more is explained
FAR_CLEARER = 0.25  # the same where no more is left than the law of the memory may fail to describe
CLEARER = 0.6  # of what usual curves leave beyond the noise, that loose ones may
PLACED_ROUNDS = 3
ORDERED_ROUNDS = 2
SWAPPED, ASKEW = "swapped_triangles", "map_transform"


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """What a simulated load is looked up by: triangles that report as each other, or how the insole lies."""

    word: str
    where: Where
    parameters: dict[str, Quantity]
    margin: float
    price: float


@dataclass(frozen=True, slots=True, eq=False)
class Searched:
    """The hypotheses on the timing of one recording, under the load of where the taxels are."""

    first: TimedSet[Any]  # the best
    others: tuple[Timed, ...]
    placed: tuple[Placed, ...] = ()
    priors: Priors = USUAL  # under which they were searched for
    before: Array | None = None  # (1,) RMS counts of the model as handed in, where the taxels are believed to be

    @property
    def left(self) -> float:
        """Squared residual and prices."""
        first = self.first
        return float(
            first.left + first.search.design.nuisance.log_determinant + sum(each.price for each in self.placed)
        )

    @property
    def unexplained(self) -> float:
        """Squared residual, and what the freedom of nuisances costs."""
        first = self.first
        return float(first.search.design.total - first.best.gain + first.search.design.nuisance.log_determinant)

    @property
    def of_laws(self) -> float:
        """What the laws of the best set may fail to describe."""
        first = self.first
        every = [first.search.design.candidates[k] for k in first.best.chosen]
        return first.search.prices.of_laws(every, first.best.shares)

    @property
    def n_terms(self) -> int:
        """Of the best set, with its timing."""
        return len(self.first.best.chosen) + len(self.first.words)

    @property
    def has_memory(self) -> bool:
        """Whether the best set has one."""
        first = self.first
        return any(first.search.design.candidates[k].term.is_memory for k in first.best.chosen)


def search(seen: WrenchObservation, faults: ReadingFaults, foot: FootRecording) -> Searched:
    """The best sets for what is `seen` of `foot`, its places sharpened where the load is known."""
    if isinstance(seen, PairedObservation):
        found = _at_its_place(seen, faults, foot)
    elif isinstance(seen, ChamberObservation):
        found = _with_curves(seen, faults)
    else:
        found = _under(USUAL, seen, faults)
    return replace(found, first=_sharpened(found.first))


def _at_its_place(seen: PairedObservation, faults: ReadingFaults, foot: FootRecording) -> Searched:
    """With the error of the simulated load that makes the rows likeliest, under the load of where the taxels are.

    What acts on the load needs to know it: the search is made again once a triangle is somewhere else.
    """
    found = _under(_likeliest(seen, faults), seen, faults)
    before, move = None, Move()
    for _ in range(PLACED_ROUNDS):
        first = found.first
        refined = refine(first.search.design, first.best.chosen)
        placed = {(each.word, each.where): each for each in found.placed}
        for i, candidate in enumerate(refined.design.candidates):
            if candidate.word not in (SWAPPED, ASKEW):
                continue
            parameters, key = parameters_of(refined, i, foot), (candidate.word, candidate.where)
            k = first.best.chosen[i]
            if candidate.word == ASKEW:
                move = move.further(**{name: float(each.value) for name, each in parameters.items()})
                parameters = {name: replace(each, value=move.parameters[name]) for name, each in parameters.items()}
            known = placed.get(key)
            placed[key] = Placed(
                candidate.word, candidate.where, parameters,
                first.search.margin(first.best, i) if known is None else known.margin,
                first.search.prices.least_price(k, candidate, refined.design.candidates),
            )  # fmt: skip
        if len(placed) == len(found.placed) and not any(each.word == ASKEW for each in refined.design.candidates):
            break
        every = placed.values()
        pairs = [swapped_rows(seen.layout.identities, each.where.ids) for each in every if each.word == SWAPPED]
        if before is None:
            before = count_figures(refine(first.search.design, ()), ()).before
        del first, refined  # designs are large
        moved = seen.replaced(move, pairs)
        again = _under(_likeliest(moved, faults), moved, faults)
        again = replace(again, placed=tuple(every), before=before)
        # The same hypothesis, as a column and as it is: no worse by more than noise varies over so many rows.
        if again.left > found.left + np.sqrt(2.0 * found.left):
            break
        found = again
    return found


def _likeliest(seen: PairedObservation, faults: ReadingFaults) -> Priors:
    """The error of the simulated load under which the rows are likeliest, each beside its best set.

    The smallest that does as well but for what the laws of that set may fail to describe.
    """
    left, least = [], []
    whole = block_design(KnownLoad(seen), _weights(seen, faults))
    for priors in LOAD_ERRORS:
        whole = whole.under(priors)
        among = SubsetSearch(whole)
        best = among.run()[0]
        every = [whole.candidates[k] for k in best.chosen]
        left.append(whole.total - best.score + whole.nuisance.log_determinant)
        least.append(left[-1] - among.prices.of_laws(every, best.shares))
    return LOAD_ERRORS[next(i for i, each in enumerate(least) if each <= min(left))]


def _with_curves(seen: ChamberObservation, faults: ReadingFaults) -> Searched:
    """With curves as good as a calibration is, or with loose ones.

    Where a memory then leaves clearly less, or less with fewer terms.
    """
    if seen.has_own_curves:
        return _under(Priors(curve_count=OWN), seen, faults)
    found = _under(USUAL, seen, faults)
    noise = float(np.count_nonzero(_weights(seen, faults)))
    if not found.has_memory or found.unexplained < WELL * noise:
        return found
    loose = _under(Priors(curve_count=LOOSE), seen, faults, (found.first, *found.others))
    clearer = loose.unexplained - noise < CLEARER * (found.unexplained - noise)
    simpler = loose.n_terms < found.n_terms and loose.unexplained < found.unexplained
    # What a law fails to describe anyway is no reason to give up every recalibration, but for one that fits far worse.
    if found.unexplained < noise + found.of_laws:
        clearer, simpler = False, simpler and loose.unexplained - noise < FAR_CLEARER * (found.unexplained - noise)
    if not (loose.has_memory and (clearer or simpler)):
        return found
    if found.n_terms > 1:
        return loose
    # A memory of nearly all of the load says that nearly nothing is read at once, and leaves little load whatever is
    # wrong: readings show it, and the one term that explains most with usual curves is believed instead.
    design, best = loose.first.search.design, loose.first.best
    return loose if _after_count(design, best.chosen) < _after_count(design, ()) else found


def _after_count(design: BlockDesign, chosen: tuple[int, ...]) -> float:
    """Error of the readings that the laws of a set leave, on blocks that they were not fitted to."""
    return float(count_figures(refine(design, chosen), ()).after[0])


def _weights(seen: WrenchObservation, faults: ReadingFaults) -> Array:
    """(N, c) one over the standard deviation of a row in each channel; 0: unknown."""
    variance = np.where(faults.spikes[:, None], np.inf, seen.weight_variance)
    weights = np.asarray(np.where(np.isfinite(variance), variance, np.inf) ** -0.5)
    if seen.load_is_known:  # channels are triangles
        weights[:, faults.substituted] = 0.0
    return weights


def _under(priors: Priors, seen: WrenchObservation, faults: ReadingFaults, known: Sequence[Timed] = ()) -> Searched:
    """Every hypothesis on the timing under `priors`, best first; `known`: those of a search under other priors."""
    weights = _weights(seen, faults)
    if not weights.any():
        raise DiagnosisError(
            f"{seen.name}: no reading can be compared with the reference: each is missing, cut off, of a taxel that "
            "does not work, or of a time that the reference did not record"
        )
    if not isinstance(seen, ChamberObservation):
        whole = design(LoadEstimate(seen), weights, faults.substituted)
        return Searched(*search_timings(lambda timing: whole, seen.offset_is_free))

    events: Events | None = None  # of the first timing: later ones move them by less than they are long
    thresholds: list[tuple[int, Setting]] = []

    def under(timing: Timing, changes: Changes = ()) -> BlockDesign:
        nonlocal events, thresholds
        moved = seen.timed(offset_s=seen.offset_s - timing.delay_s, lag_s=timing.lag_s) if timing != Timing() else seen
        whole = replace(block_design(KnownLoad(moved, changes), weights, priors), moved_s=timing.delay_s)
        if events is None:
            events, thresholds = best_events(whole), best_thresholds(whole)
        return with_events(whole.with_settings(thresholds), events).released()

    best, others = search_timings(under, seen.offset_is_free, known)
    return Searched(_in_order(best, under), others, priors=priors)


def _in_order(first: TimedSet[BlockDesign], make: Callable[[Timing, Changes], BlockDesign]) -> TimedSet[BlockDesign]:
    """The set once more with every term acting on what those before it on the signal path make of the load.

    `make` returns the design of a timing and of changes of the load. Nothing is searched anew where a single term
    explains the rows, or where the order leaves more.
    """
    for _ in range(ORDERED_ROUNDS):
        design, best = first.search.design, first.best
        chosen = [design.candidates[k] for k in best.chosen]
        if len(chosen) < 2 and design.total - best.gain < WELL * first.search.noise:
            break
        changes = load_changes(design, chosen, best.shares)
        if not changes:
            break
        among = SubsetSearch(make(first.timing, changes).retimed(first.timing), first.search.barred)
        ordered = among.run()[0]
        gained = (among.design.total - ordered.score) - (design.total - best.score)
        if gained >= 0.0:
            break
        first = replace(first, left=first.left + gained, search=among, best=ordered)
    return first


def _sharpened(first: TimedSet[Any]) -> TimedSet[Any]:
    """Where the load is known on every taxel: any set of triangles can be a place, and terms are as exact as can be.

    What a coarse grid of thresholds and moments misses of a strong effect would pass for further ones.
    """
    if not isinstance(first.search.design, BlockDesign):
        return first
    whole, barred = first.search.design, first.search.barred
    whole = with_events(whole, best_events(whole, first.best.chosen))
    among = SubsetSearch(with_groups(whole, first.best), barred)
    best = max([*among.run()[:1], first.best], key=lambda each: each.score)
    sharp = refine(among.design, best.chosen).design.candidates
    sharper = [
        (k, each.settings[0])
        for k, each in zip(best.chosen, sharp, strict=True)
        if each.settings is not among.design.candidates[k].settings
    ]
    if sharper:
        among = SubsetSearch(among.design.with_settings(sharper), barred)
        best = max([*among.run()[:1], best], key=lambda each: each.score)
    return replace(first, search=among, best=among.fit(best.chosen))
