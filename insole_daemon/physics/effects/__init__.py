"""What the sensor does to a load, one effect a file.

Each module here has one LAW (`physics.law`): the word, the place on the signal path, the domain and the equation of
the format's table of laws, the parameters with unit, bounds, prior and meaning, the source, a `forward` that makes
the operator which does to a load what the effect does, and an `inverse` that undoes it causally, or None and a
sentence why. A file that is added here is an effect that is known everywhere; nothing else need change.

    law.py               Law, Parameter, and what an operator is given
    effect.py            Effect: a law with values, at work somewhere on an insole
    effects_document.py  effects out of and into the JSON of insole-calibration/1
    chain.py             Chain: any effects, in the order of the signal path; forward and inverse

    chain = Chain(effects, layout, calibration)
    counts = chain.forward()(load_pa, t_s)       what is read, on average; a whole recording, or …
    compensate = chain.inverse()                 … one sample after the other: the same numbers
    load_pa = compensate(counts, t_s)

The chain is the load's way: place (1), Pa (2 to 7), the static curve (7), activation (7, 8), count (9, 10). Without a
calibration it ends before the curve, and gives effective pressure. Neither noise nor the digitiser of a board that
works as it is believed to is part of it.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from ..law import Law


@cache
def laws() -> dict[str, Law]:
    """Every law by its word, in the order of the signal path."""
    modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
    found: list[Law] = [module.LAW for module in modules]
    return {law.word: law for law in sorted(found, key=lambda law: (law.order is None, law.order, law.word))}
