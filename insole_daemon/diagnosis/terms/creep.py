"""`creep`: parts of the response are delayed by many time constants.

q = (1 − Σ a_k)·P + Σ a_k·z_k, τ_k·dz_k/dt = P − z_k.

The inverse, computed from readings, is a sum of the same form: P = q + Σ b_k·(q − z′_k), τ′_k·dz′_k/dt = q − z′_k. Its
poles and residues give a_k and τ_k (`forward`).

Columns of activated flow are offered too: a flow that is fast far from equilibrium and has no single time constant,
τ·dz/dt = s·sinh((P − z)/s). With q = (1 − a)·P + a·z, its inverse has the same form: P = q + a/(1 − a)·(q − z), and z
flows towards q with the time constant (1 − a)·τ and the scale (1 − a)·s. The model of a walk contains only the sum of
relaxations, because the inverse of several flows is no sum of flows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..operators import each_of, flows, low_pass
from .term import ABSORBED, Setting, Term, TermColumns, stacked

RATIO = 4.0  # between time constants
FASTEST_S = 0.5  # smallest time constant
SLOW_S = 5.0  # longer than the viscoelasticity of foams and skins, which ends after a few seconds
# Smallest fraction of the shares with time constants above SLOW_S, under a known load and on a walk, where a little may
# be an error of the calibration.
LEAST_SLOW, LEAST_SLOW_ON_WALKS = 0.1, 0.3
UNEVEN = 0.5  # prior standard deviation of the companion `uneven_creep`
# Activated flow: pressure scale relative to the largest load, and time constant relative to the recording.
FLOWS = ((0.05, 2.0), (0.05, 10.0), (0.08, 0.1), (0.08, 0.5), (0.08, 2.0), (0.08, 10.0), (0.13, 0.1), (0.13, 0.5))
# Largest delayed part of the response: foams relax by a fifth to a half. A larger one could describe any loop, so it is
# used only where it explains far more (`searching.py`).
MOST_LATE, MOST_LATE_WIDE = 0.7, 0.95
EARLIER = 100.0  # prior standard deviation of the load before the recording, kPa


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: q − z′ for time constants up to the recording's length, and flows if the load is known."""
    return [_joint_columns(load, with_flows=load.is_known)]


