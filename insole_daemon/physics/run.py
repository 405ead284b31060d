"""A chain at work: what it remembers between two pieces of a signal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import EffectError
from ..skin.geometry import N_TAXELS
from .law import Array, Moments, Operator

_PIECE = 64  # samples that go through all stages together: what is between two of them stays in the cache


class Run:
    """Consecutive samples through the stages of a chain, in pieces of any length: the numbers are the same.

    A slot that says nothing (NaN) is taken to stay at what it said last, or at 0, and its result is NaN.
    """

    def __init__(
        self,
        stages: Sequence[Operator],
        n_triangles: int,
        usable: NDArray[np.bool_] | None,
        read_by: NDArray[np.intp] | None = None,
    ) -> None:
        """`usable` (m,): the slots whose signal has results, None: all; `read_by` (m,): whose the result is of each."""
        self._stages = tuple(stages)
        self._shape = (n_triangles, N_TAXELS)
        self._unusable = None if usable is None or usable.all() else ~usable
        self._read_by = read_by
        self._last_t_s: float | None = None
        self._said: Array | None = None  # (m,) last

    def __call__(self, signal: ArrayLike, t_s: ArrayLike, temperature_c: ArrayLike | None = None) -> Array:
        """(n, n_triangles, 12) of `signal` of that shape.

        `t_s` (n,) s of a clock that never goes back, from the origin that the effects' own times count from.
        `temperature_c` (n,), or anything that broadcasts to the shape of `signal`.
        """
        whole = np.asarray(signal, np.float64)
        t = np.asarray(t_s, np.float64)
        n = len(t)
        if whole.shape != (n, *self._shape):
            raise EffectError(
                f"expected samples of the shape {(n, *self._shape)}, as many as there are times, found {whole.shape}"
            )
        x = whole.reshape(n, N_TAXELS * self._shape[0])
        before = np.empty_like(t)  # np.diff does the same, and takes several times as long for one sample
        before[:1] = t[:1] if self._last_t_s is None else self._last_t_s
        before[1:] = t[:-1]
        dt = t - before
        if (dt < 0).any():
            raise EffectError(
                f"time goes back at sample {int(np.argmax(dt < 0))} (t_s {t[np.argmax(dt < 0)]:g}): "
                "expected the samples in order, on a clock that is not stepped"
            )
        warm = None
        if temperature_c is not None:
            warm = np.asarray(temperature_c, np.float64)
            warm = warm[:, None] if warm.ndim == 1 else np.broadcast_to(warm, whole.shape).reshape(x.shape)
        result = np.empty_like(x)
        for start in range(0, n, _PIECE):
            rows = slice(start, start + _PIECE)
            moments = Moments(t[rows], dt[rows], None if warm is None else warm[rows])
            result[rows] = self._piece(x[rows], moments)
            self._last_t_s = float(moments.t_s[-1])
        return result.reshape(whole.shape)

    def _piece(self, x: Array, moments: Moments) -> Array:
        silent = np.isnan(x)
        some = bool(silent.any())
        if some:
            x = self._filled(x, silent)
        self._said = x[-1].copy()
        for stage in self._stages:
            x = stage(x, moments)
        if some or self._unusable is not None:
            nothing = silent if self._unusable is None else silent | self._unusable
            if self._read_by is not None:
                nothing = nothing[:, self._read_by]
            x = np.where(nothing, np.nan, x)
        return x

    def _filled(self, x: Array, silent: NDArray[np.bool_]) -> Array:
        """`x` with what each slot said last where it is `silent`."""
        said = np.zeros(x.shape[1]) if self._said is None else self._said
        if len(x) == 1:
            return np.where(silent, said, x)
        row = np.where(silent, 0, np.arange(1, len(x) + 1)[:, None])
        np.maximum.accumulate(row, axis=0, out=row)
        return np.take_along_axis(np.concatenate([said[None], x]), row, axis=0)
