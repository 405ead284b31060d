"""`swapped_triangles`: two triangles report under each other's identity: their loads act at the other's place."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ...physics.law import Array
from ..model.load import LoadEstimate
from .term import Setting, Term, TermColumns


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """A column for each pair: the wrench with places exchanged less the wrench."""
    seen = load.observation
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
)
