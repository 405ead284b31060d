"""The raw words of one board's sensors: the complete physics of a reading.

A sensor is linear:

    raw16 = rest + 2^shift · (s · P / pa_per_count + pad_count_per_k · gain_k / 128 · (T − rest_c)) + noise

The shift is the one at construction, whatever shift is commanded later. gain_k are those of skin type 0, for which the
compensation was made, and 128 on the thermal pads, which respond to temperature alone. The constants are those of
insole-reference.yaml; s is the sensitivity of the taxel.

A converter (AD7147), if there is one, runs freely: the board's tick reads the result of its last sequence, and reads it
again until the next one is complete. Sources: AD7147 data sheet, table 10 (36.864 ms for twelve stages at decimation
256); icub-firmware AD7147.c 71. In this model a sequence's twelve results appear at once, and all converters have the
same rate with different phases.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..physics.digitiser import GAINS_TYPE_0, OPEN_LINE
from ..physics.draws import Drawn, Draws
from ..physics.sampling import conversion_time_s, draw_phases_s, sequence_number
from ..skin.geometry import PRESSURE_TAXELS
from .faults import LINE_KINDS, STUCK_PA, TAXEL_KINDS, InjectedFault
from .reference_insole import reference_insole

Temperature = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # (n,) s since power-up → (n,) °C


class Sensors:
    """The sensors on `triangles` (ascending), the same for the same seed; other triangles are open lines."""

    def __init__(
        self,
        address: int,
        triangles: Iterable[int],
        shift: int,
        seed: int,
        faults: Sequence[InjectedFault] = (),
        cdc_hz: float | None = None,
        temperature_c: Temperature | None = None,
        noise_key: int = 0,
        nominal_sensors: bool = False,
        noise: float = 1.0,
    ) -> None:
        """Create the sensors of board `address`.

        `faults`: only those of triangles and taxels on this board matter. `cdc_hz` None: no converter. `noise_key`
        selects other noise on the same sensors. `nominal_sensors`: every taxel has the nominal sensitivity. `noise`:
        factor of the reference insole's noise.
        """
        constants = reference_insole()
        self.triangles = tuple(triangles)
        self.draws = Draws(seed, Drawn.SENSORS, address)
        self._noise = Draws(seed, Drawn.NOISE, address, noise_key)
        self._unloaded_code = np.rint(constants.rest_code + constants.rest_code_spread * self.draws.normal(16, 12))
        sensitivity = constants.sensitivities(self.draws, 16, 12)
        self._code_per_pa = (
            2.0**shift / constants.pa_per_count * (1.0 if nominal_sensors else sensitivity) * np.ones((16, 12))
        )
        self._code_per_pa[:, ~PRESSURE_TAXELS] = 0.0
        self._noise_code = (
            noise * 2.0**shift * np.where(PRESSURE_TAXELS, constants.noise_count, constants.pad_noise_count)
        )
        gains = np.where(PRESSURE_TAXELS, GAINS_TYPE_0, 128) / 128
        self._code_per_k = 2.0**shift * constants.pad_count_per_k * gains
        self._rest_c = constants.rest_c
        self._temperature_c = temperature_c
        self._taxel_faults = [f for f in faults if f.board == address and f.kind in TAXEL_KINDS]
        # Each line has its own random stream, so that an additional fault does not change the others.
        self._line_faults = [
            (fault, Draws(seed, Drawn.FAULT, address, index))
            for index, fault in enumerate(faults)
            if fault.board == address and fault.kind in LINE_KINDS
        ]
        self._cdc_hz = cdc_hz
        self._phase_s = draw_phases_s(seed, address, cdc_hz or 1.0)
        # Slots of the last request, which of them have sensors, and their rows among the board's.
        self._slots, self._is_present, self._rows = np.empty(0, np.intp), np.empty(0, np.bool_), np.empty(0, np.intp)
        self._held_words = np.full((16, 12), OPEN_LINE, np.int64)
        self._held_number = np.full(16, -(2**62), np.int64)

    def unloaded_words(self) -> NDArray[np.int64]:
        """Return (16, 12) words without load and noise, at the temperature of power-up."""
        words = np.full((16, 12), OPEN_LINE, np.int64)
        slots = list(self.triangles)
        words[slots] = np.rint(self._unloaded_code + self._temperature_codes(np.zeros(1))[0])[slots]
        return words

    def sample_times_s(self, t_s: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return (n, n_triangles) when the readings at `t_s` (n,) were converted; None: at `t_s`."""
        if self._cdc_hz is None:
            return None
        return np.maximum(conversion_time_s(t_s, self._phase_s[list(self.triangles)], self._cdc_hz), 0.0)

    def temperature_c(self, t_s: float) -> float:
        """Return the temperature of the board `t_s` after power-up."""
        return self._rest_c if self._temperature_c is None else float(self._temperature_c(np.array([t_s]))[0])

    def _temperature_codes(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n, 12) codes."""
        if self._temperature_c is None:
            return np.zeros((len(t_s), 12))
        return (self._temperature_c(t_s) - self._rest_c)[:, None] * self._code_per_k

    def read(
        self,
        pressure_pa: NDArray[np.float64],
        slots: NDArray[np.intp],
        t_s: NDArray[np.float64],
        hold: bool = True,
    ) -> NDArray[np.int64]:
        """Return (n_ticks, n_slots, 12) words of the triangles `slots` at `t_s` (n_ticks,) since power-up.

        `pressure_pa` (n_ticks, n_triangles, 12) at the times of `sample_times_s`. `hold` False: every converter has
        just completed a sequence, as after being programmed.
        """
        if slots is not self._slots:
            self._slots, self._is_present = slots, np.isin(slots, self.triangles)
            self._rows = np.searchsorted(self.triangles, slots[self._is_present])
        is_present = self._is_present
        present_slots = slots[is_present]
        load = pressure_pa[:, self._rows]
        code = self._noise.normal(*load.shape)
        code *= self._noise_code
        for fault in self._taxel_faults:
            if fault.kind == "noisy":
                code[_strikes(fault, present_slots, t_s)] *= fault.factor
        code += load * self._code_per_pa[present_slots]
        code += self._unloaded_code[present_slots]
        if self._temperature_c is not None:
            code += self._temperature_codes(t_s)[:, None]
        for fault in self._taxel_faults:
            self._break_taxels(fault, code, load, present_slots, t_s)
        np.rint(code, out=code)
        np.minimum(np.maximum(code, 0, out=code), OPEN_LINE, out=code)
        words = np.full((len(load), len(slots), 12), OPEN_LINE, np.int64)
        words[:, is_present] = code
        if self._cdc_hz is not None and hold:
            number = sequence_number(t_s, self._phase_s[present_slots], self._cdc_hz)
            words[:, is_present] = self._hold(words[:, is_present], present_slots, number)
        for fault, draws in self._line_faults:
            self._break_lines(fault, draws, words, pressure_pa, slots, t_s)
        return words

    def _break_taxels(
        self,
        fault: InjectedFault,
        code: NDArray[np.float64],
        load: NDArray[np.float64],
        slots: NDArray[np.intp],
        t_s: NDArray[np.float64],
    ) -> None:
        """Apply a fault of taxels to the codes (n_ticks, n_slots, 12), in place."""
        if fault.kind == "noisy":
            return
        is_struck = _strikes(fault, slots, t_s)
        if fault.kind == "saturated":
            if fault.level_pa is not None:
                is_struck &= load >= fault.level_pa
            code[is_struck] = OPEN_LINE
            return
        level_pa = 0.0
        if fault.kind == "stuck":
            level_pa = STUCK_PA if fault.level_pa is None else fault.level_pa
        constant = self._unloaded_code[slots] + level_pa * self._code_per_pa[slots]
        code[is_struck] = np.broadcast_to(constant, code.shape)[is_struck]

    def _break_lines(
        self,
        fault: InjectedFault,
        draws: Draws,
        words: NDArray[np.int64],
        pressure_pa: NDArray[np.float64],
        slots: NDArray[np.intp],
        t_s: NDArray[np.float64],
    ) -> None:
        """Apply a fault of lines or chips to the words (n_ticks, n_slots, 12), in place."""
        ticks = np.flatnonzero(fault.is_active(t_s))
        if not len(ticks):
            return
        is_struck = np.ones(len(ticks), bool)
        if fault.chance < 1:
            is_struck = draws.uniform(len(ticks)) < fault.chance
        triangles = self.triangles if fault.triangle is None else (fault.triangle,)
        for triangle in triangles:
            if triangle not in self.triangles or triangle not in slots:
                continue
            is_open = is_struck
            if fault.level_pa is not None:
                pressures = pressure_pa[ticks, self.triangles.index(triangle)][:, PRESSURE_TAXELS]
                is_open = is_struck & (pressures.mean(axis=1) >= fault.level_pa)
            row = int(np.flatnonzero(slots == triangle)[0])
            words[ticks[is_open], row] = OPEN_LINE if fault.kind == "loose" else 0

    def _hold(self, words: NDArray[np.int64], slots: NDArray[np.intp], number: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return `words` (n_ticks, n_slots, 12) as they were at the first tick with the same sequence `number`."""
        if not len(number):
            return words
        is_new = number != np.concatenate([self._held_number[None, slots], number[:-1]])
        # Row 0 of all_words is from the last call.
        row = np.maximum.accumulate(np.where(is_new, np.arange(1, len(number) + 1)[:, None], 0), axis=0)
        all_words = np.concatenate([self._held_words[None, slots], words])
        result: NDArray[np.int64] = np.take_along_axis(all_words, row[..., None], axis=0)
        self._held_words[slots] = result[-1]
        self._held_number[slots] = number[-1]
        return result


def _strikes(fault: InjectedFault, slots: NDArray[np.intp], t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (n_ticks, n_slots, 12) which readings `fault` strikes."""
    triangles = np.ones(len(slots), bool) if fault.triangle is None else slots == fault.triangle
    taxels = PRESSURE_TAXELS if fault.taxel is None else np.arange(12) == fault.taxel
    is_struck: NDArray[np.bool_] = fault.is_active(t_s)[:, None, None] & triangles[:, None] & taxels
    return is_struck
