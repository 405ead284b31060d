"""Gait: events while they happen (events.py), and the analysis of a recording (every other module).

The live path imports `Gait` and `GaitEvent`. The analysis goes: contacts → figures → labels → a `Steps` table → curves,
symmetry and comparison. docs/gait.md has every definition with its source.
"""

from .events import Gait, GaitEvent

__all__ = ["Gait", "GaitEvent"]
