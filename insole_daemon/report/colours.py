"""Colours that can be distinguished with any colour vision, on white and on black.

Categories are those of Okabe & Ito (2008), without their black and yellow. Magnitudes use the perceptually uniform map
viridis (van der Walt & Smith 2015). The live page uses the same colours.
"""

from __future__ import annotations

import numpy as np

# Colours of a page in light mode; the page defines others for dark mode.
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
    """Return a colour for SVG; a page may redefine it for dark mode as --c0, --c1, …"""
    index = number % len(CATEGORIES)
    return f"var(--c{index}, {CATEGORIES[index]})"


def magnitude(share: float) -> str:
    """Return the colour of a magnitude from 0 (dark) to 1 (bright)."""
    position = float(np.clip(share, 0.0, 1.0)) * (len(MAGNITUDES) - 1)
    rgb = [round(float(np.interp(position, np.arange(len(MAGNITUDES)), channel))) for channel in MAGNITUDES.T]
    return "#{:02x}{:02x}{:02x}".format(*rgb)
