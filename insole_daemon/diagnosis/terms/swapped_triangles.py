"""`swapped_triangles`: two triangles report under each other's identity: their loads act at the other's place."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.paired import PairedObservation
from .term import Setting, Term, TermColumns

MOST_PAIRS = 12  # that are looked at closely, where readings tell each triangle's load


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """A column for each pair: the wrench with places exchanged less the wrench."""
    seen = load.observation
    if isinstance(seen, PairedObservation):
        return _of_field(seen, load)
    area = seen.layout.taxel_area_m2
    xy = seen.layout.xy_m
    full = area * np.stack([np.ones(xy.shape[:2]), xy[..., 1], -xy[..., 0]], axis=-1)
    identities = seen.layout.identities.tolist()
    found, settings, places = [], [], []
    for first, second in combinations(range(len(identities)), 2):
        if not (seen.usable[first].any() and seen.usable[second].any()):
            continue
        there = np.einsum(
            "nk,kc->nc", seen.pressure_pa[:, first], (full[second] - full[first]) * seen.usable[first][:, None]
        )
        back = np.einsum(
            "nk,kc->nc", seen.pressure_pa[:, second], (full[first] - full[second]) * seen.usable[second][:, None]
        )
        found.append(there + back)
        settings.append({"first": float(first), "second": float(second)})
        places.append((tuple(identities[first]), tuple(identities[second])))
    return [TermColumns(tuple(settings), whole=np.stack(found, axis=-1), places=tuple(places))]


def _of_field(seen: PairedObservation, load: LoadEstimate) -> list[TermColumns]:
    """Of loads with places: those pairs that come nearest to what is read, each under the other's load."""
    said, read = seen.reference.at(seen.reference_s), seen.wrench
    variance = seen.weight_variance
    weight = np.where(np.isfinite(variance), 1.0 / variance, 0.0)
    # (T, T) squares left of what is read under the load of another.
    left = (
        np.sum(weight * read**2, axis=0)[:, None] - 2.0 * (weight * read).T @ said + weight.T @ said**2
    )  # fmt: skip
    better = np.diag(left)[:, None] - left
    both = better + better.T
    works = np.flatnonzero(seen.usable.any(axis=1)).tolist()
    pairs = sorted(combinations(works, 2), key=lambda pair: -both[pair])[:MOST_PAIRS]
    identities, pressure = seen.layout.identities.tolist(), load.pressure_pa
    settings, columns, places = [], [], []
    for first, second in pairs:
        apart = np.zeros_like(pressure)
        apart[:, first] = pressure[:, first] - pressure[:, second]
        apart[:, second] = -apart[:, first]
        columns.append(load.wrench_of(apart)[..., 0])
        settings.append({"first": float(first), "second": float(second)})
        places.append((tuple(identities[first]), tuple(identities[second])))
    searched = len(works) * (len(works) - 1) // 2
    found = np.stack(columns, axis=-1)[:, :, None]
    return [TermColumns(tuple(settings), by_triangle=found, places=tuple(places), n_searched=searched)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """The pair stands in `where`."""
    return {}


def _needs(load: LoadEstimate) -> str | None:
    """Why a recording cannot show it."""
    return "a uniform load is the same on both" if load.observation.is_uniform else None


TERM = Term(
    word="swapped_triangles",
    scopes=("triangle",),
    share="whole",
    columns=_columns,
    parameters=_parameters,
    needs=_needs,
    record_instead="walking or standing with a force shoe",
)
