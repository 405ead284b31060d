"""One emulated MTB4: its sensors, its settings, and the halves it sends on a tick.

Source of the behaviour: robotology/icub-firmware, embot_app_application_theSkin.cpp.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import PRESSURE_TAXELS
from ..skin.identifiers import skin_id
from .digitiser import OPEN_LINE, digitise, halves, low_bytes

PRESSURE_PER_COUNT_PA = 8000.0  # public insole recordings: about 12 counts a bar; the built-in calibration's line
NOISE_COUNT = 0.9  # σ before rounding; public recordings: 0.9 to 1.0 from row to row
SPREAD = 0.03  # σ of the taxels' sensitivities
CLOCK_PPM = 20.0  # σ of the boards' clock rates
RAW_TEST_MODE = 7  # a skin type; the others differ in temperature compensation, which is left out here

_FIRMWARE_NO_LOAD, _FIRMWARE_SHIFT, _FIRMWARE_PERIOD_MS = 245, 2, 50  # what it runs with before any command


class Board:
    """State of one board.

    A sensor's line is raw16 = rest + 2^shift · P / PRESSURE_PER_COUNT_PA, with the shift it was made for,
    whatever shift is commanded later. With the floor of the digitiser the mean count is
    no_load + (1 − 2^−shift)/2 − P / PRESSURE_PER_COUNT_PA.
    """

    def __init__(
        self,
        address: int,
        triangles: Iterable[int],
        *,
        period_ms: int,
        shift: int,
        no_load: int,
        skin_type: int = 0,
        seed: int = 0,
        streaming: bool = True,
    ) -> None:
        """A board with sensors on `triangles` (ascending), the same from the same `seed`.

        `streaming`: comes up sending with these settings, all its triangles enabled; else it is silent and
        has the firmware's settings until commanded.
        """
        self.address = address
        self.triangles = tuple(triangles)
        made = np.random.default_rng([seed, address, 0])
        self._noise = np.random.default_rng([seed, address, 1])
        self._rest_code = np.rint(made.normal(30_000, 1_000, (16, 12)))
        self._code_per_pa = 2.0**shift / PRESSURE_PER_COUNT_PA * (1 + SPREAD * made.standard_normal((16, 12)))
        self._code_per_pa[:, ~PRESSURE_TAXELS] = 0.0
        self._noise_code = NOISE_COUNT * 2.0**shift
        self.clock_rate = 1 + 1e-6 * CLOCK_PPM * made.standard_normal()
        self._phase = made.random()
        self._baseline = np.full((16, 12), OPEN_LINE, np.int64)
        self._baseline[list(self.triangles)] = self._rest_code[list(self.triangles)]

        self.streaming = streaming
        self.zeroed = streaming  # the first skin command after power-up takes the baseline
        self.next_tick_ns: int | None = None  # of the stream; None until it is scheduled
        self.skin_type = skin_type if streaming else 0
        self.no_load = no_load if streaming else _FIRMWARE_NO_LOAD
        self.shift = np.full(16, shift if streaming else _FIRMWARE_SHIFT, np.int64)
        self.period_ns = self._ticks_ns(period_ms if streaming else _FIRMWARE_PERIOD_MS)
        self._enabled = np.full(16, not streaming)
        self.enable(range(16) if not streaming else self.triangles, True)

    def _ticks_ns(self, period_ms: int) -> int:
        return round(period_ms * 1_000_000 * self.clock_rate)

    def power_up(self, t_ns: int) -> None:
        """Schedule the first tick of a board that comes up streaming, with a phase of its own."""
        if self.streaming:
            self.next_tick_ns = t_ns + int(self._phase * self.period_ns)

    def ticks(self, until_ns: int) -> NDArray[np.int64]:
        """The ticks of the stream before `until_ns` that have not been asked for yet."""
        if not self.streaming or self.next_tick_ns is None:
            return np.empty(0, np.int64)
        due = np.arange(self.next_tick_ns, until_ns, self.period_ns)
        self.next_tick_ns += len(due) * self.period_ns
        return due

    def halves(self, pressure_pa: NDArray[np.float64]) -> NDArray[np.uint8]:
        """(n_ticks, 2 · n_enabled, 8) payloads under `pressure_pa` (n_ticks, n_triangles, 12)."""
        slots = self._slots
        raw16 = self._raw16(pressure_pa, slots)
        if self.skin_type == RAW_TEST_MODE:
            counts, status = low_bytes(raw16)
        else:
            counts, status = digitise(raw16, self._baseline[slots], self.no_load, self.shift[slots, None])
        return halves(counts, status).reshape(len(pressure_pa), -1, 8)

    @property
    def can_ids(self) -> NDArray[np.uint32]:
        """(2 · n_enabled,) identifiers of one tick's frames: triangles ascending, A then B."""
        return self._can_ids

    def configure(self, skin_type: int, period_ms: int, no_load: int, t_ns: int) -> None:
        """Board configuration: disables every triangle; a running stream starts anew with the period."""
        self.skin_type = skin_type
        self.no_load = no_load
        if period_ms:  # what real boards do with 0 is not known
            self.period_ns = self._ticks_ns(period_ms)
        self.enable(range(16), False)
        self.next_tick_ns = t_ns + self.period_ns

    def enable(self, triangles: Iterable[int], enabled: bool) -> None:
        """Let triangles take part in the stream, or not; those without a sensor read as open lines."""
        self._enabled[list(triangles)] = enabled
        self._slots = np.flatnonzero(self._enabled)
        self._can_ids = np.repeat(skin_id(self.address, 0) + self._slots, 2).astype(np.uint32)

    def transmit(self, on: bool, t_ns: int) -> None:
        """Start or stop the stream."""
        self.streaming = on
        self.next_tick_ns = t_ns + self.period_ns

    def zero(self, pressure_pa: NDArray[np.float64]) -> None:
        """Take the baseline of all triangles from one reading, under whatever load (n_triangles, 12)."""
        self._baseline = self._raw16(pressure_pa[None], np.arange(16))[0]
        self.zeroed = True

    def _raw16(self, pressure_pa: NDArray[np.float64], slots: NDArray[np.intp]) -> NDArray[np.int64]:
        """(n_ticks, n_slots, 12) words of the converters."""
        there = np.isin(slots, self.triangles)
        slots = slots[there]
        load = pressure_pa[:, np.searchsorted(self.triangles, slots)]
        code = self._noise.standard_normal(load.shape)
        code *= self._noise_code
        code += load * self._code_per_pa[slots]
        code += self._rest_code[slots]
        code = np.rint(code, out=code).clip(0, OPEN_LINE)
        if there.all():
            return code.astype(np.int64)
        raw16 = np.full((len(load), len(there), 12), OPEN_LINE, np.int64)
        raw16[:, there] = code
        return raw16
