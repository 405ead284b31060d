"""`preload`: straps press on the insole, mostly under them, and the reference does not measure it. q = P + p0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ...skin.layout import Layout
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns

HATS = 5  # knots along the foot, between which the pressure of straps is linear


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return the wrench of −1 Pa everywhere; if the load is known, joint columns of hat functions along the foot."""
    everywhere = -np.ones_like(load.slope_pa)
    if not load.is_known:
        return [TermColumns(({},), by_triangle=load.wrench_of(everywhere)[..., None], is_recalibration=True)]
    hats = [profile(load.observation.layout, hat) for hat in np.eye(HATS)]
    columns = np.stack([load.wrench_of(everywhere * hat[:, None]) for hat in hats], axis=-1)
    settings = tuple({"mean": float(hat.mean())} for hat in hats)
    return [TermColumns(settings, by_triangle=columns, joint=True, is_recalibration=True)]


def profile(layout: Layout, shares: Array) -> Array:
    """Return the value (T,) of each triangle, linear between equidistant knots along the foot with `shares` (HATS,)."""
    along = layout.xy_m[..., 0].mean(axis=1)
    return np.asarray(np.interp(along, np.linspace(along.min(), along.max(), HATS), shares))


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return the mean pressure, Pa."""
    means = [setting.get("mean", 1.0) for setting in settings]
    return {"p0_pa": float(np.dot(means, shares))}


def _needs(load: LoadEstimate) -> str | None:
    """Return the reason why a recording cannot show the effect."""
    return "a uniform load cannot separate it from the static curve" if load.observation.is_uniform else None


TERM = Term(
    word="preload",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    plausible=5000.0,
    limit=60000.0,  # straps that press more stop the blood
    needs=_needs,
    record_instead="walking or standing with a force shoe",
)
