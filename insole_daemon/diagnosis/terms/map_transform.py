"""`map_transform`: the insole lies turned, scaled or shifted against its map: moments change, f_z does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.load_field import Move
from ..observations.paired import PairedObservation
from .term import Setting, Term, TermColumns, in_means

# What is moved, the step a slope is taken over, and what a share of 1 is.
MOVES = (("x_mm", 1.0, 1.0), ("y_mm", 1.0, 1.0), ("rotation_deg", 1.0, 1.0), ("log_scale", 0.02, 0.01))
CENTRE = 3  # the taxel in the middle of a triangle


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Four joint columns: 1 mm forward, 1 mm to the left, 1 degree counter-clockwise, 1 % larger."""
    seen = load.observation
    if isinstance(seen, PairedObservation):
        return [_of_field(seen, load)]
    xy = seen.layout.xy_m
    pivot = xy[:, CENTRE].mean(axis=0)
    dx, dy = np.moveaxis(xy - pivot, -1, 0)
    turn = np.deg2rad(1.0)
    moves = [
        (np.full_like(dx, 1e-3), np.zeros_like(dx)),
        (np.zeros_like(dx), np.full_like(dx, 1e-3)),
        (-dy * turn, dx * turn),
        (dx * 0.01, dy * 0.01),
    ]
    force = load.pressure_pa * seen.arms[..., 0]
    found = []
    for x, y in moves:
        m_x, m_y = np.einsum("ntk,tk->n", force, y), -np.einsum("ntk,tk->n", force, x)
        found.append(np.stack([np.zeros_like(m_x), m_x, m_y], axis=1))
    return [TermColumns(({},) * 4, whole=np.stack(found, axis=-1), joint=True)]


def _of_field(seen: PairedObservation, load: LoadEstimate) -> TermColumns:
    """Of loads with places: what taxels that lie elsewhere feel, at the slope between steps both ways."""
    assert seen.field is not None
    rows = np.arange(len(seen.layout))
    found, moved_pa = [], np.zeros_like(load.pressure_pa)
    for name, step, scale in MOVES:
        ahead, behind = (seen.field.moved(Move(**{name: side * step}), rows) for side in (0.5, -0.5))
        slope = replace(seen.field, shapes=(behind.shapes - ahead.shapes) * (scale / step))
        own_pa = slope.at(seen.reference_s)
        moved_pa += own_pa
        found.append(load.wrench_of(own_pa))
    shown = in_means(load, moved_pa)
    return TermColumns(({},) * 4, by_triangle=np.stack(found, axis=-1), joint=True, in_means=shown)


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Shift in mm, rotation in degrees, scale."""
    x, y, turn, larger = (float(share) for share in shares)
    return {"x_mm": x, "y_mm": y, "rotation_deg": turn, "scale": 1.0 + 0.01 * larger}


def _needs(load: LoadEstimate) -> str | None:
    """Why a recording cannot show it."""
    return "a uniform load has no place" if load.observation.is_uniform else None


TERM = Term(
    word="map_transform",
    scopes=("insole",),
    share="free",
    columns=_columns,
    parameters=_parameters,
    needs=_needs,
    limit=30.0,  # mm, degrees and per cent
    record_instead="walking or standing with a force shoe",
)
