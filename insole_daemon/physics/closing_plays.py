"""Plays whose loop closes as the load vanishes, and their inverse: friction of surfaces that the load presses together.

    q = P − Σ w_j·g_j·(L_j − play_rj[L_j]),  g_j = L_j/(L_j + h_j),  L_j = max(P, 0)

Where the half load h_j is 0, g_j is 1 and L_j is P, as in the Prandtl–Ishlinskii model. The inverse solves the equation
for P: q rises with P by at least 1 − Σ w_j, because a play lies between 0 and the largest load so far. Newton's method
is kept between the bounds that |L_j − play_rj| ≤ r_j gives, because the slope jumps where a play begins to move.

Source: friction in proportion to the normal load after Amontons and Coulomb, which micro-contacts saturate; J. A.
Greenwood and J. B. P. Williamson, Proc. R. Soc. A 295 (1966) 300.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .law import Array, Moments

MOST_STEPS = 60  # of Newton's method and bisection
SOLVED_PA = 1e-4  # remaining error of q


class ClosingPlays:
    """The law or its inverse; `r_pa`, `w` and `half_pa` (k, 1) or (k, m)."""

    def __init__(self, r_pa: Array, w: Array, half_pa: Array, *, is_inverse: bool = False) -> None:
        """Create the operator without load before its first sample."""
        r, w, half = np.broadcast_arrays(r_pa, w, half_pa)
        closes = half > 0.0
        self._always = _Plays(r, np.where(closes, 0.0, w))
        self._closing = _Plays(r, np.where(closes, w, 0.0))
        self._half = np.where(closes, half, 1.0)[self._closing.kept]
        self._widest = (r * w).sum(axis=0)
        self._is_inverse = is_inverse
        # (m,) of the load before q in the sample before, where the search for the next one starts.
        self._lead: Array | float = 0.0

    def __call__(self, x: Array, moments: Moments) -> Array:
        """Return (n, m) q for the load `x`, or the load for q."""
        return self.apply_after(x, x)

    def apply_after(self, remembered: Array, x: Array) -> Array:
        """Return the output for `x` (n, m), with plays that follow `remembered` (n, m) up to the previous sample."""
        result = np.empty_like(x)
        for remembered_row, row, output in zip(remembered, x, result, strict=True):
            output[:] = self._solved(row) if self._is_inverse else row - self._taken(row)[0]
            if remembered is x:
                load = output if self._is_inverse else row
            else:
                load = self._solved(remembered_row) if self._is_inverse else remembered_row
            self._always.follow(load)
            self._closing.follow(np.maximum(load, 0.0))
        return result

    def _taken(self, load: Array) -> tuple[Array, Array]:
        """Return what friction takes of the load, and its derivative by the load, (m,) each."""
        late, sticks = self._always.late(load)
        taken, slope = (self._always.w * late).sum(axis=0), (self._always.w * sticks).sum(axis=0)
        loaded = np.maximum(load, 0.0)
        late, sticks = self._closing.late(loaded)
        per_pa = 1.0 / (loaded + self._half)
        part = self._closing.w * loaded * per_pa
        rate = part * sticks + self._closing.w * self._half * per_pa**2 * late
        return taken + (part * late).sum(axis=0), slope + rate.sum(axis=0) * (load > 0.0)

    def _solved(self, q: Array) -> Array:
        """Return the load (m,) for which the law gives `q` (m,)."""
        low, high = q - self._widest, q + self._widest
        load = np.clip(q + self._lead, low, high)
        for _ in range(MOST_STEPS):
            taken, slope = self._taken(load)
            error = load - taken - q
            if not (np.abs(error) > SOLVED_PA).any():
                break
            low, high = np.where(error < 0.0, load, low), np.where(error > 0.0, load, high)
            step = load - error / (1.0 - slope)
            load = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        self._lead = load - q
        return load


class _Plays:
    """Plays that have a weight on any taxel, `kept` of all (k,), and their state."""

    def __init__(self, r: Array, w: Array) -> None:
        self.kept = np.flatnonzero(w.any(axis=1))
        self.r, self.w = r[self.kept], w[self.kept]
        self._y: Array = np.zeros((len(self.r), 1))

    def late(self, x: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return x − play (k, m) at `x` (m,), and whether the play sticks."""
        behind = x - self._y
        return np.clip(behind, -self.r, self.r), np.abs(behind) < self.r

    def follow(self, x: Array) -> None:
        """Move the plays to `x` (m,)."""
        self._y = np.clip(self._y, x - self.r, x + self.r)
