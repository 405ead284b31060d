"""Describe a residual that no effect explains: the regime where it is largest, and an empirical equation.

The equation is a sum of at most three regressors from a dictionary of functions with memory. They are selected by
orthogonal matching pursuit (Pati, Rezaiifar & Krishnaprasad, 27th Asilomar Conf. (1993) 40), and each must lower the
cross-validated error. The equation describes the readings and does not identify a cause.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..operators import low_pass, plays, relay

MOST_REGRESSORS = 3
LEAST_LOG_GAIN = 0.1  # decrease of the logarithm of the held-out mean square by one more regressor
RATE_S = 0.2  # time constant of the low-pass before the load is differentiated
STILL = 0.01  # of the load's range per second: slower changes are a hold
LEVELS = 3  # equal parts of the load's range
LEAST_ROWS = 20  # of a regime
N_FOLDS, FOLD_S = 5, 8.0


def regime(load: Array, residual: Array, step_s: float) -> tuple[list[float], str] | None:
    """Return the regime with the largest mean square of `residual` (N,): a third of the range of `load`, and a phase.

    The phase is "holding", "loading" or "unloading". None if no regime has enough rows. `load`: (N,), Pa or N.
    """
    edges = np.linspace(load.min(), load.max(), LEVELS + 1)
    level = np.clip(np.digitize(load, edges) - 1, 0, LEVELS - 1)
    rate, still = _rate(load, step_s), STILL * float(np.ptp(load))
    phases = {"holding": np.abs(rate) < still, "loading": rate >= still, "unloading": rate <= -still}
    regimes = []
    for at in range(LEVELS):
        for phase, moves in phases.items():
            rows = (level == at) & moves
            if rows.sum() > LEAST_ROWS:
                regimes.append((float(np.mean(residual[rows] ** 2)), at, phase))
    if not regimes:
        return None
    _, at, phase = max(regimes)
    return [round(float(edges[at])), round(float(edges[at + 1]))], phase


def equation(load_pa: Array, residual_count: Array, step_s: float) -> str:
    """Return an equation for `residual_count` (N,) under the load `load_pa` (N,), as text for a person.

    Empty if no regressor lowers the cross-validated error.
    """
    names, columns = zip(*_dictionary(load_pa, step_s).items(), strict=True)
    regressors = np.stack([column - column.mean() for column in columns], axis=1)
    regressors = regressors / np.maximum(np.sqrt(np.mean(regressors**2, axis=0)), 1e-12)
    scale = [float(np.std(column)) for column in columns]
    y = residual_count - residual_count.mean()
    fold = (np.arange(len(y)) * step_s // FOLD_S).astype(int) % N_FOLDS
    chosen: list[int] = []
    cv_mse = _cv_mse(regressors[:, []], y, fold)
    while len(chosen) < MOST_REGRESSORS:
        rest = y - regressors[:, chosen] @ _coefficients(regressors[:, chosen], y)
        correlation = np.abs(regressors.T @ rest)
        correlation[chosen] = -1.0
        best = int(correlation.argmax())
        cv_mse_with = _cv_mse(regressors[:, [*chosen, best]], y, fold)
        if np.log(cv_mse / max(cv_mse_with, 1e-300)) < LEAST_LOG_GAIN:
            break
        chosen, cv_mse = [*chosen, best], cv_mse_with
    shares = _coefficients(regressors[:, chosen], y)
    terms = [f"{share / max(scale[i], 1e-12):+.3g}·{names[i]}" for share, i in zip(shares, chosen, strict=True)]
    return f"model − reading = {' '.join(terms)} counts" if terms else ""


def _dictionary(load_pa: Array, step_s: float) -> dict[str, Array]:
    """Return regressors (N,) made of the load, by the text for the equation: relays, low-passes, plays and rates.

    The load P is in kPa, relays are 0 or 1.
    """
    load, span = load_pa[:, None] * 1e-3, float(np.ptp(load_pa)) * 1e-3
    regressors: dict[str, Array] = {"P/kPa": load[:, 0]}
    for up in np.geomspace(0.05, 0.9, 10):
        for gap in (0.2, 0.5, 0.8):
            high, low = up * span, up * (1 - gap) * span
            name = f"[P has passed {high:.0f} kPa and not fallen below {low:.0f} kPa since]"
            regressors[name] = relay(load, high, low)[:, 0]
    for tau in np.geomspace(max(0.1, 2 * step_s), 200.0, 12):
        past = low_pass(load, step_s, float(tau))[:, 0]
        regressors[f"(mean of the last {tau:.2g} s − P)/kPa"] = past - load[:, 0]
        regressors[f"P·(mean of the last {tau:.2g} s)/kPa²"] = past * load[:, 0]
    for radius in (0.02, 0.06, 0.15, 0.35):
        regressors[f"(play of {radius * span:.0f} kPa − P)/kPa"] = (plays(load, np.array([radius * span]))[0] - load)[
            :, 0
        ]
    rate = _rate(load[:, 0], step_s)
    regressors["|dP/dt|·s/kPa"] = np.abs(rate)
    regressors["P·|dP/dt|·s/kPa²"] = load[:, 0] * np.abs(rate)
    regressors["P·[loading]/kPa"] = load[:, 0] * (rate > STILL * span)
    regressors["P·t/(kPa·s)"] = load[:, 0] * np.arange(len(load)) * step_s
    return regressors


def _rate(load: Array, step_s: float) -> Array:
    """Return the rate of change (N,) per second of the load (N,), smoothed over RATE_S."""
    return np.asarray(np.gradient(low_pass(load[:, None], step_s, RATE_S)[:, 0], step_s))


def _coefficients(columns: Array, y: Array) -> Array:
    return np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0])


def _cv_mse(columns: Array, y: Array, fold: NDArray[np.intp]) -> float:
    """Return the cross-validated mean square error of y (N,) by `columns` (N, k); `fold` (N,): number of the block."""
    error = np.empty_like(y)
    for k in range(N_FOLDS):
        held = fold == k
        error[held] = y[held] - columns[held] @ _coefficients(columns[~held], y[~held])
    return float(np.mean(error**2))


def regime_and_equation(load: Array, residual: Array, step_s: float, load_is_known: bool) -> tuple[dict[str, Any], str]:
    """Return the regime as in `insole-diagnosis/1`, and the equation if the load is known; both may be empty.

    `load` (N,): Pa if known on every taxel, else f_z in N. `residual` (N,): counts, or N.
    """
    where = regime(load, residual, step_s)
    if where is None:
        return {}, ""
    name = "pressure_pa" if load_is_known else "force_n"
    return {name: where[0], "phase": where[1]}, equation(load, residual, step_s) if load_is_known else ""
