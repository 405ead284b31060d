"""Run a chain over consecutive pieces of a signal, with its state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import EffectError
from ..skin.geometry import N_TAXELS
from .law import Array, Moments, Operator

_PIECE = 64  # samples per pass through all stages, so that intermediate results stay in the CPU's cache


class ChainRun:
    """Runs samples through the stages of a chain, in pieces of any length with the same result.

    A missing value (NaN) is replaced by the slot's last value, or 0, and its result is NaN.
    """

    def __init__(
        self,
        stages: Sequence[Operator],
        n_triangles: int,
        usable: NDArray[np.bool_] | None,
        read_by: NDArray[np.intp] | None = None,
    ) -> None:
        """Create a run from the beginning.

        `usable` (m,) are the slots with results, None for all; `read_by` (m,) is the slot whose signal gives each
        result.
        """
        self._stages = tuple(stages)
        self._shape = (n_triangles, N_TAXELS)
        self._unusable = None if usable is None or usable.all() else ~usable
        self._read_by = read_by
        self._last_t_s: float | None = None
        self._last_values: Array | None = None  # (m,) of the last sample

    def __call__(self, signal: ArrayLike, t_s: ArrayLike, temperature_c: ArrayLike | None = None) -> Array:
        """Return (n, n_triangles, 12) the results for `signal` of that shape.

        `t_s` (n,) are seconds on a monotonic clock since the origin of the effects' times. `temperature_c` (n,), or
        anything that broadcasts to the shape of `signal`. Raises EffectError if a shape is wrong or time goes back.
        """
        samples = np.asarray(signal, np.float64)
        t = np.asarray(t_s, np.float64)
        n = len(t)
        if samples.shape != (n, *self._shape):
            raise EffectError(
                f"expected samples of the shape {(n, *self._shape)}, as many as there are times, found {samples.shape}"
            )
        x = samples.reshape(n, N_TAXELS * self._shape[0])
        previous_t = np.empty_like(t)  # np.diff does the same, and takes several times as long for one sample
        previous_t[:1] = t[:1] if self._last_t_s is None else self._last_t_s
        previous_t[1:] = t[:-1]
        dt = t - previous_t
        if (dt < 0).any():
            raise EffectError(
                f"time goes back at sample {int(np.argmax(dt < 0))} (t_s {t[np.argmax(dt < 0)]:g}): "
                "expected the samples in order, on a clock that is not stepped"
            )
        warm = None
        if temperature_c is not None:
            warm = np.asarray(temperature_c, np.float64)
            warm = warm[:, None] if warm.ndim == 1 else np.broadcast_to(warm, samples.shape).reshape(x.shape)
        result = np.empty_like(x)
        for start in range(0, n, _PIECE):
            rows = slice(start, start + _PIECE)
            moments = Moments(t[rows], dt[rows], None if warm is None else warm[rows])
            result[rows] = self._run_piece(x[rows], moments)
            self._last_t_s = float(moments.t_s[-1])
        return result.reshape(samples.shape)

    def _run_piece(self, x: Array, moments: Moments) -> Array:
        """Run one piece (n, m) through all stages; results of missing and unusable slots are NaN."""
        is_missing = np.isnan(x)
        any_missing = bool(is_missing.any())
        if any_missing:
            x = self._fill_missing(x, is_missing)
        self._last_values = x[-1].copy()
        for stage in self._stages:
            x = stage(x, moments)
        if any_missing or self._unusable is not None:
            has_no_result = is_missing if self._unusable is None else is_missing | self._unusable
            if self._read_by is not None:
                has_no_result = has_no_result[:, self._read_by]
            x = np.where(has_no_result, np.nan, x)
        return x

    def _fill_missing(self, x: Array, is_missing: NDArray[np.bool_]) -> Array:
        """Return `x` with each slot's last value in place of missing ones."""
        last_values = np.zeros(x.shape[1]) if self._last_values is None else self._last_values
        if len(x) == 1:
            return np.where(is_missing, last_values, x)
        row = np.where(is_missing, 0, np.arange(1, len(x) + 1)[:, None])
        np.maximum.accumulate(row, axis=0, out=row)
        return np.take_along_axis(np.concatenate([last_values[None], x]), row, axis=0)
