"""Colours that people with any colour vision can tell apart, on white and on black.

Categories are those of Okabe & Ito (2008), without their black and yellow; magnitudes the map viridis (van der Walt &
Smith 2015), which is perceptually uniform and whose order anybody sees. The live page has the same ones.
"""

from __future__ import annotations

import numpy as np

# Of a page on white; the page has others for the dark.
LIGHT = {
    "paper": "#ffffff", "ink": "#1c2430", "soft": "#5b6675", "rule": "#d8dde4", "quiet": "#b6bec9", "panel": "#f6f8fa",
}  # fmt: skip
CATEGORIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")

# viridis at 0, 1/8, …, 1
MAGNITUDES = np.array([
    (68, 1, 84), (71, 45, 123), (59, 82, 139), (44, 114, 142), (33, 145, 140),
    (40, 174, 128), (94, 201, 98), (173, 220, 48), (253, 231, 37),
], float)  # fmt: skip


def category(number: int) -> str:
    """A colour for SVG; a page may have another one for the dark, as --c0, --c1, …"""
    at = number % len(CATEGORIES)
    return f"var(--c{at}, {CATEGORIES[at]})"


def magnitude(share: float) -> str:
    """The colour of 0 (dark) to 1 (bright)."""
    at = float(np.clip(share, 0.0, 1.0)) * (len(MAGNITUDES) - 1)
    parts = [round(float(np.interp(at, np.arange(len(MAGNITUDES)), channel))) for channel in MAGNITUDES.T]
    return "#{:02x}{:02x}{:02x}".format(*parts)
