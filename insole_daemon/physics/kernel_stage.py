"""A stage of a chain as the compiled kernel takes it: the numbers of one operator, for one cycle at a time."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from .law import Array

MOST_STAGES, MOST_TERMS = 16, 64  # as kernel.c has them, and the kinds


class StageKind(IntEnum):
    """The operators that the kernel has, all of them inverses."""

    RELAXATION = 0
    RELAXATION_FROM_REST = 1  # nothing pressed before the first sample
    HYSTERESIS = 2
    LAG = 3


class KernelStage(NamedTuple):
    """One operator with k terms on m columns; `at_once` (1) or (m), `first` and `second` (k, 1) or (k, m)."""

    kind: StageKind
    n_terms: int
    columns: NDArray[np.int64]  # (m,) slots
    neighbours: NDArray[np.int64]  # (m, any number) columns whose mean is taken; (0,) where none is
    at_once: Array
    first: Array
    second: Array
    n_remembered: int  # numbers in its memory

    def with_memory(self) -> tuple[object, ...]:
        """Return the arguments of the kernel, with an empty memory."""
        arrays = (self.columns, self.neighbours, self.at_once, self.first, self.second)
        return (int(self.kind), self.n_terms, *map(np.ascontiguousarray, arrays), np.zeros(self.n_remembered))


@runtime_checkable
class CompiledOperator(Protocol):
    """An operator that the kernel has too."""

    def kernel_stage(self, columns: NDArray[np.intp]) -> KernelStage:
        """Return it as a stage on the slots `columns` (m,)."""
