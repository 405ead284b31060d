"""Colours that people with any colour vision can tell apart, on white and on black.

Categories are those of Okabe & Ito (2008), without their black and yellow; magnitudes the map cividis (Nuñez, Anderton
& Renslow 2018), which is perceptually uniform and reads the same with deuteranopia.
"""

from __future__ import annotations

import numpy as np

CATEGORIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")

# cividis at 0, 1/8, …, 1
_CIVIDIS = np.array([
    (0, 34, 78), (18, 53, 112), (59, 73, 108), (87, 93, 109), (112, 113, 115),
    (138, 134, 120), (165, 156, 116), (195, 179, 105), (254, 232, 56),
], float)  # fmt: skip


def category(number: int) -> str:
    """A colour for SVG; a page may have another one for the dark, as --c0, --c1, …"""
    at = number % len(CATEGORIES)
    return f"var(--c{at}, {CATEGORIES[at]})"


def magnitude(share: float) -> str:
    """The colour of 0 (dark) to 1 (bright)."""
    at = float(np.clip(share, 0.0, 1.0)) * (len(_CIVIDIS) - 1)
    parts = [round(float(np.interp(at, np.arange(len(_CIVIDIS)), channel))) for channel in _CIVIDIS.T]
    return "#{:02x}{:02x}{:02x}".format(*parts)
