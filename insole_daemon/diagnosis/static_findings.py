"""The findings on static curves that deviate by more than the mean curve of a memory explains."""

from __future__ import annotations

import numpy as np

from ..physics.effects import laws
from ..skin.geometry import N_TAXELS
from . import sentences
from .finding import Finding, Quantity, heldout_of
from .model.blocks import BlockDesign
from .model.refine import Refined
from .select.static_part import StaticPart, static_part, static_part_of_board
from .select.wrench_errors import HeldoutErrors

CONFIDENCE = 0.7  # the part of the memory that the calibration contains is estimated from the memory's law


def static_findings(refined: Refined[BlockDesign], figures: HeldoutErrors) -> list[Finding]:
    """Return the findings on curves that were refitted together with the memories of `refined`.

    There may be one of the insole and one of a board. The exported model contains these curves, so it has no effect for
    the findings. An effect smaller than the lack of fit at its place may be a part of it; one larger than the whole
    mismatch would cancel another.
    """
    lack_of_fit, mismatch = float(figures.after[0] ** 2 - figures.floor[0] ** 2), float(figures.before[0] ** 2)
    parts = [part for part in (static_part(refined), static_part_of_board(refined)) if part is not None]
    layout = refined.design.seen.layout
    shares = [len(part.where.slots(layout)) / (len(layout) * N_TAXELS) for part in parts]  # of the insole
    return [
        _finding(part, refined, figures)
        for part, share in zip(parts, shares, strict=True)
        if share * lack_of_fit < part.square < mismatch
    ]


def _finding(part: StaticPart, refined: Refined[BlockDesign], figures: HeldoutErrors) -> Finding:
    seen, law = refined.design.seen, laws()[part.word]
    units = {parameter.name: parameter.unit for parameter in law.parameters}
    parameters = {
        name: Quantity(value, part.std * abs(value - (name == "gain")), units[name])
        for name, value in part.values.items()
    }
    sentence = sentences.of_effect(part.word, part.where, parameters)
    return Finding(
        effect=part.word, foot=seen.layout.foot, where=part.where, equation=law.equation,
        recordings=(seen.name,), parameters=parameters, explains=part.square, confidence=CONFIDENCE,
        sentence=f"{sentence} The calibration contains a part of the memory, so its share is a guess.",
        **heldout_of(True, float(np.sqrt(figures.after[0] ** 2 + part.square)), float(figures.after[0])),
    )  # fmt: skip
