"""The finding on curves that are off by more than a memory that was at work in the calibration."""

from __future__ import annotations

import numpy as np

from ..physics.effect import Where
from ..physics.effects import laws
from . import sentences
from .finding import Finding, Quantity, heldout_of
from .model.blocks import BlockDesign
from .model.refine import Refined
from .select.static_part import static_part
from .select.wrench_figures import Figures

CONFIDENCE = 0.7  # nothing but the law of the memory says how much of it the calibration contains


def static_findings(refined: Refined[BlockDesign], found: Figures) -> list[Finding]:
    """What is said of curves that were refitted beside the memories of `refined`; empty where they say no more.

    The model has these curves, and so no effect for it.
    """
    part, seen = static_part(refined), refined.design.seen
    if part is None:
        return []
    units = {each.name: each.unit for each in laws()[part.word].parameters}
    parameters = {
        name: Quantity(value, part.std * abs(value - (name == "gain")), units[name])
        for name, value in part.values.items()
    }
    sentence = sentences.of_effect(part.word, Where(), parameters)
    return [
        Finding(
            effect=part.word, foot=seen.layout.foot, where=Where(), equation=laws()[part.word].equation,
            recordings=(seen.name,), parameters=parameters, explains=part.square, confidence=CONFIDENCE,
            sentence=f"{sentence} The calibration contains a part of the memory, so its share is a guess.",
            **heldout_of(True, float(np.sqrt(found.after[0] ** 2 + part.square)), float(found.after[0])),
        )
    ]  # fmt: skip
