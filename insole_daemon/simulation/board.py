"""One emulated board: its settings, its baseline, and the halves it sends on a tick.

What its sensors read is in sensors.py, what the firmware makes of a reading in physics/digitiser.py, what two
generations do differently in generation.py. Source of the behaviour: robotology/icub-firmware,
embot_app_application_theSkin.cpp (MTB4), mtb3/main_V3.c and can_interface.c (MTB3).

A new baseline is one reading. An MTB4 takes it at once; an MTB3 spends three ticks of its stream on it: the first
begins, at the second it reads, at the third it has stored what it read. Either does so by itself after five errors
(a triangle that reads 0 at a tick, although its baseline is not 0), counted over the board, never forgotten.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.digitiser import OPEN_LINE, digitise, low_bytes
from ..skin.identifiers import CLASS_LEGACY_SKIN, CLASS_SKIN, ERROR_NO_ACK, skin_id
from .faults import BoardEvent, InjectedFault, events_of
from .generation import MTB4, Generation
from .halves import halves
from .reference_insole import reference_insole
from .sensors import Sensors, Temperature
from .thermometer import Thermometer, thermometer_frame

RAW_TEST_MODE = 7  # a skin type

_FIRMWARE_NO_LOAD, _FIRMWARE_SHIFT, _FIRMWARE_PERIOD_MS = 245, 2, 50  # what it runs with before any command
_ERRORS_TO_ZERO = 5
_STORES_AT = 2  # ticks left of an MTB3's calibration when it reads
_TICK_OF_TIMER_NS = 3200  # of an MTB3's timer, whose period is 16 bits wide: 209 ms at most, more wraps


@dataclass(frozen=True, slots=True)
class _Settings:
    """What is lost with the power."""

    streaming: bool
    skin_type: int
    no_load: int
    shift: NDArray[np.int64]
    enabled: NDArray[np.bool_]
    period_ns: int
    cls: int


class EmulatedBoard:
    """State of one board, from power-up on."""

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
        luck: int = 0,
        alike: bool = False,
        digitises_with: Mapping[int, int] | None = None,
        noise: float = 1.0,
    ) -> None:
        """A board with sensors on `triangles` (ascending), the same from the same `seed`.

        `streaming`: comes up sending with these settings, all its triangles enabled; else it is silent and
        has the firmware's settings until commanded. `compensated`: the temperature compensation of its skin
        type works; `status_bits`: else the status of every half B is 0. `digitises_with`: shifts, by triangle, that
        stand in for `shift` without anybody's knowing, until a command sets them. For the rest see Sensors and Fault.
        """
        self.node = address  # of the board as a thing, whatever address it bears
        self.address = address
        self.generation = generation
        self.sensors = Sensors(address, triangles, shift, seed, faults, cdc_hz, temperature_c, luck, alike, noise)
        self.triangles = self.sensors.triangles
        self.clock_rate = 1 + 1e-6 * reference_insole().clock_ppm * float(self.sensors.made.normal(1)[0])
        self._phase = float(self.sensors.made.uniform(1)[0])
        self._compensated = compensated
        self._status_bits = status_bits
        self._faults = tuple(faults)
        self._events: list[tuple[int, BoardEvent | None]] = []  # None: an MTB3 that was powered up is ready
        self._t_power_ns = 0
        self._errors = 0
        self._calibrating = 0  # ticks left of it
        self._streams_after = True
        self._zero_at_tick = False
        self._lost: _Settings | None = None
        self.deaf = False  # off the bus
        self.thermometer = Thermometer()

        self._baseline = np.full((16, 12), OPEN_LINE, np.int64)
        self._baseline[list(self.triangles)] = self.sensors.rest()[list(self.triangles)]
        self._to_firmware_settings()
        if streaming:
            self.streaming = True
            self.zeroed = True
            self.skin_type = skin_type
            self.no_load = no_load
            self.shift = np.full(16, shift, np.int64)
            for triangle, real in (digitises_with or {}).items():
                self.shift[triangle] = real
            self.period_ns = self._ticks_ns(period_ms)
            self.cls = CLASS_SKIN
            self._enabled = np.zeros(16, bool)
            self.enable(self.triangles, True)

    def _to_firmware_settings(self) -> None:
        self.streaming = False
        self.zeroed = False  # the first skin command after power-up takes the baseline of an MTB4
        self.next_tick_ns: int | None = None  # of the stream; None until it is scheduled
        self.skin_type = 0
        self.no_load = _FIRMWARE_NO_LOAD
        self.shift = np.full(16, _FIRMWARE_SHIFT, np.int64)
        self.period_ns = self._ticks_ns(_FIRMWARE_PERIOD_MS)
        self.cls = CLASS_LEGACY_SKIN if self.generation.legacy_stream else CLASS_SKIN
        self._enabled = np.zeros(16, bool)
        self.enable(range(16), True)

    def _ticks_ns(self, period_ms: int) -> int:
        nominal_ns = period_ms * 1_000_000
        if self.generation.narrow:
            nominal_ns = max((nominal_ns // _TICK_OF_TIMER_NS & 0xFFFF) * _TICK_OF_TIMER_NS, _shortest_ns())
        return round(nominal_ns * self.clock_rate)

    # ---- time

    def power_up(self, t_ns: int) -> None:
        """Schedule its faults, and the first tick if it comes up streaming, with a phase of its own."""
        self._t_power_ns = t_ns
        self._events = [(t_ns + round(event.t_s * 1e9), event) for event in events_of(self.node, self._faults)]
        if self.streaming:
            self.next_tick_ns = t_ns + int(self._phase * self.period_ns)
        else:
            self._get_ready(t_ns)

    def _get_ready(self, t_ns: int) -> None:
        """An MTB3 takes its first baseline by itself, two periods after power-up."""
        if self.generation.calibrates_in_ticks:
            self._events.append((t_ns + 2 * self.period_ns, None))
            self._events.sort(key=lambda each: each[0])

    @property
    def next_event_ns(self) -> int | None:
        """When the board changes by itself the next time."""
        return self._events[0][0] if self._events else None

    def happen(self, pressure_pa: NDArray[np.float64]) -> None:
        """Let the next event happen, at its time, under `pressure_pa` (n_triangles, 12)."""
        t_ns, event = self._events.pop(0)
        if event is None:
            if not self.zeroed:
                self.zero(pressure_pa, t_ns)
        elif event.what in ("cut", "mend"):
            self.deaf = event.what == "cut"
        elif event.what in ("take address", "own address"):
            self.address = event.fault.board if event.what == "take address" else self.node
            self._name_frames()
        elif event.what == "rezero":
            self._force_zero()
        elif event.what == "lose power":
            self._lose_power()
        else:
            self._boot(event.fault, t_ns, pressure_pa)

    def _lose_power(self) -> None:
        self._lost = _Settings(
            self.streaming, self.skin_type, self.no_load, self.shift, self._enabled, self.period_ns, self.cls
        )
        self._to_firmware_settings()
        self._errors = self._calibrating = 0
        self._zero_at_tick = False
        self.thermometer = Thermometer()
        self._events = [each for each in self._events if each[1] is not None]
        self.deaf = True

    def _boot(self, fault: InjectedFault, t_ns: int, pressure_pa: NDArray[np.float64]) -> None:
        self.deaf = False
        if fault.comes_back == "silent":
            self._get_ready(t_ns)
            return
        self.zero(pressure_pa, t_ns)
        self.new_style()  # as if told to start
        on = True
        if fault.comes_back == "configured" and self._lost is not None:
            lost = self._lost
            on = lost.streaming
            self.skin_type, self.no_load, self.shift = lost.skin_type, lost.no_load, lost.shift
            self.period_ns, self.cls, self._enabled = lost.period_ns, lost.cls, lost.enabled
            self._name_frames()
        self.transmit(on, t_ns)

    def ticks(self, until_ns: int) -> NDArray[np.int64]:
        """The ticks of the stream before `until_ns` that have not been asked for yet."""
        if not self.streaming or self.next_tick_ns is None:
            return np.empty(0, np.int64)
        due = np.arange(self.next_tick_ns, until_ns, self.period_ns)
        if self._calibrating and not self._streams_after:
            due = due[: self._calibrating]
        self.next_tick_ns += len(due) * self.period_ns
        return due

    def seconds(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n,) since power-up."""
        return (t_ns - self._t_power_ns).astype(np.float64) * 1e-9

    # ---- what it sends

    def speak(
        self, ticks_ns: NDArray[np.int64], pressure_pa: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """The ticks (n,) out of `ticks_ns` at which it sends, and (n, 2 · n_enabled, 8) payloads.

        `pressure_pa` (n_ticks, n_triangles, 12) as it was when the sensors sampled.
        """
        slots = self._slots
        raw16 = self.sensors.read(pressure_pa, slots, self.seconds(ticks_ns))
        counts = np.zeros(raw16.shape, np.uint8)
        status = np.zeros(raw16.shape[:2], np.uint16)
        sent = np.ones(len(raw16), bool)
        tick = 0
        while tick < len(raw16):
            if self._calibrating:
                sent[tick] = False
                if self._calibrating == _STORES_AT:
                    self._baseline[slots] = raw16[tick]
                    self.zeroed = True
                self._calibrating -= 1
                self.streaming = self._calibrating > 0 or self._streams_after
                tick += 1
                continue
            if self._zero_at_tick:
                self._baseline[slots] = raw16[tick]
                self._zero_at_tick = False
            some_counts, some_status = self._digitise(raw16[tick:], slots)
            counts[tick:], status[tick:] = some_counts, some_status
            tick += self._count_errors(some_status)
        if not self._status_bits:
            status[:] = 0
        payloads = halves(counts, status).reshape(len(raw16), 2 * len(slots), 8)
        return (ticks_ns, payloads) if sent.all() else (ticks_ns[sent], payloads[sent])

    def halves(self, pressure_pa: NDArray[np.float64]) -> NDArray[np.uint8]:
        """(n, 2 · n_enabled, 8) payloads under `pressure_pa` (n_ticks, n_triangles, 12), as if at power-up."""
        return self.speak(np.full(len(pressure_pa), self._t_power_ns), pressure_pa)[1]

    def temperature_frame(self, t_ns: int) -> tuple[int, bytes]:
        """Identifier and payload of what the thermometer reads."""
        return thermometer_frame(self.address, self.sensors.temperature_c(float(self.seconds(np.array([t_ns]))[0])))

    def _digitise(
        self, raw16: NDArray[np.int64], slots: NDArray[np.intp]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
        if self.skin_type == RAW_TEST_MODE and self.generation.raw_test_mode:
            return low_bytes(raw16)
        gains = self.generation.gains.get(self.skin_type) if self._compensated else None
        return digitise(
            raw16, self._baseline[slots], self.no_load, self.shift[slots, None], gains, self.generation.narrow
        )

    def _count_errors(self, status: NDArray[np.uint16]) -> int:
        """How many ticks of `status` (n_ticks, n_slots) the present baseline lasts."""
        errors = (status & ERROR_NO_ACK).sum(axis=1, dtype=np.int64)
        if not errors.any():
            return len(status)
        total = self._errors + np.cumsum(errors)
        enough = int(np.searchsorted(total, _ERRORS_TO_ZERO))
        if enough == len(total):
            self._errors = int(total[-1])
            return enough
        self._errors = int(total[enough]) % _ERRORS_TO_ZERO
        self._force_zero()
        return enough + 1

    @property
    def can_ids(self) -> NDArray[np.uint32]:
        """(2 · n_enabled,) identifiers of one tick's frames: triangles ascending, A then B."""
        return self._can_ids

    def _name_frames(self) -> None:
        self._slots = np.flatnonzero(self._enabled)
        self._can_ids = np.repeat(skin_id(self.address, 0, self.cls) + self._slots, 2).astype(np.uint32)

    # ---- what it is told

    def configure(self, skin_type: int, period_ms: int, no_load: int, t_ns: int) -> None:
        """Board configuration: disables every triangle; a running stream starts anew with the period."""
        self.skin_type = skin_type
        self.no_load = no_load
        self.cls = CLASS_SKIN
        if period_ms:  # what real boards do with 0 is not known
            self.period_ns = self._ticks_ns(period_ms)
        self.enable(range(16), False)
        self.next_tick_ns = t_ns + self.period_ns

    def enable(self, triangles: Iterable[int], enabled: bool) -> None:
        """Let triangles take part in the stream, or not; those without a sensor read as open lines."""
        self._enabled = self._enabled.copy()
        self._enabled[list(triangles)] = enabled
        self._name_frames()

    def transmit(self, on: bool, t_ns: int) -> None:
        """Start or stop the stream."""
        self.streaming = on
        self._streams_after = True
        self.next_tick_ns = t_ns + self.period_ns

    def new_style(self) -> None:
        """From now on the stream is of the skin's own class."""
        self.cls = CLASS_SKIN
        self._name_frames()

    def set_timer_ns(self, period_ns: float) -> None:
        """The period, as legacy commands set it."""
        self.period_ns = round(max(period_ns, _shortest_ns()) * self.clock_rate)

    def calibrate(self, t_ns: int, pressure_pa: NDArray[np.float64]) -> None:
        """Take the baseline because of a command, under `pressure_pa` (n_triangles, 12).

        An MTB4 is silent from then on. An MTB3 goes on streaming after three ticks if it was streaming, or
        already calibrating, before.
        """
        if not self.generation.calibrates_in_ticks:
            self.transmit(False, t_ns)
            self.zero(pressure_pa, t_ns)
            return
        self._streams_after = self.streaming
        if not self.streaming:
            self.transmit(True, t_ns)
            self._streams_after = False
        self._calibrating = self.generation.calibrates_in_ticks

    def zero(self, pressure_pa: NDArray[np.float64], t_ns: int | None = None) -> None:
        """Take the baseline of all triangles from one reading, under whatever load (n_triangles, 12)."""
        t_s = self.seconds(np.array([self._t_power_ns if t_ns is None else t_ns]))
        self._baseline = self.sensors.read(pressure_pa[None], np.arange(16), t_s, held=False)[0]
        self.zeroed = True

    def _force_zero(self) -> None:
        """Take a new baseline from the next tick on, and go on streaming."""
        if self.generation.calibrates_in_ticks:
            self._calibrating = self.generation.calibrates_in_ticks
            self._streams_after = True
        else:
            self._zero_at_tick = True


def _shortest_ns() -> int:
    return round(reference_insole().mtb3_busy_ms * 1e6)
