"""The physics that a diagnosis may find, one candidate a file; a file that is added here is searched for.

Each module has a function `candidate(excitation)`, which lays out parameters, bounds and starts for the recordings
at hand.
"""

from __future__ import annotations

import importlib
import pkgutil

from ..candidate import Candidate, Excitation


def candidates(excitation: Excitation) -> dict[str, Candidate]:
    """Every candidate by its word, in the order of the signal path."""
    modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
    found: list[Candidate] = [module.candidate(excitation) for module in modules]
    return {each.word: each for each in sorted(found, key=lambda each: (each.order, each.word))}