def _columns_with_flows(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns of a walk: q − z′ for time constants up to the recording's length, and flows."""
    return [] if load.is_known else [_joint_columns(load, with_flows=True)]


def _joint_columns(load: LoadEstimate, with_flows: bool) -> TermColumns:
    seen = load.observation
    wrench = load.by_triangle
    # If the load is known, a time constant longer than the recording would be a regressor like the load itself.
    longest_s = float(np.ptp(seen.t_s)) * (1.0 if load.is_known else 2.0)
    number = np.log(max(longest_s, FASTEST_S * RATIO) / FASTEST_S) / np.log(RATIO)
    taus_s = FASTEST_S * RATIO ** np.arange((np.floor(number) if load.is_known else np.ceil(number)) + 1)
    settings = load.wanted([{"tau_s": float(tau_s)} for tau_s in taus_s])
    late: Iterable[Array] = (wrench - low_pass(wrench, seen.step_s, setting["tau_s"]) for setting in settings)
    if with_flows:
        flow_settings, flowing = _activated(load, longest_s)
        settings, late = settings + flow_settings, chain(late, flowing)
    return TermColumns(tuple(settings), by_triangle=stacked(late, len(settings)), joint=True)


def _activated(load: LoadEstimate, longest_s: float) -> tuple[list[Setting], Iterable[Array]]:
    """Return settings and columns of P − z, with z the activated flow towards the load (`operators.flows`)."""
    pressure = load.courses_pa
    settings = load.wanted([{"tau_s": length * longest_s, "scale_pa": scale * load.top_pa} for scale, length in FLOWS])
    if not settings:
        return [], ()
    tau_s, scale_pa = np.array([[setting["tau_s"], setting["scale_pa"]] for setting in settings]).T
    late = each_of(partial(flows, step_s=load.step_s), pressure.reshape(len(pressure), -1), tau_s, scale_pa)
    return settings, (load.wrench_of_courses(one.reshape(pressure.shape)) for one in late)


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return a_k and τ_k of the law."""
    b = np.maximum(np.asarray(shares, float), 0.0)
    tau = np.array([setting["tau_s"] for setting in settings])
    kept = b > 1e-3 * max(float(b.max()), 1e-9)
    return dict(zip(("a", "tau_s"), forward(b[kept], tau[kept]), strict=True))


def forward(b: Array, tau_s: Array) -> tuple[list[float], list[float]]:
    """Return a_k and τ_k with 1/(1 + Σ b_k·τ′_k·s/(1 + τ′_k·s)) = 1 − Σ a_k + Σ a_k/(1 + τ_k·s).

    `b` (k,): shares of the inverse; `tau_s` (k,): its time constants τ′_k.

    The poles of the left side are −1/τ_k and lie between those of the sum; its residues give a_k.
    """
    numerator = np.array([1.0])
    for tau in tau_s:
        numerator = np.polymul(numerator, [tau, 1.0])
    whole = numerator.copy()
    for k, tau in enumerate(tau_s):
        rest = np.array([1.0])
        for j, other in enumerate(tau_s):
            if j != k:
                rest = np.polymul(rest, [other, 1.0])
        whole = np.polyadd(whole, b[k] * tau * np.polymul(rest, [1.0, 0.0]))
    poles = np.sort(np.real(np.roots(whole)))
    slope = np.polyder(whole)
    a = np.array([np.polyval(numerator, pole) / np.polyval(slope, pole) / -pole for pole in poles])
    return np.clip(a, 0.0, None).tolist(), (-1.0 / poles).tolist()


def _known_parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return a_k, τ_k and, if any of them flows, s_k: shares and settings themselves if the load is known."""
    a = np.maximum(np.asarray(shares, float), 0.0)
    kept = np.flatnonzero(a > 1e-3 * max(float(a.max()), 1e-9)).tolist()
    values: dict[str, object] = {"a": a[kept].tolist(), "tau_s": [settings[k]["tau_s"] for k in kept]}
    scales = [settings[k].get("scale_pa", 0.0) for k in kept]
    return {**values, "scale_pa": scales} if any(scales) else values


def _is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Return whether enough of it is slower than viscoelasticity; asked only if the load is known."""
    return not load_is_known or _slow_part(settings, shares) > LEAST_SLOW


def is_possible_on_walks(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
    """Return whether enough of it is slower than viscoelasticity, on a walk."""
    return _slow_part(settings, shares) > LEAST_SLOW_ON_WALKS


def _slow_part(settings: Sequence[Setting], shares: Array) -> float:
    """Return the fraction of the shares with time constants above SLOW_S; 0 without shares."""
    slow = np.array([setting["tau_s"] for setting in settings]) > SLOW_S
    return float(shares[slow].sum() / max(shares.sum(), 1e-300))


def _is_relaxation(setting: Setting) -> bool:
    """Return whether a column of a walk is in the law: the inverse of several flows is no sum of flows."""
    return "scale_pa" not in setting


TERM = Term(
    word="creep",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    known_parameters=_known_parameters,
    plausible=0.1,
    limit=1.0,
    known_sum_bound=MOST_LATE,
    wide_sum_bound=MOST_LATE_WIDE,
    absorbs={**ABSORBED, "earlier_load": EARLIER, "uneven_creep": UNEVEN},
    yields_to=("viscoelasticity", "hysteresis"),
    is_possible=_is_possible,
    misfit=0.05,
    known_misfit=0.02,
)
# On a walk flows are offered at large places only: the wrench does not show which law a triangle follows.
WITH_FLOWS = replace(
    TERM, scopes=("insole", "board"), columns=_columns_with_flows, is_possible=is_possible_on_walks,
    is_in_law=_is_relaxation, misfit=0.01,
)  # fmt: skip
