"""Peak and mean pressure of every cycle: of the whole sole, and of each region."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .region_map import RegionMap


def region_pressures(
    pressure_pa: NDArray[np.floating], valid: NDArray[np.bool_], regions: RegionMap, names: Sequence[str]
) -> dict[tuple[str, str], NDArray[np.float64]]:
    """Return pressures (n,) in Pa by region and statistic; the region "" is the whole sole, then come `names`.

    `pressure_pa` and `valid` are (n, n_triangles, 12). "peak" is the highest pressure of a valid taxel, "mean" the mean
    of the valid taxels, loaded or not. NaN: the region has no valid taxel in that cycle, or `regions` does not have it.
    """
    usable = valid & np.isfinite(pressure_pa)
    pressures = {}
    for name in ("", *names):
        if name and name not in regions.names:
            of_region = np.zeros(valid.shape[1:], np.bool_)
        else:
            of_region = regions.of_taxel == regions.names.index(name) if name else np.ones(valid.shape[1:], np.bool_)
        taxel_pa, is_usable = pressure_pa[:, of_region].astype(np.float64), usable[:, of_region]
        n_usable = np.count_nonzero(is_usable, axis=1)
        peak = np.max(taxel_pa, axis=1, where=is_usable, initial=-np.inf)
        total = np.sum(taxel_pa, axis=1, where=is_usable)
        pressures[name, "peak"] = np.where(n_usable > 0, peak, np.nan)
        pressures[name, "mean"] = np.where(n_usable > 0, total / np.maximum(n_usable, 1), np.nan)
    return pressures
