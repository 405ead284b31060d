"""The findings on static curves that deviate by more than the mean curve of a memory explains."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..physics.effects import laws
from ..skin.geometry import N_TAXELS
from . import sentences
from .finding import Finding, Quantity, heldout_of
from .model.blocks import RECALIBRATIONS, BlockDesign
from .model.refine import Refined
from .parameters import with_misfit
from .select.block_penalties import MOST_SQUARE
from .select.static_part import StaticPart, static_part, static_part_of_board
from .select.wrench_errors import HeldoutErrors

CONFIDENCE = 0.7  # the part of the memory that the calibration contains is estimated from the memory's law


def static_findings(refined: Refined[Any], figures: HeldoutErrors) -> tuple[list[Finding], tuple[str, ...]]:
    """Return the findings on curves that were refitted together with the memories of `refined`.

    There may be one of the insole and, with loose curves, one of a board. The exported model contains these curves, so
    it has no effect for the findings. An effect smaller than the lack of fit at its place may be a part of it.

    Also returns the words of static effects that the curves may have taken up without a finding.
    """
    if not (isinstance(refined.design, BlockDesign) and refined.design.seen.is_uniform):
        return [], ()
    is_loose = refined.design.priors.has_loose_curves
    if not (refined.design.candidates and (is_loose or _leaves_static_to_companions(refined.design))):
        return [], RECALIBRATIONS if is_loose else ()
    lack_of_fit, mismatch = float(figures.after[0] ** 2 - figures.floor[0] ** 2), float(figures.before[0] ** 2)
    of_insole, is_off = static_part(refined)
    parts = [of_insole]
    if is_loose:  # usual curves leave those of a board to the search
        parts.append(static_part_of_board(refined))
    layout = refined.design.seen.layout

    def share(part: StaticPart) -> float:
        """Return the share of the insole that an effect is at."""
        return len(part.where.slots(layout)) / (len(layout) * N_TAXELS)

    findings = [
        _finding(part, refined, figures)
        for part in parts
        if part is not None and share(part) * lack_of_fit < part.square < MOST_SQUARE * mismatch
    ]
    taken_up = RECALIBRATIONS if is_loose else ("gain",) if is_off else ()
    return findings, taken_up


def _leaves_static_to_companions(design: BlockDesign) -> bool:
    """Return whether companions of a set may have taken up a static effect of the whole insole.

    Those of a memory of the whole insole may. But curves that were fitted to the recording itself leave no such effect,
    and a simulated load that may be off hides one.
    """
    of_insole = [candidate for candidate in design.candidates if candidate.where.scope == "insole"]
    has_memory = any(candidate.term.is_memory for candidate in of_insole)
    has_static = any(candidate.word in RECALIBRATIONS for candidate in of_insole)
    return has_memory and not (has_static or design.seen.has_own_curves or design.priors.share)


def _finding(part: StaticPart, refined: Refined[BlockDesign], figures: HeldoutErrors) -> Finding:
    seen, law = refined.design.seen, laws()[part.word]
    units = {parameter.name: parameter.unit for parameter in law.parameters}
    parameters = {
        name: Quantity(value, with_misfit(name, value, part.std * abs(value - (name == "gain"))), units[name])
        for name, value in part.values.items()
    }
    sentence = sentences.of_effect(part.word, part.where, parameters)
    return Finding(
        effect=part.word, foot=seen.layout.foot, where=part.where, equation=law.equation,
        recordings=(seen.name,), parameters=parameters, explains=part.square, confidence=CONFIDENCE,
        sentence=f"{sentence} The calibration may contain a part of the memory, so its size is uncertain.",
        **heldout_of(True, float(np.sqrt(figures.after[0] ** 2 + part.square)), float(figures.after[0])),
    )  # fmt: skip
