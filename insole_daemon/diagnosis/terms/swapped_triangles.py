"""`swapped_triangles`: two triangles report under each other's identity, so each load acts at the other's place."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.paired import PairedObservation
from .term import Setting, Term, TermColumns

MOST_PAIRS = 12  # candidates, if the load of each triangle is known


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return a column for each pair: the wrench with places exchanged, minus the wrench."""
    seen = load.observation
    if isinstance(seen, PairedObservation):
        return _of_field(seen, load)
    area = seen.layout.taxel_area_m2
    xy = seen.layout.xy_m
    full = area * np.stack([np.ones(xy.shape[:2]), xy[..., 1], -xy[..., 0]], axis=-1)
    identities, pressure_pa = seen.layout.identities.tolist(), seen.pressure_pa
    columns, settings, places = [], [], []
    for first, second in combinations(range(len(identities)), 2):
        if not (seen.usable[first].any() and seen.usable[second].any()):
            continue
        change_by_first = np.einsum(
            "nk,kc->nc", pressure_pa[:, first], (full[second] - full[first]) * seen.usable[first][:, None]
        )
        change_by_second = np.einsum(
            "nk,kc->nc", pressure_pa[:, second], (full[first] - full[second]) * seen.usable[second][:, None]
        )
        columns.append(change_by_first + change_by_second)
        settings.append({"first": float(first), "second": float(second)})
        places.append((tuple(identities[first]), tuple(identities[second])))
    return [TermColumns(tuple(settings), whole=np.stack(columns, axis=-1), places=tuple(places))]


def _of_field(seen: PairedObservation, load: LoadEstimate) -> list[TermColumns]:
    """Return the columns of a simulated trial, for the MOST_PAIRS pairs that fit the readings best when exchanged."""
    expected_pa, read_pa = seen.reference.at(seen.reference_s), seen.wrench
    variance = seen.weight_variance
    weight = np.where(np.isfinite(variance), 1.0 / variance, 0.0)
    # (T, T) sum of squares of a triangle's readings minus the load of another.
    residual_sum = (
        np.sum(weight * read_pa**2, axis=0)[:, None] - 2.0 * (weight * read_pa).T @ expected_pa
        + weight.T @ expected_pa**2
    )  # fmt: skip
    gain = np.diag(residual_sum)[:, None] - residual_sum
    gain_of_pair = gain + gain.T
    working = np.flatnonzero(seen.usable.any(axis=1)).tolist()
    pairs = sorted(combinations(working, 2), key=lambda pair: -gain_of_pair[pair])[:MOST_PAIRS]
    identities, pressure = seen.layout.identities.tolist(), load.pressure_pa
    settings, columns, places = [], [], []
    for first, second in pairs:
        change_pa = np.zeros_like(pressure)
        change_pa[:, first] = pressure[:, first] - pressure[:, second]
        change_pa[:, second] = -change_pa[:, first]
        columns.append(load.wrench_of(change_pa)[..., 0])
        settings.append({"first": float(first), "second": float(second)})
        places.append((tuple(identities[first]), tuple(identities[second])))
    n_pairs = len(working) * (len(working) - 1) // 2
    by_triangle = np.stack(columns, axis=-1)[:, :, None]
    return [TermColumns(tuple(settings), by_triangle=by_triangle, places=tuple(places), n_searched=n_pairs)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return no parameters: the pair is the place of the finding."""
    return {}


def _needs(load: LoadEstimate) -> str | None:
    """Return the reason why a recording cannot show the effect."""
    if load.observation.is_uniform:
        return "a uniform load is the same on both triangles of a pair"
    return "a single triangle works" if np.count_nonzero(load.observation.usable.any(axis=1)) < 2 else None


TERM = Term(
    word="swapped_triangles",
    scopes=("triangle",),
    share="whole",
    columns=_columns,
    parameters=_parameters,
    needs=_needs,
    record_instead="walking or standing with a force shoe",
)
