"""Held-out errors of a refined set, whether the load of every taxel is known or only the wrench."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..model.blocks import BlockDesign
from ..model.refine import Refined
from ..model.regression import Timing
from .count_errors import count_errors
from .wrench_errors import HeldoutErrors, wrench_errors


def heldout_errors(refined: Refined[Any], order: Sequence[int], timing: Timing) -> HeldoutErrors:
    """Return the held-out errors of a refined set: in counts if the load of every taxel is known, else of the wrench.

    Its candidates are added in `order`.
    """
    if isinstance(refined.design, BlockDesign):
        return count_errors(refined, order)
    return wrench_errors(refined.design, refined, order, timing)
