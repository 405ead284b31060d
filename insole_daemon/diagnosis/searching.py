"""Search for the set of terms that explains one recording best, with the timing and the places of the terms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..errors import DiagnosisError
from ..physics.law import Array
from ..recording.loading import FootRecording
from .load_error import with_likely_load_error
from .load_estimate import KnownLoad, LoadEstimate
from .model.blocks import RECALIBRATIONS, BlockDesign, block_design
from .model.design import Design, design
from .model.nuisance import USUAL, Priors
from .model.refine import Refined, refine
from .model.regression import Timing
from .model.signal_path import Changes
from .observations.chamber import ChamberObservation
from .observations.load_field import Move
from .observations.paired import PairedObservation
from .observations.reading_faults import ReadingFaults
from .observations.wrench import WrenchObservation
from .placements import Placements
from .search_result import SearchResult
from .select.amplitudes import with_amplitudes
from .select.corrected_rows import with_corrected_curves, with_uncertain_switching
from .select.count_errors import count_errors
from .select.events import refine_events, refine_events_beside
from .select.groups import with_groups
from .select.ordered_search import changes_load_of_a_part, on_signal_path, with_refined_settings, with_refined_snaps
from .select.refined_settings import RefinedSettings, with_refined
from .select.search import GOOD_FIT, SubsetSearch
from .select.thresholds import refine_thresholds, with_thresholds_of_walk
from .select.timing_search import TimingFit, search_timings
from .select.wrench_errors import HeldoutErrors
from .terms import mean_curve

LOOSE = Priors(curve_count=5.0)  # for curves that contain the mean curve of a memory (loose curves)
OWN_CURVE_COUNT = 0.3  # the same of a curve that was fitted to the recordings themselves
CLEARER = 0.6  # excess over the noise with one kind of curves relative to the other that is clearly less
FAR_CLEARER = 0.25  # the same if usual curves leave no more than the possible misfit of the laws
LESS_BY_SWITCHING = 0.9  # of the deviance, if readings while a snap switches count less, to search again
MOST_LEFT = 0.25  # of the mean square error beyond the floor by a set for which curves are corrected
MOST_UNEXPLAINED = 1.25  # sum of squares about corrected curves without any term, in that about the curves before
LITTLE_LEFT = 0.1  # of the mean square error of a walk, summed over its channels: no reason for further terms
PLACED_ROUNDS = 3  # of searches after the taxels were moved to fitted places
ORDERED_ROUNDS = 2  # of searches with terms that act on each other's output


def search(seen: WrenchObservation, faults: ReadingFaults, placements: Placements, foot: FootRecording) -> SearchResult:
    """Return the best set for the observation `seen` of `foot`, beside `placements` that are known before.

    Raises DiagnosisError if no reading can be compared with the reference.
    """
    if isinstance(seen, PairedObservation):
        result = _search_with_placement(seen, faults, placements, foot)
    elif isinstance(seen, ChamberObservation):
        result = _search_with_bounds(seen, faults)
    else:
        result = _search_of_walk(seen, faults)
    return replace(result, first=_refined_places(result.first))


def _search_with_placement(
    seen: PairedObservation, faults: ReadingFaults, placements: Placements, foot: FootRecording
) -> SearchResult:
    """Return the best set beside a simulation, with the load at the fitted places of the taxels.

    A selected swap of triangles or placement of the insole is applied to the load, and the search runs again, because
    terms that act on the load need the load at the true places.
    """

    def search_at(placements: Placements) -> SearchResult:
        return replace(_search_under(None, placements.applied_to(seen), faults), placed=placements.fitted)

    result = search_at(placements)
    for _ in range(PLACED_ROUNDS):
        known, placements = placements, placements.with_selected(result.first.search, result.first.best, foot)
        if placements.move == known.move and len(placements.fitted) == len(known.fitted):
            break
        # The column was the linearisation of this placement. The criterion may rise by its standard deviation under
        # noise, √(2n) with n rows, and it is about n.
        most = result.criterion + np.sqrt(2.0 * result.criterion)
        del result  # its design is large
        result = search_at(placements)
        if result.criterion > most:
            placements = known
            del result
            result = search_at(placements)
            break
    switching = _rows_while_switching(result, faults)
    if switching is not None:
        priors, placed = result.priors, result.placed
        del result  # its design is large
        result = replace(_search_under(priors, switching, faults), placed=placed)
    if not result.placed:
        return result
    moved, by_the_map = placements.applied_to(seen), seen.replaced(Move(), ())
    weights = np.where(faults.weights_of(moved) > 0.0, faults.weights_of(by_the_map), 0.0)
    return replace(result, before=count_errors(refine(block_design(KnownLoad(by_the_map), weights), ()), ()).before)


def _search_with_bounds(seen: ChamberObservation, faults: ReadingFaults) -> SearchResult:
    """Return the best set of a usual material, or that of an unusual one.

    The latter if a term of the former reaches the bound of its shares, and the wide bound leaves clearly less, or less
    with fewer terms.
    """
    usual = _search_with_curves(seen, faults)
    if not usual.is_at_bound:
        return usual
    seen = usual.first.search.design.unmoved
    wide = _search_under(replace(usual.priors, has_wide_bounds=True), seen, faults, usual)
    noise = float(np.count_nonzero(faults.weights_of(seen)))
    is_clearer = wide.deviance - noise < CLEARER * (usual.deviance - noise)
    is_simpler = wide.n_terms < usual.n_terms and wide.deviance < usual.deviance
    return wide if (is_clearer or is_simpler) and wide.heldout_excess < usual.heldout_excess else usual


def _search_of_walk(seen: WrenchObservation, faults: ReadingFaults) -> SearchResult:
    """Return the best set whose memories have a gain and a stiffening as companions, or a mean curve, too."""
    weights = faults.weights_of(seen)
    _refuse_unknown(weights, seen)
    loose = with_thresholds_of_walk(design(LoadEstimate(seen), weights, faults.substituted))
    usual = loose.without_companions((mean_curve.TERM.word,))

    def search_in(whole: Design) -> SearchResult:
        return SearchResult(*search_timings(lambda timing: whole, seen.offset_is_free))

    noise = float(np.count_nonzero(weights))
    return _with_usual_or_loose_curves(search_in(usual), lambda: search_in(loose), noise)


def _search_with_curves(seen: ChamberObservation, faults: ReadingFaults) -> SearchResult:
    """Return the best set with curves of usual accuracy, or with loose ones.

    A set that leaves a misfit is searched for again: one with loose curves about corrected ones, one with usual curves
    and snaps with a larger variance while they switch.
    """
    priors = Priors(curve_count=OWN_CURVE_COUNT) if seen.has_own_curves else USUAL
    best = _search_under(priors, seen, faults)
    noise = float(np.count_nonzero(faults.weights_of(seen)))
    if best.has_loop and not seen.has_own_curves:
        best = _with_usual_or_loose_curves(best, partial(_search_loosely, best, faults), noise)
    if best.deviance < GOOD_FIT * noise:
        return best
    if best.priors == LOOSE:
        again = _search_about_corrected(best, best.refined, best.errors, faults)
        return min(best, again, key=lambda result: result.criterion)
    switching = _rows_while_switching(best, faults)
    if switching is not None:
        del best  # its design is large
        best = _search_under(priors, switching, faults)
    return best


def _rows_while_switching(result: SearchResult, faults: ReadingFaults) -> ChamberObservation | None:
    """Return the rows with a larger variance while the snaps of a set switch.

    None if the set fits well, or if that alone hardly lowers its deviance.
    """
    seen = result.first.search.design.unmoved
    is_good = result.deviance < GOOD_FIT * float(np.count_nonzero(faults.weights_of(seen)))
    if is_good or result.deviance_while_switching >= LESS_BY_SWITCHING * result.deviance:
        return None
    return with_uncertain_switching(seen, result.refined)


def _search_loosely(usual: SearchResult, faults: ReadingFaults) -> SearchResult:
    """Return the best set with loose curves, about curves that are corrected for the set `usual`."""
    design = usual.first.search.design
    kept = [k for k in usual.first.best.chosen if design.candidates[k].word not in RECALIBRATIONS]
    loose = design.subset(kept).under(LOOSE).without_companions(RECALIBRATIONS)
    refined = refine(loose, tuple(range(len(kept))))
    return _search_about_corrected(usual, refined, count_errors(refined, ()), faults)


def _search_about_corrected(
    known: SearchResult, refined: Refined[BlockDesign], errors: HeldoutErrors, faults: ReadingFaults
) -> SearchResult:
    """Return the best set with loose curves, about curves that are corrected for the set `refined` (Gauss & Newton).

    A set that leaves much is wrong, and so would be the corrections; so are corrections that make the mismatch larger
    before any term. `known`: the result before, which is returned if its search had the same rows and priors. `errors`:
    those of `refined`.
    """
    before = refined.design.unmoved
    left, mismatch = (float(rms[0] ** 2 - errors.floor[0] ** 2) for rms in (errors.after, errors.before))
    seen = with_uncertain_switching(before, refined)
    if errors.recalibrated is not None and left < MOST_LEFT * mismatch:
        corrected = with_corrected_curves(seen, errors.recalibrated)
        if refined.design.unexplained(corrected) <= MOST_UNEXPLAINED * refined.design.unexplained(before):
            seen = corrected
    if known.priors == LOOSE and seen is before:
        return known
    return _search_under(LOOSE, seen, faults, known)


def _with_usual_or_loose_curves(
    usual: SearchResult, search_loosely: Callable[[], SearchResult], noise: float
) -> SearchResult:
    """Return the result `usual`, or that with loose curves.

    Loose curves are used if a memory or snap then leaves clearly less, or less with fewer terms: the calibration
    probably contains its mean curve. `noise`: the squared residual of noise alone.
    """
    if usual.deviance < GOOD_FIT * noise:
        return usual
    loose, left = search_loosely(), usual.deviance_while_switching
    clearer = loose.deviance - noise < CLEARER * (left - noise)
    simpler = loose.n_terms < usual.n_terms and loose.deviance < left
    # With loose curves the search has no static effect. The possible misfit of a law is not reason enough for them,
    # unless they fit far better without further terms.
    if left < noise + usual.misfit:
        clearer = loose.deviance - noise < FAR_CLEARER * (left - noise) and loose.n_terms <= usual.n_terms
        simpler = False
    if not (loose.has_loop and (clearer or simpler)):
        return usual
    # Loose curves take up errors of a law too, so held-out errors decide; clear ones, if loose curves need fewer terms.
    by_usual, by_loose = usual.heldout_excess, loose.heldout_excess
    if loose.n_terms < usual.n_terms:
        is_known = isinstance(usual.first.search.design, BlockDesign)
        by_loose = CLEARER * by_loose if is_known else max(by_loose - LITTLE_LEFT, 0.0)
    return usual if by_usual < by_loose else loose


def _refuse_unknown(weights: Array, seen: WrenchObservation) -> None:
    """Raise DiagnosisError if no row has a weight."""
    if not weights.any():
        raise DiagnosisError(
            f"{seen.name}: no reading can be compared with the reference: each is missing, cut off, of a taxel that "
            "does not work, or of a time that the reference did not record"
        )


def _search_under(
    priors: Priors | None, seen: ChamberObservation, faults: ReadingFaults, known: SearchResult | None = None
) -> SearchResult:
    """Return the timing hypotheses with nuisances under `priors`; None: those of the simulation's likeliest load error.

    `known`: the result under other priors. Its times and refined settings are initial values, and its terms may change
    the load, too.
    """
    weights = faults.weights_of(seen)
    _refuse_unknown(weights, seen)
    # Refined once, with the first timing: later timings differ by less than the duration of an event.
    settings: RefinedSettings | None = None if known is None else known.settings
    first: BlockDesign | None = None
    if priors is None:
        assert isinstance(seen, PairedObservation)
        first = with_likely_load_error(seen, faults)
        priors = first.priors

    def design_after(timing: Timing, changes: Changes = ()) -> BlockDesign:
        nonlocal settings, first
        if first is not None and not changes and timing == Timing():
            whole, first = first, None  # designs are large
        else:
            whole = made_after(timing, changes)
        if settings is None:
            settings = {**refine_events(whole), **refine_thresholds(whole)}
        whole = with_amplitudes(with_refined(whole, settings))
        whole.forget_load()
        return whole

    def made_after(timing: Timing, changes: Changes) -> BlockDesign:
        moved = seen.timed(offset_s=seen.offset_s - timing.delay_s, lag_s=timing.lag_s) if timing != Timing() else seen
        return replace(block_design(KnownLoad(moved, changes), weights, priors), moved_s=timing.delay_s)

    hypotheses = () if known is None else (known.first, *known.others)
    best, others = search_timings(design_after, seen.offset_is_free, hypotheses)
    best = with_refined_snaps(best)
    if known is not None and changes_load_of_a_part(known.first):
        start = known.first
        for _ in range(ORDERED_ROUNDS):
            ordered = on_signal_path(best, start, design_after)
            if ordered is None:
                break
            best, start = min(best, ordered, key=lambda fitted: fitted.criterion), ordered
        del start, ordered  # designs are large
    for _ in range(ORDERED_ROUNDS):
        ordered = on_signal_path(best, best, design_after)
        if ordered is None or ordered.criterion >= best.criterion:
            break
        best = ordered
    assert settings is not None  # as of the first design
    best.search.design.forget_load()
    return SearchResult(best, others, priors=priors, settings=settings)


def _refined_places(first: TimingFit[Any]) -> TimingFit[Any]:
    """Return the best set of a search with any set of triangles as a place, and with refined parameters.

    Only if the load is known on every taxel. The error of the grid of thresholds and times leaves a residual of a
    strong effect, which would otherwise be selected as further effects.
    """
    if not isinstance(first.search.design, BlockDesign):
        return first
    whole, excluded_words = first.search.design, first.search.excluded_words
    whole = with_refined(whole, refine_events_beside(whole, first.best.chosen))
    among = SubsetSearch(with_groups(whole, first.best), excluded_words, is_last=True)
    best = max([*among.run()[:1], first.best], key=lambda fitted: fitted.score)
    among, best = with_refined_settings(among, best)
    return replace(first, search=among, best=among.fit(best.chosen))
