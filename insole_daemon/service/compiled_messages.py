"""Make the messages of a foot with the compiled kernel, from the record of a closed cycle to payloads.

The kernel is called twice, and twice more for the dynamic model, with the arithmetic of the centre of pressure in
between, and no array is made. The payloads equal those of `Foot.values` and `Message.encode` to the byte.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..mechanics.static_model import StaticModel
from ..mechanics.wrench import WrenchEstimator
from ..physics.static_curve import StaticCurve
from ..skin.cycles import ClosedCycle, counts_of_record
from ..skin.faults import DeferredFaultWatch
from ..wire.messages import Message, Models, Pressure, Raw, Wrench
from ..wire.templates import template
from .dynamic_foot import DynamicFoot


class CycleReading(NamedTuple):
    """The scalar results of reading a cycle; the arrays are in CompiledMessages."""

    is_extrapolated: bool  # a valid taxel reads beyond what its curve was fitted to
    is_beyond: bool  # a published pressure is beyond the range of the effects
    t_ns: int  # of the load, by the model in use
    f_z_n: float  # the same; NaN: not known
    numbers: tuple[float, ...]  # of the messages, as the kernel packs them


class CompiledMessages:
    """Reads the cycles of one foot and packs the messages of the last one.

    `pressure_pa` (n_triangles, 12) float32, by the model in use, and `valid` (n_triangles, 12) uint8 are those of the
    last cycle. `kinds` are the messages in the order in which they are packed and published.
    """

    def __init__(
        self,
        static: StaticModel,
        curve: StaticCurve,
        wrench: WrenchEstimator,
        dynamic: DynamicFoot | None,
        watch: DeferredFaultWatch,
        constants: dict[str, Any],
    ) -> None:
        """All arguments belong to one foot; `constants` are the fields of its messages that never change.

        A dynamic model must be one that the kernel has.
        """
        n = len(watch.masked)
        self._curve, self._wrench, self._dynamic = curve, wrench, dynamic
        self._publishes_dynamic = constants["model"] == "dynamic"
        self.valid = np.zeros((n, 12), np.uint8)
        self._static_pa, self._load_pa, self._is_valid = np.zeros((n, 12)), np.zeros((n, 12)), self.valid.view(np.bool_)
        static_f4, self._load_f4 = np.zeros((2, n, 12), np.float32)
        self._beyond = np.zeros((n, 12), np.uint8)
        self.pressure_pa: NDArray[np.float32] = self._load_f4 if self._publishes_dynamic else static_f4
        self.kinds: tuple[type[Message], ...] = (
            (Raw, Pressure, Wrench) if dynamic is None else (Models, Raw, Pressure, Wrench)
        )
        if not self._publishes_dynamic:
            constants = constants | {"beyond_fraction": 0.0}
        self._late_ns = 0 if dynamic is None else dynamic.common_ns
        self._messages = kernel.messages(
            static.reader,
            (
                watch.masked, watch.top_is_rail, watch.loose, self.valid, self._static_pa, static_f4,
                np.zeros(n, np.float32), self._load_f4, self._beyond,
            ),
            tuple([template(kind, self._constants(kind, constants), self._publishes_dynamic) for kind in self.kinds]),
            self._late_ns,
        )  # fmt: skip

    def _constants(self, kind: type[Message], constants: dict[str, Any]) -> dict[str, Any]:
        """Return the constant fields of `kind`; nothing is beyond the range of the static curves."""
        if kind is Models or self._publishes_dynamic:
            return constants
        return constants | {"beyond": np.zeros_like(self._beyond)}

    def read(self, cycle: ClosedCycle, is_screened: bool) -> CycleReading | None:
        """Read a cycle that has a record; return None if the fault watch must screen it first and has not."""
        sums = kernel.read_record(self._messages, cycle.record, is_screened)
        if sums is None:
            return None
        extrapolated, n_valid, n_in_contact, f_z, m_x, m_y = sums
        variance_pa2 = self._curve.variance_pa2(cycle.cycles.counts[0]) if self._curve.has_variance else None
        wrench = self._wrench.of_sums(
            f_z, m_x, m_y, n_valid, n_in_contact, self._static_pa, self._is_valid, variance_pa2
        )
        if self._dynamic is None:
            return CycleReading(bool(extrapolated), False, cycle.t_ns, wrench.f_z_n, wrench)
        n_beyond = self._dynamic.invert(
            cycle.t_mono_ns,
            cycle.t_ns,
            self._static_pa,
            counts_of_record(cycle),
            self._is_valid,
            self._load_pa,
            self._beyond,
        )
        load = self._dynamic.wrench(self._load_pa, self._is_valid, variance_pa2, self._load_f4)
        if not self._publishes_dynamic:
            return CycleReading(bool(extrapolated), False, cycle.t_ns, wrench.f_z_n, (*wrench, *load))
        numbers = (*wrench, *load, n_beyond / n_valid if n_beyond else 0.0)
        return CycleReading(bool(extrapolated), n_beyond > 0, cycle.t_ns - self._late_ns, load.f_z_n, numbers)

    def pack(
        self, cycle: ClosedCycle, reading: CycleReading, seq: int, published_ns: int
    ) -> tuple[tuple[type[Message], bytes], ...]:
        """Return kind and payload of each message of the cycle that was read last."""
        payloads = kernel.pack_record(self._messages, cycle.record, seq, published_ns, reading.numbers)
        return tuple(zip(self.kinds, payloads, strict=True))
