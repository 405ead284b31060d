"""Make the messages of a foot without effects with the compiled kernel, from the record of a closed cycle to payloads.

The kernel is called twice, with the arithmetic of the centre of pressure in between, and no array is made. The payloads
equal those of `Foot.values` and `Message.encode` to the byte.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..mechanics.static_model import StaticModel
from ..mechanics.wrench import Wrench as WrenchValues
from ..mechanics.wrench import WrenchEstimator
from ..physics.static_curve import StaticCurve
from ..skin.cycles import ClosedCycle
from ..skin.faults import DeferredFaultWatch
from ..wire.messages import Message, Pressure, Raw, Wrench
from ..wire.templates import template

MESSAGES: tuple[type[Message], ...] = (Raw, Pressure, Wrench)


class CycleReading(NamedTuple):
    """The scalar results of reading a cycle; the arrays are in CompiledMessages."""

    is_extrapolated: bool  # a valid taxel reads beyond what its curve was fitted to
    wrench: WrenchValues


class CompiledMessages:
    """Reads the cycles of one foot and packs the messages of the last one.

    `pressure_pa` (n_triangles, 12) float32 and `valid` (n_triangles, 12) uint8 are those of the last cycle.
    """

    def __init__(
        self,
        static: StaticModel,
        curve: StaticCurve,
        wrench: WrenchEstimator,
        watch: DeferredFaultWatch,
        constants: dict[str, Any],
    ) -> None:
        """All arguments belong to one foot; `constants` are the fields of its messages that never change."""
        n = len(watch.masked)
        self._curve, self._wrench = curve, wrench
        self.valid = np.zeros((n, 12), np.uint8)
        self.pressure_pa: NDArray[np.float32] = np.zeros((n, 12), np.float32)
        self._pressure_pa, self._is_valid = np.zeros((n, 12)), self.valid.view(np.bool_)
        age_ms = np.zeros(n, np.float32)
        self._messages = kernel.messages(
            static.reader,
            (watch.masked, watch.top_is_rail, watch.loose, self.valid, self._pressure_pa, self.pressure_pa, age_ms),
            tuple([template(kind, constants) for kind in MESSAGES]),
        )

    def read(self, cycle: ClosedCycle, is_screened: bool) -> CycleReading | None:
        """Read a cycle that has a record; return None if the fault watch must screen it first and has not."""
        sums = kernel.read_record(self._messages, cycle.record, is_screened)
        if sums is None:
            return None
        extrapolated, n_valid, n_in_contact, f_z, m_x, m_y = sums
        variance_pa2 = self._curve.variance_pa2(cycle.cycles.counts[0]) if self._curve.has_variance else None
        wrench = self._wrench.of_sums(
            f_z, m_x, m_y, n_valid, n_in_contact, self._pressure_pa, self._is_valid, variance_pa2
        )
        return CycleReading(bool(extrapolated), wrench)

    def pack(self, cycle: ClosedCycle, reading: CycleReading, seq: int, published_ns: int) -> tuple[bytes, ...]:
        """Return the payloads of the cycle that was read last, in the order of MESSAGES."""
        payloads: tuple[bytes, ...] = kernel.pack_record(
            self._messages, cycle.record, seq, published_ns, reading.wrench
        )
        return payloads
