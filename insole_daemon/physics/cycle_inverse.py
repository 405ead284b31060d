"""The dynamic model one cycle at a time, as the live path needs it: by the compiled kernel where that has all effects.

The kernel takes a cycle through all stages in one call, with the same results as `DynamicModel` to the bit. A chain
with an effect that it has not, and an installation without it, use `DynamicModel` itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..errors import EffectError
from .dynamic import DynamicModel
from .law import Array


class InvertedCycle(NamedTuple):
    """The load of one cycle; arrays (n_triangles, 12) as in InvertedCycles."""

    pressure_pa: Array
    valid: NDArray[np.bool_]
    beyond: NDArray[np.bool_]


class CycleInverse:
    """Inverts consecutive cycles by `model`, whose own memory must not be used beside it."""

    def __init__(self, model: DynamicModel) -> None:
        self._model = model
        self._inverse = None
        stages = None if kernel is None else model.kernel_stages()
        if stages is not None:
            memory = np.zeros(model.highest_pa.size), np.full(1, np.nan)
            self._inverse = kernel.inverse((model.highest_pa, *memory), tuple(s.with_memory() for s in stages))

    def __call__(
        self, static_pa: Array, counts: NDArray[np.uint8], valid: NDArray[np.bool_], t_s: float
    ) -> InvertedCycle:
        """Invert a further cycle; arguments (n_triangles, 12), `t_s` as in a call of the model."""
        if not self.is_compiled:
            cycles = self._model(static_pa[None], counts[None], valid[None], np.array([t_s]))
            return InvertedCycle(cycles.pressure_pa[0], cycles.valid[0], cycles.beyond[0])
        pressure_pa, beyond = np.empty(valid.shape), np.empty(valid.shape, np.bool_)
        self.into(static_pa, counts, valid, t_s, pressure_pa, beyond)
        return InvertedCycle(pressure_pa, valid, beyond)

    @property
    def is_compiled(self) -> bool:
        """Whether the kernel computes, and `into` may be used."""
        return self._inverse is not None

    def into(
        self,
        static_pa: Array,
        counts: memoryview | NDArray[np.uint8],
        valid: NDArray[np.bool_],
        t_s: float,
        pressure_pa: Array,
        beyond: NDArray[np.uint8] | NDArray[np.bool_],
    ) -> int:
        """Do the same into the last two arrays; return how many taxels are beyond."""
        n_beyond: int = kernel.invert(
            self._inverse, static_pa, counts, valid, self._model.highest_count, t_s, pressure_pa, beyond
        )
        if n_beyond < 0:
            raise EffectError(
                f"time goes back at t_s {t_s:g}: expected the cycles in order, on a clock that is not stepped"
            )
        return n_beyond
