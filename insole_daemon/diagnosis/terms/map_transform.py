"""`map_transform`: the insole is rotated, scaled or shifted relative to its layout: moments change, f_z does not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.load_field import Move
from ..observations.paired import PairedObservation
from .term import Setting, Term, TermColumns, in_means

# Name of a movement, the step of its finite difference, and the movement for a share of 1.
MOVES = (("x_mm", 1.0, 1.0), ("y_mm", 1.0, 1.0), ("rotation_deg", 1.0, 1.0), ("log_scale", 0.02, 0.01))
CENTRE = 3  # the taxel in the middle of a triangle


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return four joint columns: 1 mm forward, 1 mm to the left, 1 degree counter-clockwise, 1 % larger."""
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
    columns = []
    for x, y in moves:
        m_x, m_y = np.einsum("ntk,tk->n", force, y), -np.einsum("ntk,tk->n", force, x)
        columns.append(np.stack([np.zeros_like(m_x), m_x, m_y], axis=1))
    return [TermColumns(({},) * 4, whole=np.stack(columns, axis=-1), joint=True)]


def _of_field(seen: PairedObservation, load: LoadEstimate) -> TermColumns:
    """Return the columns of a simulated trial: the change of each taxel's load, by central differences of its place."""
    assert seen.field is not None
    columns, moved_pa = [], np.zeros_like(load.pressure_pa)
    for name, step, scale in MOVES:
        change_pa = seen.field.change_by(Move(**{name: step})).at(seen.reference_s) * (-scale / step)
        moved_pa += change_pa
        columns.append(load.wrench_of(change_pa))
    shown = in_means(load, moved_pa)
    return TermColumns(({},) * 4, by_triangle=np.stack(columns, axis=-1), joint=True, in_means=shown)


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return shift, mm, rotation, degrees, and scale."""
    x, y, turn, larger = (float(share) for share in shares)
    return {"x_mm": x, "y_mm": y, "rotation_deg": turn, "scale": 1.0 + 0.01 * larger}


def _needs(load: LoadEstimate) -> str | None:
    """Return the reason why a recording cannot show the effect."""
    return "a uniform load is the same at every place" if load.observation.is_uniform else None


TERM = Term(
    word="map_transform",
    scopes=("insole",),
    share="free",
    columns=_columns,
    parameters=_parameters,
    needs=_needs,
    limit=30.0,  # mm, degrees or per cent
    record_instead="walking or standing with a force shoe",
)
