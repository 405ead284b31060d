"""`map_transform`: the insole lies turned, scaled or shifted against its map: moments change, f_z does not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..model.load import LoadEstimate
from .term import Setting, Term, TermColumns

CENTRE = 3  # the taxel in the middle of a triangle


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Four joint columns: 1 mm forward, 1 mm to the left, 1 degree counter-clockwise, 1 % larger."""
    seen = load.observation
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
)
