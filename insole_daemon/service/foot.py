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
from ..mechanics.wrench import WrenchEstimator
from ..physics import zero as zeros
from ..physics.static_curve import StaticCurve
from ..skin.boards import BoardSurvey
from ..skin.cycles import Cycles
from ..skin.faults import FaultWatch
from ..skin.geometry import PRESSURE_TAXELS
from ..skin.validity import Validity
from ..wire.messages import CalibrationInUse, Event, Meta, Pressure, Raw, Wrench
from .setup import FootSetup, load_setups

_STANDS_OUT_COUNT = 12  # below what the least loaded tenth of the foot reads; at rest taxels differ by less


class Foot:
    """What the daemon holds for one foot: its setup in use, and how many cycles were published.

    It stays the same object for as long as the daemon runs: whoever holds it reads with the setup of now.
    `calibration` is the one in use: with the baselines of `zero`, where there is one.
    """

    def __init__(self, setup: FootSetup) -> None:
        self.name = setup.insole.foot
        self.n_triangles = len(setup.layout.triangles)
        self.survey = BoardSurvey(setup.layout)
        self.seq = 0
        self.extrapolated = 0  # cycles in which a taxel read beyond what its curve was fitted to
        self.started_ns = time.time_ns()
        self.setup, self._watch = setup, _watch(setup)
        self.use(setup)

    def use(self, setup: FootSetup) -> None:
        """Read with `setup`, of the same boards and triangles, from the next cycle on.

        Numbers of cycles and rates of boards go on, and what is known of faults unless taxels lie elsewhere now.
        Whoever publishes says so in `meta` and `calibration`.
        """
        config = setup.config
        if not np.array_equal(setup.layout.xy_m, self.setup.layout.xy_m):
            self._watch = _watch(setup)
        elif setup.zero is not self.setup.zero:
            self._watch.zeroed()
        self.setup, self.config, self.insole, self.layout = setup, config, setup.insole, setup.layout
        self.calibration, self.zero, self.zero_source = setup.zeroed_calibration, setup.zero, setup.zero_source
        self.stale_after_ns = round(config.publish.stale_after_ms * 1e6)
        boards = {board.address: board for board in setup.insole.boards}
        self.validity = Validity(setup.layout, boards, self.stale_after_ns)
        self._lowest_count = self.calibration.lowest_count
        self._curve = StaticCurve(self.calibration, config.contact.activation_threshold_count)
        self._wrench = WrenchEstimator(setup.layout, config.contact.min_force_n, config.contact.min_pressure_pa)

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
        pressure_pa = self._curve.pressure_pa(counts)
        wrench = self._wrench(pressure_pa, valid, self._curve.variance_pa2(counts))
        age_ms = _age_ms(age_ns)
        valid_mark, missing = valid.view(np.uint8), cycles.missing[at].view(np.uint8)
        repeated = bool(cycles.repeated[at])
        seq, t_ns = self.seq, int(cycles.t_ns[at])
        self.seq += 1
        head = (self.name, seq, self.started_ns, t_ns, time.time_ns(), self.n_triangles)
        return (
            Raw(
                *head, counts, status, cycles.triangle_t_ns[at], age_ms, missing, valid_mark,
                bool(cycles.late[at]), repeated,
            ),
            Pressure(*head, pressure_pa.astype(np.float32), valid_mark, age_ms, missing, repeated),
            Wrench(
                *head, wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm, wrench.cop_x_m, wrench.cop_y_m,
                wrench.f_z_std_n, wrench.m_x_std_nm, wrench.m_y_std_nm, wrench.contact_area_m2,
                wrench.valid_fraction, valid_mark, age_ms, missing, repeated,
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
            xy_m=self.layout.xy_m.astype(np.float32),
            taxel_area_m2=self.layout.taxel_area_m2,
            area_meaning=self.layout.area_meaning,
            layout=str(self.insole.layout or "built-in approximation"),
            layout_builtin=self.layout.builtin,
            calibration=str(self.insole.calibration or "built-in default, 8 kPa per count"),
            calibration_builtin=self.calibration.builtin,
            zero_source=self.zero_source,
            zero=zeros.document(self.zero, self.layout) if self.zero is not None else None,
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


def _watch(setup: FootSetup) -> FaultWatch:
    return FaultWatch(setup.layout, {board.address: board for board in setup.insole.boards})


def _age_ms(age_ns: NDArray[np.int64]) -> NDArray[np.float32]:
    age_ms = (age_ns * 1e-6).astype(np.float32)
    never = age_ns < 0
    if np.count_nonzero(never):
        age_ms[never] = np.nan
    return age_ms
