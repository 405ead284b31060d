"""What no known effect explains: in which part of the load it is, and an equation put together from pieces of memory.

The pieces are looked for one after the other (orthogonal matching pursuit: Pati, Rezaiifar & Krishnaprasad, 27th
Asilomar Conf. (1993) 40), each admitted only for what it explains on blocks of rows that were held out. What they are
called is a proposal: the equation says what the readings do, not why.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..operators import low_pass, plays, relay

MOST_PIECES = 3
WORTH = 0.1  # natural logarithm of the held-out mean square: what one more piece has to gain
RATE_S = 0.2
STILL = 0.01  # of the load's span a second: less is a hold
LEVELS = 3
LEAST_ROWS = 20
N_FOLDS, FOLD_S = 5, 8.0


def regime(load: Array, left: Array, step_s: float) -> tuple[list[float], str] | None:
    """The third of the range of `load` (N,), and the phase, in which the mean square of `left` (N,) is largest."""
    edges = np.linspace(load.min(), load.max(), LEVELS + 1)
    level = np.clip(np.digitize(load, edges) - 1, 0, LEVELS - 1)
    rate, still = _rate(load, step_s), STILL * float(np.ptp(load))
    phases = {"holding": np.abs(rate) < still, "loading": rate >= still, "unloading": rate <= -still}
    found = []
    for at in range(LEVELS):
        for phase, moves in phases.items():
            rows = (level == at) & moves
            if rows.sum() > LEAST_ROWS:
                found.append((float(np.mean(left[rows] ** 2)), at, phase))
    if not found:
        return None
    _, at, phase = max(found)
    return [round(float(edges[at])), round(float(edges[at + 1]))], phase


def equation(load_pa: Array, left_count: Array, step_s: float) -> str:
    """What `left_count` (N,) is made of under a load (N,) that is the same everywhere; empty: of no such pieces."""
    names, columns = zip(*_pieces(load_pa, step_s).items(), strict=True)
    every = np.stack([column - column.mean() for column in columns], axis=1)
    every = every / np.maximum(np.sqrt(np.mean(every**2, axis=0)), 1e-12)
    scale = [float(np.std(column)) for column in columns]
    y = left_count - left_count.mean()
    fold = (np.arange(len(y)) * step_s // FOLD_S).astype(int) % N_FOLDS
    chosen: list[int] = []
    left = _held_out(every[:, []], y, fold)
    while len(chosen) < MOST_PIECES:
        rest = y - every[:, chosen] @ _shares(every[:, chosen], y)
        promise = np.abs(every.T @ rest)
        promise[chosen] = -1.0
        best = int(promise.argmax())
        after = _held_out(every[:, [*chosen, best]], y, fold)
        if np.log(left / max(after, 1e-300)) < WORTH:
            break
        chosen, left = [*chosen, best], after
    shares = _shares(every[:, chosen], y)
    terms = [f"{share / max(scale[i], 1e-12):+.3g}·{names[i]}" for share, i in zip(shares, chosen, strict=True)]
    return f"model − reading = {' '.join(terms)} counts" if terms else ""


def _pieces(load_pa: Array, step_s: float) -> dict[str, Array]:
    """(N,) of each piece of memory of the load, kPa or 1, by what it is called."""
    load, span = load_pa[:, None] * 1e-3, float(np.ptp(load_pa)) * 1e-3
    found: dict[str, Array] = {"P/kPa": load[:, 0]}
    for up in np.geomspace(0.05, 0.9, 10):
        for gap in (0.2, 0.5, 0.8):
            high, low = up * span, up * (1 - gap) * span
            name = f"[P has passed {high:.0f} kPa and not fallen below {low:.0f} kPa since]"
            found[name] = relay(load, high, low)[:, 0]
    for tau in np.geomspace(max(0.1, 2 * step_s), 200.0, 12):
        past = low_pass(load, step_s, float(tau))[:, 0]
        found[f"(mean of the last {tau:.2g} s − P)/kPa"] = past - load[:, 0]
        found[f"P·(mean of the last {tau:.2g} s)/kPa²"] = past * load[:, 0]
    for radius in (0.02, 0.06, 0.15, 0.35):
        found[f"(play of {radius * span:.0f} kPa − P)/kPa"] = (plays(load, np.array([radius * span]))[0] - load)[:, 0]
    rate = _rate(load[:, 0], step_s)
    found["|dP/dt|·s/kPa"] = np.abs(rate)
    found["P·|dP/dt|·s/kPa²"] = load[:, 0] * np.abs(rate)
    found["P·[loading]/kPa"] = load[:, 0] * (rate > STILL * span)
    found["P·t/(kPa·s)"] = load[:, 0] * np.arange(len(load)) * step_s
    return found


def _rate(load: Array, step_s: float) -> Array:
    """(N,) of change a second, over RATE_S."""
    return np.asarray(np.gradient(low_pass(load[:, None], step_s, RATE_S)[:, 0], step_s))


def _shares(columns: Array, y: Array) -> Array:
    return np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0])


def _held_out(columns: Array, y: Array, fold: NDArray[np.intp]) -> float:
    off = np.empty_like(y)
    for k in range(N_FOLDS):
        held = fold == k
        off[held] = y[held] - columns[held] @ _shares(columns[~held], y[~held])
    return float(np.mean(off**2))


def regime_and_equation(load: Array, left: Array, step_s: float, load_is_known: bool) -> tuple[dict[str, Any], str]:
    """The regime as `insole-diagnosis/1` has it, and the equation where the load is known; both may be empty."""
    where = regime(load, left, step_s)
    if where is None:
        return {}, ""
    name = "pressure_pa" if load_is_known else "force_n"
    return {name: where[0], "phase": where[1]}, equation(load, left, step_s) if load_is_known else ""
