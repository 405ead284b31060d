"""`snap`: a contact closes and opens with the load. q = P + A·R[P], R a relay: 1 from P ≥ up until P ≤ down.

As the contact closes, readings jump from up to up + A; as it opens, from down + A to down. So P = q − A·R′[q], where R′
switches at a reading within each of these gaps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..operators import relay
from .term import Setting, Term, TermColumns

SCALE_PA = 1e3
TOGETHER = "together"  # setting and parameter: 1 if the taxels of a triangle switch together
UPS = (0.15, 0.25, 0.45)  # upper thresholds, relative to the range of pressures
DOWNS = (0.4, 0.75)  # lower thresholds, relative to the upper one
KNOWN_UPS = tuple(0.1 * k for k in range(1, 10))  # if the load is known
KNOWN_DOWNS = (0.3, 0.5, 0.7, 0.85)


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column for two thresholds: the wrench of −1 kPa while the relay is on.

    With the setting TOGETHER, the taxels of a triangle switch together by their mean.
    """
    pressure = triangle_means(load)[..., None] if setting.get(TOGETHER) else load.courses_pa
    on = relay(pressure.reshape(len(pressure), -1), setting["up_pa"], setting["down_pa"]).reshape(pressure.shape)
    return TermColumns((setting,), by_triangle=load.wrench_of_courses(-SCALE_PA * on)[..., None])


def triangle_means(load: LoadEstimate) -> Array:
    """Return the mean load (N, T) of the usable taxels of each triangle, Pa."""
    usable = load.observation.usable
    total_pa = np.einsum("ntk,tk->nt", load.pressure_pa, usable.astype(float))
    return np.asarray(total_pa / np.maximum(usable.sum(axis=1), 1))


def _columns(load: LoadEstimate) -> Iterator[TermColumns]:
    """Yield a column for each pair of thresholds."""
    highest = float(np.quantile(load.pressure_pa.max(axis=0)[load.observation.usable], 0.9))
    return (
        _column(load, {"up_pa": up * highest, "down_pa": down * up * highest})
        for up in (KNOWN_UPS if load.is_known else UPS)
        for down in (KNOWN_DOWNS if load.is_known else DOWNS)
    )  # fmt: skip


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return thresholds and step of the law, Pa, from the thresholds of readings.

    Readings jump from up to up + A, and from down + A to down. Any threshold in such a gap separates the states, so
    those that were found are taken as its middle, as the inverse of the law has them.
    """
    step_pa = SCALE_PA * float(shares[0])
    up_pa = max(float(settings[0]["up_pa"]) - 0.5 * step_pa, 0.0)
    return {
        "up_pa": up_pa, "down_pa": min(float(settings[0]["down_pa"]) - 0.5 * step_pa, 0.99 * up_pa), "step_pa": step_pa,
    }  # fmt: skip


def _known_parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return thresholds and step, Pa; if the load is known, the thresholds are those of the law."""
    together = {TOGETHER: 1} if settings[0].get(TOGETHER) else {}
    return {
        "up_pa": float(settings[0]["up_pa"]), "down_pa": float(settings[0]["down_pa"]),
        "step_pa": SCALE_PA * float(shares[0]), **together,
    }  # fmt: skip


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Return whether the contact opens at a load above zero; if the load is known, the settings ensure it."""
    return load_is_known or 0.5 * SCALE_PA * float(shares[0]) < float(settings[0]["down_pa"])


TERM = Term(
    word="snap",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    known_parameters=_known_parameters,
    is_possible=_is_possible,
    plausible=5,
    limit=1000,
    absorbs={"gain": 0.005, "stiffening": 0.005, "mean_curve": 0.005},
    misfit=0.05,
    refine=("up_pa", "down_pa"),
    column=_column,
)
