"""Regions of the sole from a file, `insole-regions/1`; without one, heel, midfoot, metatarsals, hallux and toes.

Gait events keep the four regions of regions.py, which a message names.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..documents import Limit, Reading, Section, at_least, matching, read, within
from ..errors import DocumentError, Problem
from ..skin.geometry import PRESSURE_TAXELS
from ..skin.layout import Layout

FORMAT = "insole-regions/1"
BUILTIN = Path(__file__).with_name("regions-anatomical.yaml")
FEWEST_TAXELS = 3  # of a region: what fewer of them read is no region's pressure

Fraction = Annotated[float, within(0.0, 1.0)]
Span = Annotated[tuple[Fraction, ...], Limit(" of 2, the first less", lambda v: len(v) == 2 and v[0] < v[1])]


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionSpan(Section):
    """One region: the part of the sensed area's length and, within that, of its width."""

    name: Annotated[str, matching(r"[a-z][a-z0-9_]*", "a word of a–z, 0–9 and _")]
    along: Span  # 0 rearmost taxel … 1 foremost
    across: Span  # 0 medial … 1 lateral


@dataclass(frozen=True, slots=True, kw_only=True)
class _File(Section):
    regions: Annotated[tuple[RegionSpan, ...], at_least(1)]


@dataclass(frozen=True, slots=True, eq=False)
class RegionMap:
    """The regions of one layout."""

    names: tuple[str, ...]
    of_taxel: NDArray[np.int8]  # (n_triangles, 12) number in `names`, -1: of none
    too_small: tuple[str, ...]  # regions that this layout has fewer than FEWEST_TAXELS of


def load_regions(path: str | PathLike[str] = BUILTIN) -> tuple[RegionSpan, ...]:
    """Return the regions in the file `path`; DocumentError lists all that is wrong with it."""
    return read(path, _File, FORMAT, _check).regions


def map_regions(regions: tuple[RegionSpan, ...], layout: Layout) -> RegionMap:
    """Return which taxel of `layout` is in which region; DocumentError where two of them share a taxel."""
    lateral = 1.0 if layout.foot == "left" else -1.0  # y points to the wearer's left on both feet
    x, y = layout.xy_m[..., 0], lateral * layout.xy_m[..., 1]
    along = _fraction(x, np.broadcast_to(PRESSURE_TAXELS, x.shape))
    of_taxel = np.full(x.shape, -1, np.int8)
    too_small = []
    for number, region in enumerate(regions):
        band = _within(along, region.along) & PRESSURE_TAXELS
        inside = band & _within(_fraction(y, band), region.across) if band.any() else band
        if np.any(of_taxel[inside] >= 0):
            other = regions[int(of_taxel[inside].max())].name
            message = f"expected regions apart from each other, found taxels of both {other} and {region.name}"
            raise DocumentError(FORMAT, [Problem(None, "regions", message)])
        if np.count_nonzero(inside) < FEWEST_TAXELS:
            too_small.append(region.name)
        else:
            of_taxel[inside] = number
    return RegionMap(tuple(region.name for region in regions), of_taxel, tuple(too_small))


def _check(reading: Reading) -> None:
    names = Counter(region.name for _, region in reading.of(RegionSpan))
    for name, count in names.items():
        if count > 1:
            reading.problem(("regions",), f"expected each region once, found {name} {count} times")


def _fraction(values: NDArray[np.float64], among: NDArray[np.bool_]) -> NDArray[np.float64]:
    low, high = float(values[among].min()), float(values[among].max())
    return (values - low) / (high - low) if high > low else np.zeros_like(values)


def _within(fraction: NDArray[np.float64], span: tuple[float, ...]) -> NDArray[np.bool_]:
    """Return which of `fraction` lie in [start, end) of `span`; the end 1 belongs to it."""
    ends_everything = span[1] == 1.0
    inside: NDArray[np.bool_] = (fraction >= span[0]) & ((fraction < span[1]) | (ends_everything & (fraction == 1.0)))
    return inside
