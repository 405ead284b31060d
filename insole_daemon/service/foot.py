"""One foot on the live path: turn its cycles into messages."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..compiled import kernel
from ..config import Config
from ..mechanics.static_model import age_in_ms
from ..physics import zero as zeros
from ..physics.dynamic import DynamicModel
from ..skin.boards import BoardSurvey
from ..skin.cycles import ClosedCycle, Cycles
from ..skin.geometry import PRESSURE_TAXELS
from ..wire.messages import CalibrationInUse, Event, Message, Meta, ModelName, Models, Pressure, Raw, Wrench
from .compiled_messages import CompiledMessages
from .dynamic_foot import side_by_side
from .foot_pipeline import FootPipeline
from .foot_setup import FootSetup, load_setups

_LOADED_COUNT = 12  # below the reading of the least loaded tenth of the foot; at rest taxels differ by less


class CycleMessages(NamedTuple):
    """All messages of one cycle of one foot."""

    raw: Raw
    pressure: Pressure
    wrench: Wrench
    models: Models | None  # None: the calibration has no effects

    def published(self) -> tuple[Message, ...]:
        """Return the messages in the order in which they are published."""
        return self[:3] if self.models is None else (self.models, *self[:3])


class PublishedLoad(NamedTuple):
    """The load on a foot in one cycle, by the model in use."""

    t_ns: int  # CLOCK_REALTIME
    f_z_n: float  # NaN: not known
    pressure_pa: NDArray[np.float32]  # (n_triangles, 12)
    valid: NDArray[np.uint8]  # (n_triangles, 12)
    repeated: bool


class CyclePayloads(NamedTuple):
    """One cycle of one foot, ready to be published."""

    payloads: Sequence[tuple[type[Message], bytes]]  # kind and payload of each message, in the order of publishing
    load: PublishedLoad  # its arrays are overwritten by the next cycle


class CycleValues(NamedTuple):
    """The values of the fields of one cycle's messages, in order.

    They are packed without an object per message, which would take as long as computing the values.
    """

    raw: tuple[Any, ...]
    pressure: tuple[Any, ...]
    wrench: tuple[Any, ...]
    models: Models | None
    load: PublishedLoad

    def payloads(self) -> list[tuple[type[Message], bytes]]:
        """Return kind and payload of each message, in the order in which they are published."""
        models: list[tuple[type[Message], bytes]] = [] if self.models is None else [(Models, self.models.encode())]
        return [
            *models,
            (Raw, Raw.encode_values(self.raw)),
            (Pressure, Pressure.encode_values(self.pressure)),
            (Wrench, Wrench.encode_values(self.wrench)),
        ]

    def messages(self) -> CycleMessages:
        """Return the values as messages."""
        return CycleMessages(Raw(*self.raw), Pressure(*self.pressure), Wrench(*self.wrench), self.models)


class Foot:
    """The state of one foot in the daemon: the pipeline in use and the number of published cycles.

    The object stays the same as long as the daemon runs, and a reload replaces its pipeline. `calibration` is the one
    in use, with the baselines of `zero` if there is a zero.
    """

    def __init__(self, setup: FootSetup) -> None:
        self.name = setup.insole.foot
        self.n_triangles = len(setup.layout.triangles)
        self.survey = BoardSurvey(setup.layout)
        self.seq = 0
        self.extrapolated = 0  # cycles with a taxel beyond the range on which its curve was fitted
        self.beyond = 0  # cycles of the dynamic model with a taxel beyond the range of its effects
        self._asked: ModelName = setup.insole.model
        self.started_ns = time.time_ns()
        pipeline = FootPipeline.of(setup)
        self._watch, self._dynamic = pipeline.watch, pipeline.dynamic
        self._install(pipeline)

    def replace_pipeline(self, pipeline: FootPipeline) -> None:
        """Use `pipeline`, which was made to follow the setup in use, from the next cycle on.

        Sequence numbers, rates and fault state continue; the fault state is reset if the layout moved taxels. The state
        of the dynamic model continues unless layout, calibration or zero changed. The caller publishes `meta` and
        `calibration` again.
        """
        setup, before = pipeline.setup, self.setup
        assert pipeline.before is before, "it was made to follow another setup"
        if setup.insole.model != before.insole.model:
            self._asked = setup.insole.model
        if pipeline.dynamic is not None and self._dynamic is not None and not pipeline.differences:
            pipeline.dynamic.take_state(self._dynamic)
        self._dynamic = pipeline.dynamic
        if pipeline.moved:
            self._watch = pipeline.watch
        elif setup.zero is not before.zero:
            self._watch.zeroed()
        self._install(pipeline)

    def _install(self, pipeline: FootPipeline) -> None:
        """Replace everything that has no state."""
        setup = self.setup = pipeline.setup
        self.config, self.insole, self.layout = setup.config, setup.insole, setup.layout
        self.calibration, self.zero, self.zero_source = pipeline.calibration, setup.zero, setup.zero_source
        self.stale_after_ns = round(setup.config.publish.stale_after_ms * 1e6)
        self.validity, self._curve, self._wrench = pipeline.validity, pipeline.curve, pipeline.wrench
        self._static = pipeline.static
        self._nowhere = np.zeros(self.calibration.usable.shape, np.uint8)
        self._compiled = self._compile()

    def _compile(self) -> CompiledMessages | None:
        """Return the messages by the kernel; None without it, or if it has not all effects of the calibration."""
        if kernel is None or not (self._dynamic is None or self._dynamic.is_compiled):
            return None
        constants = {
            "foot": self.name, "started_ns": self.started_ns, "n_triangles": self.n_triangles, "model": self.model,
        }  # fmt: skip
        return CompiledMessages(self._static, self._curve, self._wrench, self._dynamic, self._watch, constants)

    @property
    def model(self) -> ModelName:
        """The model whose pressure and wrench are published."""
        return "static" if self._dynamic is None else self._asked

    def switch(self, model: ModelName) -> None:
        """Publish the estimates of `model` from the next cycle on; without effects, both are the static one."""
        self._asked = model
        self._compiled = self._compile()

    def payloads(self, cycle: ClosedCycle) -> CyclePayloads:
        """Return the payloads of `cycle`, the next one in order; each call counts as one published cycle."""
        compiled = self._compiled
        if compiled is None or cycle.record is None:
            values = self.values(*cycle.row)
            return CyclePayloads(values.payloads(), values.load)
        reading = compiled.read(cycle, False)
        self._watch.gather(cycle, reading is None)
        if reading is None:
            reading = compiled.read(cycle, True)
            assert reading is not None
        self.extrapolated += reading.is_extrapolated
        self.beyond += reading.is_beyond
        payloads = compiled.pack(cycle, reading, self.seq, time.time_ns())
        self.seq += 1
        load = PublishedLoad(reading.t_ns, reading.f_z_n, compiled.pressure_pa, compiled.valid, cycle.is_repeated)
        return CyclePayloads(payloads, load)

    def messages(self, cycles: Cycles, at: int) -> CycleMessages:
        """Return the messages of cycle `at`; see `values`."""
        return self.values(cycles, at).messages()

    def values(self, cycles: Cycles, at: int) -> CycleValues:
        """Return the values of the messages of cycle `at`, the next in order; each call counts as a published cycle."""
        self._watch.take(cycles, at)
        counts, status, age_ns = cycles.counts[at], cycles.status[at], cycles.age_ns[at]
        static = self._static(counts, status, age_ns, self._watch.masked)
        self.extrapolated += static.extrapolated
        load = None if self._dynamic is None else self._dynamic(cycles, at, static)
        t_ns, repeated = int(cycles.t_ns[at]), bool(cycles.repeated[at])
        head = (self.name, self.seq, self.started_ns)
        published_ns, n_triangles = time.time_ns(), self.n_triangles
        self.seq += 1
        valid, missing = static.valid.view(np.uint8), cycles.missing[at].view(np.uint8)
        raw = (
            *head, t_ns, published_ns, n_triangles, counts, status, cycles.triangle_t_ns[at], static.age_ms, missing,
            valid, bool(cycles.late[at]), repeated,
        )  # fmt: skip
        models = None
        if load is not None:
            models = side_by_side(Raw(*raw), self.model, static, load)
        if load is None or models is None or self.model == "static":
            pressure_pa, sums, age_ms = static.pressure_pa_f4, static.wrench, static.age_ms
            beyond, beyond_fraction = self._nowhere, 0.0
        else:
            t_ns, pressure_pa, sums, age_ms = load.t_ns, models.dynamic_pressure_pa, load.wrench, load.age_ms
            beyond, beyond_fraction, valid = models.beyond, _share(load.beyond, load.valid), models.dynamic_valid
            self.beyond += bool(np.count_nonzero(beyond))
        of_load = (*head, t_ns, published_ns, n_triangles)
        pressure = (*of_load, pressure_pa, valid, age_ms, missing, repeated, self.model, beyond)
        wrench = (*of_load, *sums, valid, age_ms, missing, repeated, self.model, beyond_fraction)
        return CycleValues(raw, pressure, wrench, models, PublishedLoad(t_ns, sums.f_z_n, pressure_pa, valid, repeated))

    def skip(self, cycle: ClosedCycle) -> None:
        """Pass `cycle`, which is not published, to the fault watch."""
        self._watch.take(*cycle.row)

    @property
    def is_watch_due(self) -> bool:
        """Whether the next call of `fault_events` examines the cycles passed to the fault watch."""
        return self._watch.is_due

    def fault_events(self, early: bool = False) -> list[Event]:
        """Return events of faults that began or ended; unless `early`, the latest may come with a later call."""
        return [
            Event(self.name, change.t_ns, change.event, change.text, [change.board], change.triangle, change.taxel)
            for change in self._watch.changes(early)
        ]

    def faults(self) -> list[dict[str, Any]]:
        """Return the present faults as in health, the longest-lasting first."""
        return [dataclasses.asdict(fault) for fault in self._watch.faults]

    def load(self, cycles: Cycles, at: int, without: Collection[int] = ()) -> tuple[float | None, float]:
        """Return (f_z in N, share of loaded taxels) in cycle `at`, without the boards in `without`.

        f_z is None if no taxel is valid. A loaded taxel reads far more pressure than the least loaded ones. Unlike f_z,
        that share does not depend on the no-load and the shift that the boards run with.
        """
        counts, status, age_ns = cycles.counts[at], cycles.status[at], cycles.age_ns[at]
        asked = np.array([triangle.board not in without for triangle in self.layout.triangles])
        asked &= ~self._watch.masked.all(axis=1)
        valid = self.validity(counts, status, age_ns) & self._curve.usable & asked[:, None]
        f_z_n = self._wrench(self._curve.pressure_pa(counts), valid, None).f_z_n
        read = counts[asked & (age_ns >= 0) & (age_ns <= self.stale_after_ns) & (status & 0xF == 0)]
        read = read[:, PRESSURE_TAXELS].astype(np.float64)
        low = float(np.mean(read < np.percentile(read, 90) - _LOADED_COUNT)) if read.size else 0.0
        return None if math.isnan(f_z_n) else f_z_n, low

    def meta(self) -> Meta:
        """Return what a subscriber needs to interpret the messages."""
        publish, contact = self.config.publish, self.config.contact
        dynamic = None if self._dynamic is None else self._dynamic.model
        xy_m = self.layout.xy_m if dynamic is None or self.model == "static" else dynamic.xy_m
        return Meta(
            foot=self.name,
            rig=self.config.rig,
            version=__version__,
            started_ns=self.started_ns,
            n_triangles=self.n_triangles,
            triangles=[{"board": t.board, "triangle": t.triangle, "patch": t.patch} for t in self.layout.triangles],
            boards=[
                {
                    "address": board.address,
                    "interface": board.interface,
                    "period_ms": board.period_ms,
                    "shift": board.shift,
                    "no_load": board.no_load,
                    "skin_type": board.skin_type,
                }
                for board in self.insole.boards
            ],
            xy_m=xy_m.astype(np.float32),
            taxel_area_m2=self.layout.taxel_area_m2,
            area_meaning=self.layout.area_meaning,
            layout=str(self.insole.layout or "built-in approximation"),
            layout_builtin=self.layout.builtin,
            calibration=str(self.insole.calibration or "built-in default, 8 kPa per count"),
            calibration_builtin=self.calibration.builtin,
            zero_source=self.zero_source,
            zero=zeros.document(self.zero, self.layout) if self.zero is not None else None,
            model=self.model,
            effects=[] if dynamic is None else _effects(dynamic),
            late_ms=np.zeros(self.n_triangles, np.float32) if dynamic is None else age_in_ms(dynamic.late_ns),
            activation_threshold_count=contact.activation_threshold_count,
            min_force_n=contact.min_force_n,
            min_pressure_pa=contact.min_pressure_pa,
            rate_hz=publish.rate_hz,
            slack_ms=publish.slack_ms,
            stale_after_ms=publish.stale_after_ms,
        )

    def calibration_in_use(self) -> CalibrationInUse:
        """Return the static curve in use."""
        return CalibrationInUse(
            foot=self.name,
            n_triangles=self.n_triangles,
            n_coefficients=self.calibration.coefficients_pa.shape[-1],
            source=str(self.insole.calibration or "built-in default, 8 kPa per count"),
            builtin=self.calibration.builtin,
            baseline_count=self.calibration.baseline_count,
            coefficients_pa=self.calibration.coefficients_pa,
            usable=self.calibration.usable.view(np.uint8),
            provenance=dict(self.calibration.provenance),
        )


def load_feet(config: Config) -> list[Foot]:
    """Load the feet of `config` with their files; raises DocumentsError with the problems of all files."""
    return [Foot(setup) for setup in load_setups(config)]


def _effects(model: DynamicModel) -> list[dict[str, Any]]:
    """Return the effects of `model` as in meta."""
    why = {left_out.effect: left_out.why for left_out in model.left_out}
    return [
        {
            "effect": effect.law.word,
            "scope": effect.where.scope,
            "ids": [list(identity) for identity in effect.where.ids],
            "left_out": why.get(effect),
        }
        for effect in (*model.effects, *why)
    ]


def _share(beyond: NDArray[np.bool_], valid: NDArray[np.bool_]) -> float:
    """Return the share of the valid taxels that are beyond."""
    n = int(np.count_nonzero(beyond))
    return n / int(np.count_nonzero(valid)) if n else 0.0
