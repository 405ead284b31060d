"""One emulated board: its settings, its baseline, and the halves that it sends at a tick.

sensors.py has the sensors' words, physics/digitiser.py their conversion by the firmware, generation.py the differences
between the two generations. Source of the behaviour: robotology/icub-firmware, embot_app_application_theSkin.cpp
(MTB4), mtb3/main_V3.c and can_interface.c (MTB3).

A new baseline is one reading. An MTB4 takes it at once; an MTB3 uses three ticks of its stream: it begins at the first,
reads at the second and has stored the reading at the third. Both take one by themselves after five errors (a triangle
reads 0 at a tick, although its baseline is not 0), counted over the whole board and never reset.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.digitiser import OPEN_LINE, digitise, low_bytes
from ..skin.identifiers import CLASS_LEGACY_SKIN, CLASS_SKIN, ERROR_NO_ACK, skin_id
from .faults import BoardEvent, InjectedFault, board_events
from .generation import MTB4, Generation
from .halves import halves
from .reference_insole import reference_insole
from .sensors import Sensors, Temperature
from .thermometer import Thermometer, thermometer_frame

RAW_TEST_MODE = 7  # number of a skin type

_FIRMWARE_NO_LOAD, _FIRMWARE_SHIFT, _FIRMWARE_PERIOD_MS = 245, 2, 50  # settings before any command
_ERRORS_TO_ZERO = 5
_STORES_AT = 2  # remaining ticks of an MTB3's calibration at which it reads
_TICK_OF_TIMER_NS = 3200  # tick of an MTB3's timer; its period has 16 bits, so it wraps above 209 ms


@dataclass(frozen=True, slots=True)
class _Settings:
    """The settings that are lost with the power."""

    streaming: bool
    skin_type: int
    no_load: int
    shift: NDArray[np.int64]
    enabled: NDArray[np.bool_]
    period_ns: int
    cls: int


class EmulatedBoard:
    """State of one board since its power-up."""

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
        generation: Generation = MTB4,
        compensated: bool = False,
        faults: Sequence[InjectedFault] = (),
        status_bits: bool = True,
        cdc_hz: float | None = None,
        temperature_c: Temperature | None = None,
        noise_key: int = 0,
        nominal_sensors: bool = False,
        real_shifts: Mapping[int, int] | None = None,
        noise: float = 1.0,
    ) -> None:
        """Create a board with sensors on `triangles` (ascending); the same `seed` gives the same board.

        `streaming`: it starts sending with these settings and all its triangles enabled; otherwise it is silent, with
        the firmware's settings, until commanded. `compensated`: the temperature compensation of its skin type works.
        `status_bits` False: the status of every half B is 0. `real_shifts`: by triangle, shifts that differ from the
        configured `shift` until a command sets them. For the other arguments see Sensors and InjectedFault.
        """
        self.node = address  # identity of the board, whatever address it uses
        self.address = address
        self.generation = generation
        self.sensors = Sensors(
            address, triangles, shift, seed, faults, cdc_hz, temperature_c, noise_key, nominal_sensors, noise
        )
        self.triangles = self.sensors.triangles
        self.clock_rate = 1 + 1e-6 * reference_insole().clock_ppm * float(self.sensors.draws.normal(1)[0])
        self._phase_fraction = float(self.sensors.draws.uniform(1)[0])
        self._compensated = compensated
        self._status_bits = status_bits
        self._faults = tuple(faults)
        self._events: list[tuple[int, BoardEvent | None]] = []  # None: an MTB3 takes its first baseline after power-up
        self._power_up_ns = 0
        self._errors = 0
        self._calibration_ticks_left = 0  # 0: not calibrating
        self._streams_after_calibration = True
        self._takes_baseline_at_next_tick = False
        self._settings_before_reset: _Settings | None = None
        self.is_disconnected = False  # neither sends nor receives
        self.thermometer = Thermometer()

        self._baseline = np.full((16, 12), OPEN_LINE, np.int64)
        self._baseline[list(self.triangles)] = self.sensors.unloaded_words()[list(self.triangles)]
        self._reset_to_firmware_settings()
        if streaming:
            self.streaming = True
            self.zeroed = True
            self.skin_type = skin_type
            self.no_load = no_load
            self.shift = np.full(16, shift, np.int64)
            for triangle, real_shift in (real_shifts or {}).items():
                self.shift[triangle] = real_shift
            self.period_ns = self._actual_period_ns(period_ms)
            self.cls = CLASS_SKIN
            self._enabled = np.zeros(16, bool)
            self.enable(self.triangles, True)

    def _reset_to_firmware_settings(self) -> None:
        """Set the settings that the firmware has before any command."""
        self.streaming = False
        self.zeroed = False  # at the first skin command after power-up an MTB4 takes its baseline
        self.next_tick_ns: int | None = None  # next tick of the stream; None: not scheduled
        self.skin_type = 0
        self.no_load = _FIRMWARE_NO_LOAD
        self.shift = np.full(16, _FIRMWARE_SHIFT, np.int64)
        self.period_ns = self._actual_period_ns(_FIRMWARE_PERIOD_MS)
        self.cls = CLASS_LEGACY_SKIN if self.generation.legacy_stream else CLASS_SKIN
        self._enabled = np.zeros(16, bool)
        self.enable(range(16), True)

    def _actual_period_ns(self, period_ms: int) -> int:
        nominal_ns = period_ms * 1_000_000
        if self.generation.is_16_bit:
            nominal_ns = max((nominal_ns // _TICK_OF_TIMER_NS & 0xFFFF) * _TICK_OF_TIMER_NS, _shortest_period_ns())
        return round(nominal_ns * self.clock_rate)

    # ---- time

    def power_up(self, t_ns: int) -> None:
        """Schedule its faults, and the first tick if it starts streaming, with the phase of this board."""
        self._power_up_ns = t_ns
        self._events = [(t_ns + round(event.t_s * 1e9), event) for event in board_events(self.node, self._faults)]
        if self.streaming:
            self.next_tick_ns = t_ns + int(self._phase_fraction * self.period_ns)
        else:
            self._schedule_first_baseline(t_ns)

    def _schedule_first_baseline(self, t_ns: int) -> None:
        """Schedule the baseline that an MTB3 takes by itself two periods after power-up."""
        if self.generation.calibrates_in_ticks:
            self._events.append((t_ns + 2 * self.period_ns, None))
            self._events.sort(key=lambda entry: entry[0])

    @property
    def next_event_ns(self) -> int | None:
        """Return the time of the board's next spontaneous change."""
        return self._events[0][0] if self._events else None

    def apply_next_event(self, pressure_pa: NDArray[np.float64]) -> None:
        """Apply the next event, under `pressure_pa` (n_triangles, 12) at its time."""
        t_ns, event = self._events.pop(0)
        if event is None:
            if not self.zeroed:
                self.zero(pressure_pa, t_ns)
        elif event.what in ("cut", "mend"):
            self.is_disconnected = event.what == "cut"
        elif event.what in ("take address", "own address"):
            self.address = event.fault.board if event.what == "take address" else self.node
            self._update_can_ids()
        elif event.what == "rezero":
            self._force_zero()
        elif event.what == "lose power":
            self._lose_power()
        else:
            self._boot(event.fault, t_ns, pressure_pa)

    def _lose_power(self) -> None:
        """Forget all settings and errors, and disconnect from the bus."""
        self._settings_before_reset = _Settings(
            self.streaming, self.skin_type, self.no_load, self.shift, self._enabled, self.period_ns, self.cls
        )
        self._reset_to_firmware_settings()
        self._errors = self._calibration_ticks_left = 0
        self._takes_baseline_at_next_tick = False
        self.thermometer = Thermometer()
        self._events = [entry for entry in self._events if entry[1] is not None]
        self.is_disconnected = True

    def _boot(self, fault: InjectedFault, t_ns: int, pressure_pa: NDArray[np.float64]) -> None:
        """Come up again as the fault's `comes_back` states."""
        self.is_disconnected = False
        if fault.comes_back == "silent":
            self._schedule_first_baseline(t_ns)
            return
        self.zero(pressure_pa, t_ns)
        self.use_skin_class()  # as after a start command
        is_on = True
        if fault.comes_back == "configured" and self._settings_before_reset is not None:
            settings = self._settings_before_reset
            is_on = settings.streaming
            self.skin_type, self.no_load, self.shift = settings.skin_type, settings.no_load, settings.shift
            self.period_ns, self.cls, self._enabled = settings.period_ns, settings.cls, settings.enabled
            self._update_can_ids()
        self.transmit(is_on, t_ns)

    def ticks(self, until_ns: int) -> NDArray[np.int64]:
        """Return the ticks of the stream before `until_ns` that no earlier call returned."""
        if not self.streaming or self.next_tick_ns is None:
            return np.empty(0, np.int64)
        ticks_ns = np.arange(self.next_tick_ns, until_ns, self.period_ns)
        if self._calibration_ticks_left and not self._streams_after_calibration:
            ticks_ns = ticks_ns[: self._calibration_ticks_left]
        self.next_tick_ns += len(ticks_ns) * self.period_ns
        return ticks_ns

    def seconds(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (n,) seconds since power-up."""
        return (t_ns - self._power_up_ns).astype(np.float64) * 1e-9

    # ---- sending

    def send_ticks(
        self, ticks_ns: NDArray[np.int64], pressure_pa: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Return the ticks (n,) of `ticks_ns` at which it sends, and (n, 2 · n_enabled, 8) payloads.

        `pressure_pa` (n_ticks, n_triangles, 12) are the pressures at the times when the sensors sampled.
        """
        slots = self._slots
        raw16 = self.sensors.read(pressure_pa, slots, self.seconds(ticks_ns))
        counts = np.zeros(raw16.shape, np.uint8)
        status = np.zeros(raw16.shape[:2], np.uint16)
        is_sent = np.ones(len(raw16), bool)
        tick = 0
        while tick < len(raw16):
            if self._calibration_ticks_left:
                is_sent[tick] = False
                if self._calibration_ticks_left == _STORES_AT:
                    self._baseline[slots] = raw16[tick]
                    self.zeroed = True
                self._calibration_ticks_left -= 1
                self.streaming = self._calibration_ticks_left > 0 or self._streams_after_calibration
                tick += 1
                continue
            if self._takes_baseline_at_next_tick:
                self._baseline[slots] = raw16[tick]
                self._takes_baseline_at_next_tick = False
            later_counts, later_status = self._digitise(raw16[tick:], slots)
            counts[tick:], status[tick:] = later_counts, later_status
            tick += self._count_errors(later_status)
        if not self._status_bits:
            status[:] = 0
        payloads = halves(counts, status).reshape(len(raw16), 2 * len(slots), 8)
        return (ticks_ns, payloads) if is_sent.all() else (ticks_ns[is_sent], payloads[is_sent])

    def halves(self, pressure_pa: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return (n, 2 · n_enabled, 8) payloads for `pressure_pa` (n_ticks, n_triangles, 12), as at power-up."""
        return self.send_ticks(np.full(len(pressure_pa), self._power_up_ns), pressure_pa)[1]

    def temperature_frame(self, t_ns: int) -> tuple[int, bytes]:
        """Return identifier and payload of the thermometer's reading."""
        return thermometer_frame(self.address, self.sensors.temperature_c(float(self.seconds(np.array([t_ns]))[0])))

    def _digitise(
        self, raw16: NDArray[np.int64], slots: NDArray[np.intp]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
        """Convert words (n_ticks, n_slots, 12) to counts and status words, by skin type and generation."""
        if self.skin_type == RAW_TEST_MODE and self.generation.raw_test_mode:
            return low_bytes(raw16)
        gains = self.generation.gains.get(self.skin_type) if self._compensated else None
        return digitise(
            raw16, self._baseline[slots], self.no_load, self.shift[slots, None], gains, self.generation.is_16_bit
        )

    def _count_errors(self, status: NDArray[np.uint16]) -> int:
        """Return for how many ticks of `status` (n_ticks, n_slots) the present baseline lasts."""
        errors = (status & ERROR_NO_ACK).sum(axis=1, dtype=np.int64)
        if not errors.any():
            return len(status)
        total = self._errors + np.cumsum(errors)
        last = int(np.searchsorted(total, _ERRORS_TO_ZERO))
        if last == len(total):
            self._errors = int(total[-1])
            return last
        self._errors = int(total[last]) % _ERRORS_TO_ZERO
        self._force_zero()
        return last + 1

    @property
    def can_ids(self) -> NDArray[np.uint32]:
        """Return (2 · n_enabled,) identifiers of the frames of one tick: triangles ascending, A then B."""
        return self._can_ids

    def _update_can_ids(self) -> None:
        self._slots = np.flatnonzero(self._enabled)
        self._can_ids = np.repeat(skin_id(self.address, 0, self.cls) + self._slots, 2).astype(np.uint32)

    # ---- commands

    def configure(self, skin_type: int, period_ms: int, no_load: int, t_ns: int) -> None:
        """Apply a board configuration: disable every triangle, and restart a running stream with the new period."""
        self.skin_type = skin_type
        self.no_load = no_load
        self.cls = CLASS_SKIN
        if period_ms:  # the behaviour of real boards with 0 is unknown
            self.period_ns = self._actual_period_ns(period_ms)
        self.enable(range(16), False)
        self.next_tick_ns = t_ns + self.period_ns

    def enable(self, triangles: Iterable[int], enabled: bool) -> None:
        """Enable or disable triangles of the stream; triangles without a sensor read as open lines."""
        self._enabled = self._enabled.copy()
        self._enabled[list(triangles)] = enabled
        self._update_can_ids()

    def transmit(self, on: bool, t_ns: int) -> None:
        """Start or stop the stream."""
        self.streaming = on
        self._streams_after_calibration = True
        self.next_tick_ns = t_ns + self.period_ns

    def use_skin_class(self) -> None:
        """Send in the skin's own message class from now on."""
        self.cls = CLASS_SKIN
        self._update_can_ids()

    def set_timer_ns(self, period_ns: float) -> None:
        """Set the period, as legacy commands do."""
        self.period_ns = round(max(period_ns, _shortest_period_ns()) * self.clock_rate)

    def calibrate(self, t_ns: int, pressure_pa: NDArray[np.float64]) -> None:
        """Take the baseline because of a command, under `pressure_pa` (n_triangles, 12).

        An MTB4 is silent afterwards. An MTB3 continues to stream after three ticks if it was streaming or calibrating
        before.
        """
        if not self.generation.calibrates_in_ticks:
            self.transmit(False, t_ns)
            self.zero(pressure_pa, t_ns)
            return
        self._streams_after_calibration = self.streaming
        if not self.streaming:
            self.transmit(True, t_ns)
            self._streams_after_calibration = False
        self._calibration_ticks_left = self.generation.calibrates_in_ticks

    def zero(self, pressure_pa: NDArray[np.float64], t_ns: int | None = None) -> None:
        """Take the baseline of all triangles from one reading, under any load `pressure_pa` (n_triangles, 12)."""
        t_s = self.seconds(np.array([self._power_up_ns if t_ns is None else t_ns]))
        self._baseline = self.sensors.read(pressure_pa[None], np.arange(16), t_s, hold=False)[0]
        self.zeroed = True

    def _force_zero(self) -> None:
        """Take a new baseline at the next tick, and continue to stream."""
        if self.generation.calibrates_in_ticks:
            self._calibration_ticks_left = self.generation.calibrates_in_ticks
            self._streams_after_calibration = True
        else:
            self._takes_baseline_at_next_tick = True


def _shortest_period_ns() -> int:
    return round(reference_insole().mtb3_busy_ms * 1e6)
