"""One foot on the live path: its cycles into the three messages of a cycle."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..config import Config
from ..physics import zero as zeros
from ..physics.dynamic import DynamicModel
from ..skin.boards import BoardSurvey
from ..skin.cycles import Cycles
from ..skin.geometry import PRESSURE_TAXELS
from ..wire.messages import CalibrationInUse, Event, Meta, ModelName, Models, Pressure, Raw, Wrench
from .both_models import Estimate, side_by_side
from .outfit import Outfit
from .setup import FootSetup, load_setups

_STANDS_OUT_COUNT = 12  # below what the least loaded tenth of the foot reads; at rest taxels differ by less


class Foot:
    """What the daemon holds for one foot: its setup in use, and how many cycles were published.

    It stays the same object for as long as the daemon runs: whoever holds it reads with the setup of now.
    `calibration` is the one in use: with the baselines of `zero`, where there is one. `models` is the last cycle of
    `messages` by both models, None where the calibration has no effects.
    """

    def __init__(self, setup: FootSetup) -> None:
        self.name = setup.insole.foot
        self.n_triangles = len(setup.layout.triangles)
        self.survey = BoardSurvey(setup.layout)
        self.seq = 0
        self.extrapolated = 0  # cycles in which a taxel read beyond what its curve was fitted to
        self.beyond = 0  # cycles of the dynamic model in which a taxel read beyond what its effects were identified to
        self.models: Models | None = None
        self._asked: ModelName = setup.insole.model
        self.started_ns = time.time_ns()
        outfit = Outfit.of(setup)
        self._watch, self._dynamic = outfit.watch, outfit.dynamic
        self._put_on(outfit)

    def use(self, outfit: Outfit) -> None:
        """Read with `outfit`, made to follow the setup in use, from the next cycle on.

        Numbers of cycles and rates of boards go on, and what is known of faults unless taxels lie elsewhere now. What
        the dynamic model remembers goes on unless layout, calibration or zero are other ones: then it begins anew.
        Whoever publishes says so in `meta` and `calibration`.
        """
        setup, before = outfit.setup, self.setup
        assert outfit.before is before, "it was made to follow another setup"
        if setup.insole.model != before.insole.model:
            self._asked = setup.insole.model
        if outfit.dynamic is not None and self._dynamic is not None and not outfit.differences:
            outfit.dynamic.go_on(self._dynamic)
        self._dynamic = outfit.dynamic
        if outfit.moved:
            self._watch = outfit.watch
        elif setup.zero is not before.zero:
            self._watch.zeroed()
        self._put_on(outfit)

    def _put_on(self, outfit: Outfit) -> None:
        """What remembers nothing."""
        setup = self.setup = outfit.setup
        self.config, self.insole, self.layout = setup.config, setup.insole, setup.layout
        self.calibration, self.zero, self.zero_source = outfit.calibration, setup.zero, setup.zero_source
        self.stale_after_ns = round(setup.config.publish.stale_after_ms * 1e6)
        self.validity, self._curve, self._wrench = outfit.validity, outfit.curve, outfit.wrench
        self._lowest_count = self.calibration.lowest_count
        self._none = np.zeros(self.calibration.usable.shape, np.bool_)

    @property
    def model(self) -> ModelName:
        """The model whose pressure and wrench are published."""
        return "static" if self._dynamic is None else self._asked

    def switch(self, model: ModelName) -> None:
        """Publish by `model` from the next cycle on; without effects both are the static one."""
        self._asked = model

    def watch(self, cycles: Cycles, at: int) -> list[Event]:
        """Look for faults in cycle `at`: to be called with every cycle, once its messages are out.

        What is found enters no later cycle; loose triangles do not even enter this one.
        """
        return [
            Event(self.name, change.t_ns, change.event, change.text, [change.board], change.triangle, change.taxel)
            for change in self._watch.update(cycles, at)
        ]

    def faults(self) -> list[dict[str, Any]]:
        """What is wrong now, the longest first; as in health."""
        return [dataclasses.asdict(fault) for fault in self._watch.faults]

    def messages(self, cycles: Cycles, at: int) -> tuple[Raw, Pressure, Wrench]:
        """The messages of cycle `at`; each call is one cycle published."""
        self._watch.screen(cycles, at)
        counts, status, age_ns = cycles.counts[at], cycles.status[at], cycles.age_ns[at]
        valid = self.validity(counts, status, age_ns) & self._curve.usable & ~self._watch.masked
        if self._lowest_count is not None and np.count_nonzero((counts < self._lowest_count) & valid):
            self.extrapolated += 1
        pressure_pa, variance_pa2 = self._curve.pressure_pa(counts), self._curve.variance_pa2(counts)
        t_ns, repeated = int(cycles.t_ns[at]), bool(cycles.repeated[at])
        static = Estimate(t_ns, age_ns, pressure_pa, valid, self._none, self._wrench(pressure_pa, valid, variance_pa2))
        used, dynamic = static, None
        if self._dynamic is not None:
            dynamic = self._dynamic(cycles, at, pressure_pa, valid, variance_pa2)
            if self.model == "dynamic":
                used = dynamic
                self.beyond += bool(np.count_nonzero(dynamic.beyond))
        age_ms, missing = _age_ms(age_ns), cycles.missing[at].view(np.uint8)
        wrench, own_valid, own_age_ms = used.wrench, used.valid.view(np.uint8), age_ms
        if used is not static:
            own_age_ms = _age_ms(used.age_ns)
        seq, published_ns = self.seq, time.time_ns()
        self.seq += 1
        self.models = None
        if dynamic is not None:
            head = (self.name, seq, self.started_ns, published_ns, self.n_triangles)
            self.models = side_by_side(head, self.model, static, dynamic, repeated)
        own = (self.name, seq, self.started_ns, used.t_ns, published_ns, self.n_triangles)
        return (
            Raw(
                self.name, seq, self.started_ns, t_ns, published_ns, self.n_triangles, counts, status,
                cycles.triangle_t_ns[at], age_ms, missing, valid.view(np.uint8), bool(cycles.late[at]), repeated,
            ),
            Pressure(
                *own, used.pressure_pa.astype(np.float32), own_valid, own_age_ms, missing, repeated,
                self.model, used.beyond.view(np.uint8),
            ),
            Wrench(
                *own, wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm, wrench.cop_x_m, wrench.cop_y_m,
                wrench.f_z_std_n, wrench.m_x_std_nm, wrench.m_y_std_nm, wrench.contact_area_m2,
                wrench.valid_fraction, own_valid, own_age_ms, missing, repeated,
                self.model, _share(used.beyond, used.valid),
            ),
        )  # fmt: skip

    def load(self, cycles: Cycles, at: int, without: Collection[int] = ()) -> tuple[float | None, float]:
        """What presses on the foot in cycle `at`, boards `without` left out: (f_z, share of taxels that stand out).

        f_z in N is None where no taxel is valid. Taxels that stand out read far more pressure than the
        least loaded ones; that holds whatever no-load and shift the boards run with, which f_z does not.
        """
        counts, status, age_ns = cycles.counts[at], cycles.status[at], cycles.age_ns[at]
        asked = np.array([triangle.board not in without for triangle in self.layout.triangles])
        asked &= ~self._watch.masked.all(axis=1)
        valid = self.validity(counts, status, age_ns) & self._curve.usable & asked[:, None]
        f_z_n = self._wrench(self._curve.pressure_pa(counts), valid, None).f_z_n
        read = counts[asked & (age_ns >= 0) & (age_ns <= self.stale_after_ns) & (status & 0xF == 0)]
        read = read[:, PRESSURE_TAXELS].astype(np.float64)
        low = float(np.mean(read < np.percentile(read, 90) - _STANDS_OUT_COUNT)) if read.size else 0.0
        return None if math.isnan(f_z_n) else f_z_n, low

    def meta(self) -> Meta:
        """What one must know to read the messages."""
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
            late_ms=np.zeros(self.n_triangles, np.float32) if dynamic is None else _age_ms(dynamic.late_ns),
            activation_threshold_count=contact.activation_threshold_count,
            min_force_n=contact.min_force_n,
            min_pressure_pa=contact.min_pressure_pa,
            rate_hz=publish.rate_hz,
            slack_ms=publish.slack_ms,
            stale_after_ms=publish.stale_after_ms,
        )

    def calibration_in_use(self) -> CalibrationInUse:
        """The static curve as it is applied."""
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
    """The feet of `config` with their files; raises DocumentsError with what is wrong in any of them."""
    return [Foot(setup) for setup in load_setups(config)]


def _effects(model: DynamicModel) -> list[dict[str, Any]]:
    """As in meta."""
    why = {each.effect: each.why for each in model.left_out}
    return [
        {
            "effect": each.law.word,
            "scope": each.where.scope,
            "ids": [list(identity) for identity in each.where.ids],
            "left_out": why.get(each),
        }
        for each in (*model.effects, *why)
    ]


def _share(beyond: NDArray[np.bool_], valid: NDArray[np.bool_]) -> float:
    """Of the valid taxels."""
    n = int(np.count_nonzero(beyond))
    return n / int(np.count_nonzero(valid)) if n else 0.0


def _age_ms(age_ns: NDArray[np.int64]) -> NDArray[np.float32]:
    age_ms = (age_ns * 1e-6).astype(np.float32)
    never = age_ns < 0
    if np.count_nonzero(never):
        age_ms[never] = np.nan
    return age_ms
