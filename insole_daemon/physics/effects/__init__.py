"""The effects, one per file.

Each module defines one LAW (`physics.law`): its word, position on the signal path, domain and equation from the
format's table of laws; parameters with unit, bounds, prior and meaning; source; a `forward` that makes the operator
from load to effective load; and a causal `inverse`, or None with the reason. A file added here is known everywhere;
nothing else needs to change.

    law.py               Law, Parameter, and the interface of operators
    effect.py            Effect: a law with values, applied to a part of an insole
    effects_document.py  effects as the JSON of insole-calibration/1
    chain.py             Chain: any effects, in the order of the signal path; forward and inverse

    chain = Chain(effects, layout, calibration)
    counts = chain.forward()(load_pa, t_s)       mean counts; for a whole recording, or …
    compensate = chain.inverse()                 … one sample after the other with the same numbers
    load_pa = compensate(counts, t_s)

The chain follows the load's path: position (1), Pa (2 to 7), static curve (7), activation (7, 8), count (9, 10).
Without a calibration it ends before the curve and gives effective pressure. It contains neither noise nor the digitiser
of a correctly configured board.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from ..law import Law


@cache
def laws() -> dict[str, Law]:
    """Return every law by its word, in the order of the signal path."""
    modules = (importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__))
    known: list[Law] = [module.LAW for module in modules]
    return {law.word: law for law in sorted(known, key=lambda law: (law.order is None, law.order, law.word))}
