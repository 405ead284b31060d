"""Many taxels into few mixtures that hold all they have in common; what is left out is noise.

Where the load is the same everywhere, taxels differ in a handful of curves. The leading singular vectors hold those,
and scoring them is scoring every taxel. Components below the edge that noise alone reaches (Marchenko & Pastur; Gavish
& Donoho, IEEE Trans. Inf. Theory 60 (2014) 5040) are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from ..skin.geometry import N_TAXELS
from .fit import Evidence
from .floor import noise_of_blocks
from .observed import Observed

MOST_COMPONENTS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Taxels:
    """Some taxels of one insole in its recordings, to be explained."""

    observed: tuple[Observed, ...]
    slots: NDArray[np.intp]  # (m,)
    noise_count: Array  # (m,) of a reading

    def some(self, columns: NDArray[np.intp] | NDArray[np.bool_]) -> Taxels:
        """The taxels `columns` of them."""
        return Taxels(self.observed, self.slots[columns], self.noise_count[columns])

    def at(self, slots: NDArray[np.intp]) -> Taxels:
        """Those of them with these slots."""
        return self.some(np.searchsorted(self.slots, slots))

    @property
    def boards(self) -> NDArray[np.uint8]:
        """(m,) address of the board of each."""
        found: NDArray[np.uint8] = self.observed[0].layout.identities[:, 0][self.slots // N_TAXELS]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Some taxels of all recordings, as evidence."""

    slots: NDArray[np.intp]  # (m,)
    evidence: Evidence  # r mixtures
    taxels: Evidence  # each of the m taxels, in units of its noise
    floor: float  # mean square of the evidence's noise
    floors: Array  # (m,) mean square of each taxel's noise, of a block

    def per_taxel(self, mean_square: float) -> float:
        """A mean square of the mixtures as one of the taxels."""
        return float(mean_square * self.evidence.y.shape[1] / len(self.slots))


def gather(taxels: Taxels, jumps: Array) -> Group:
    """The `taxels`, in units of their noise; `jumps` (n, j) the columns of what happened once."""
    observed, slots, found = taxels.observed, taxels.slots, []
    for each in observed:
        column = np.searchsorted(each.slots, slots)
        found.append(-each.count[:, column] / taxels.noise_count)
    y = np.concatenate(found)
    floors = np.mean([noise_of_blocks(part) ** 2 for part in found], axis=0)
    centred = y - y.mean(axis=0)
    left, size, _ = np.linalg.svd(centred, full_matrices=False)
    n, m = y.shape
    edge = np.sqrt(np.median(floors) * n) * (1 + np.sqrt(m / n)) * 1.03
    r = int(np.clip(np.count_nonzero(size > edge), 1, MOST_COMPONENTS))
    mixed = left[:, :r] * size[:r]
    ends = np.cumsum([len(part) for part in found])
    floor = float(np.mean([np.mean(noise_of_blocks(part) ** 2) for part in np.split(mixed, ends[:-1])]))
    evidence = Evidence(observed, mixed, jumps)
    return Group(slots, evidence, evidence.of(y), floor, floors)
