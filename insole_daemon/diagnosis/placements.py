"""Places of taxels beside a simulated trial: triangles in each other's places, and an insole displaced on its map."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..physics.effect import Where
from ..recording.loading import FootRecording
from .finding import Quantity
from .load_estimate import KnownLoad
from .model.blocks import BlockDesign, block_design
from .model.refine import refine
from .observations.load_field import Move
from .observations.paired import PairedObservation, swapped_rows
from .observations.reading_faults import ReadingFaults, reading_faults
from .observations.wrench import WrenchObservation
from .parameters import MISFIT_OF, parameters_of, with_misfit
from .select.displacement import fit_displacement
from .select.search import FittedSet, SubsetSearch

LEAST_EXPLAINED = 0.5  # by a displacement that is fitted before the search: of the residual beyond the noise
SWAPPED, ASKEW = "swapped_triangles", "map_transform"


@dataclass(frozen=True, slots=True, eq=False)
class FittedPlacement:
    """A selected term for the places of taxels: swapped triangles, or a shift, turn and scale of the insole.

    The simulated load is computed at these places.
    """

    word: str
    where: Where
    parameters: dict[str, Quantity]
    margin: float  # loss of score without it, in least gains
    penalty: float


@dataclass(frozen=True, slots=True, eq=False)
class Placements:
    """All placements that were fitted so far, and the displacement that they add up to."""

    move: Move = field(default_factory=Move)
    fitted: tuple[FittedPlacement, ...] = ()

    def applied_to(self, seen: PairedObservation) -> PairedObservation:
        """Return `seen` against the simulated load at these places."""
        swaps = [placement.where.ids for placement in self.fitted if placement.word == SWAPPED]
        return seen.replaced(self.move, [swapped_rows(seen.layout.identities, ids) for ids in swaps])

    def with_selected(self, search: SubsetSearch[BlockDesign], best: FittedSet, foot: FootRecording) -> Placements:
        """Return them with those of the set `best`, which was selected under the load at the present places."""
        refined, move = refine(search.design, best.chosen), self.move
        fitted = {(placement.word, placement.where): placement for placement in self.fitted}
        for i, (k, candidate) in enumerate(zip(best.chosen, refined.design.candidates, strict=True)):
            if candidate.word not in (SWAPPED, ASKEW):
                continue
            parameters, place = parameters_of(refined, i, foot), (candidate.word, candidate.where)
            if candidate.word == ASKEW:
                move = move.further(**{name: float(quantity.value) for name, quantity in parameters.items()})
                parameters = {name: _of_whole(name, quantity, move) for name, quantity in parameters.items()}
            known = fitted.get(place)
            fitted[place] = FittedPlacement(
                candidate.word, candidate.where, parameters,
                search.margin(best, i) if known is None else known.margin,
                search.penalties.term_penalty(k, candidate, refined.design.candidates),
            )  # fmt: skip
        return Placements(move, tuple(fitted.values()))


def _of_whole(name: str, of_step: Quantity, move: Move) -> Quantity:
    """Return a parameter of the whole displacement `move`, with the standard deviation of that of its last step."""
    value = move.parameters[name]
    return replace(of_step, value=value, std=with_misfit(name, value, of_step.std, MISFIT_OF[ASKEW]))


def faults_and_displacement(foot: FootRecording, seen: WrenchObservation) -> tuple[ReadingFaults, Placements]:
    """Return the faults of the readings of `foot`, and beside a simulation a displacement that is clear by itself.

    The faults are those under the load at the displaced places. Raises DiagnosisError as `reading_faults`.
    """
    faults = reading_faults(foot, seen)
    if not isinstance(faults.observation, PairedObservation):
        return faults, Placements()
    placements = _clear_displacement(faults.observation, faults, foot)
    if placements.fitted:
        assert isinstance(seen, PairedObservation)
        faults = reading_faults(foot, placements.applied_to(seen))
    return faults, placements


def _clear_displacement(seen: PairedObservation, faults: ReadingFaults, foot: FootRecording) -> Placements:
    """Return the displacement of the insole if it explains most of the residual by itself, else no placement."""
    displacement = fit_displacement(seen, faults.weights_of(seen))
    if displacement.explained < LEAST_EXPLAINED:
        return Placements()
    search = SubsetSearch(block_design(KnownLoad(seen), faults.weights_of(seen)))
    best = max(search.singles(), key=lambda fitted: fitted.score, default=search.fit(()))
    if [search.design.candidates[k].word for k in best.chosen] != [ASKEW]:
        return Placements()
    placements = replace(Placements().with_selected(search, best, foot), move=displacement.move)
    moved = placements.applied_to(seen)
    search = SubsetSearch(block_design(KnownLoad(moved), faults.weights_of(moved)))
    last_step = [k for k, candidate in enumerate(search.design.candidates) if candidate.word == ASKEW]
    return placements.with_selected(search, search.fit(last_step), foot)
