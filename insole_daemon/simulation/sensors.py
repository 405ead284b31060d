"""The raw words of one board's sensors: the physics of a reading, all of it.

A sensor's line is

    raw16 = rest + 2^shift · (s · P / pa_per_count + pad_count_per_k · gain_k / 128 · (T − rest_c)) + noise

with the shift it was made for, whatever shift is commanded later; gain_k are those of skin type 0, which is what
the compensation was made for, and 128 on the thermal pads: they respond to temperature alone. The constants are those
of insole-reference.yaml; s is the sensitivity of the taxel.

A converter (AD7147) runs freely, unless none is asked for: the board's tick then reads what its last sequence
found, and reads it again until the next is through. Sources: AD7147 data sheet, table 10 (36.864 ms for twelve
stages at decimation 256); icub-firmware AD7147.c 71. A sequence's twelve results appear at once here, and all
converters keep the same rate, each with a phase of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..physics.digitiser import GAINS_TYPE_0, OPEN_LINE
from ..physics.draws import Drawn, Draws
from ..physics.sampling import phases_s, sequence, taken_s
from ..skin.geometry import PRESSURE_TAXELS
from .faults import LINE_KINDS, STUCK_PA, TAXEL_KINDS, InjectedFault
from .reference_insole import reference_insole

Temperature = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # (n,) s since power-up → (n,) °C


class Sensors:
    """The sensors on `triangles` (ascending), the same from the same seed; the others are open lines."""

    def __init__(
        self,
        address: int,
        triangles: Iterable[int],
        shift: int,
        seed: int,
        faults: Sequence[InjectedFault] = (),
        cdc_hz: float | None = None,
        temperature_c: Temperature | None = None,
        luck: int = 0,
        alike: bool = False,
        noise: float = 1.0,
    ) -> None:
        """`faults`: only those of triangles and taxels on board `address` matter; `cdc_hz` None: no converter.

        `luck`: of the noise, on the same sensors. `alike`: every taxel has the nominal sensitivity; else each its own.
        `noise`: times that of the reference insole.
        """
        made_of = reference_insole()
        self.triangles = tuple(triangles)
        self.made = Draws(seed, Drawn.SENSORS, address)
        self._noise = Draws(seed, Drawn.NOISE, address, luck)
        self._rest_code = np.rint(made_of.rest_code + made_of.rest_code_spread * self.made.normal(16, 12))
        sensitivity = made_of.sensitivities(self.made, 16, 12)
        self._code_per_pa = 2.0**shift / made_of.pa_per_count * (1.0 if alike else sensitivity) * np.ones((16, 12))
        self._code_per_pa[:, ~PRESSURE_TAXELS] = 0.0
        self._noise_code = noise * 2.0**shift * np.where(PRESSURE_TAXELS, made_of.noise_count, made_of.pad_noise_count)
        gains = np.where(PRESSURE_TAXELS, GAINS_TYPE_0, 128) / 128
        self._code_per_k = 2.0**shift * made_of.pad_count_per_k * gains
        self._rest_c = made_of.rest_c
        self._temperature_c = temperature_c
        self._taxel_faults = [f for f in faults if f.board == address and f.kind in TAXEL_KINDS]
        # Each line has luck of its own, so that one more fault changes nothing about the others.
        self._line_faults = [
            (fault, Draws(seed, Drawn.FAULT, address, place))
            for place, fault in enumerate(faults)
            if fault.board == address and fault.kind in LINE_KINDS
        ]
        self._cdc_hz = cdc_hz
        self._phase_s = phases_s(seed, address, cdc_hz or 1.0)
        # Which were asked for last, which of them are there, and where among the board's.
        self._slots, self._there, self._rows = np.empty(0, np.intp), np.empty(0, np.bool_), np.empty(0, np.intp)
        self._held = np.full((16, 12), OPEN_LINE, np.int64)
        self._held_number = np.full(16, -(2**62), np.int64)

    def rest(self) -> NDArray[np.int64]:
        """(16, 12) words at rest, without noise, at the temperature of power-up."""
        words = np.full((16, 12), OPEN_LINE, np.int64)
        there = list(self.triangles)
        words[there] = np.rint(self._rest_code + self._warmth(np.zeros(1))[0])[there]
        return words

    def sampled_s(self, t_s: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """(n, n_triangles) when what is read at `t_s` (n,) was converted; None: then."""
        if self._cdc_hz is None:
            return None
        return np.maximum(taken_s(t_s, self._phase_s[list(self.triangles)], self._cdc_hz), 0.0)

    def temperature_c(self, t_s: float) -> float:
        """Of the board, `t_s` after power-up."""
        return self._rest_c if self._temperature_c is None else float(self._temperature_c(np.array([t_s]))[0])

    def _warmth(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 12) codes."""
        if self._temperature_c is None:
            return np.zeros((len(t_s), 12))
        return (self._temperature_c(t_s) - self._rest_c)[:, None] * self._code_per_k

    def read(
        self,
        pressure_pa: NDArray[np.float64],
        slots: NDArray[np.intp],
        t_s: NDArray[np.float64],
        held: bool = True,
    ) -> NDArray[np.int64]:
        """(n_ticks, n_slots, 12) words of the triangles `slots` at `t_s` (n_ticks,) since power-up.

        `pressure_pa` (n_ticks, n_triangles, 12), as it was when `sampled_s` says; not `held`: a converter has
        just been through, as after being programmed.
        """
        if slots is not self._slots:
            self._slots, self._there = slots, np.isin(slots, self.triangles)
            self._rows = np.searchsorted(self.triangles, slots[self._there])
        there = self._there
        slots_there = slots[there]
        load = pressure_pa[:, self._rows]
        code = self._noise.normal(*load.shape)
        code *= self._noise_code
        for fault in self._taxel_faults:
            if fault.kind == "noisy":
                code[_where(fault, slots_there, t_s)] *= fault.factor
        code += load * self._code_per_pa[slots_there]
        code += self._rest_code[slots_there]
        if self._temperature_c is not None:
            code += self._warmth(t_s)[:, None]
        for fault in self._taxel_faults:
            self._break_taxels(fault, code, load, slots_there, t_s)
        np.rint(code, out=code)
        np.minimum(np.maximum(code, 0, out=code), OPEN_LINE, out=code)
        words = np.full((len(load), len(slots), 12), OPEN_LINE, np.int64)
        words[:, there] = code
        if self._cdc_hz is not None and held:
            number = sequence(t_s, self._phase_s[slots_there], self._cdc_hz)
            words[:, there] = self._hold(words[:, there], slots_there, number)
        for fault, luck in self._line_faults:
            self._break_lines(fault, luck, words, pressure_pa, slots, t_s)
        return words

    def _break_taxels(
        self,
        fault: InjectedFault,
        code: NDArray[np.float64],
        load: NDArray[np.float64],
        slots: NDArray[np.intp],
        t_s: NDArray[np.float64],
    ) -> None:
        if fault.kind == "noisy":
            return
        there = _where(fault, slots, t_s)
        if fault.kind == "saturated":
            if fault.level_pa is not None:
                there &= load >= fault.level_pa
            code[there] = OPEN_LINE
            return
        level_pa = 0.0
        if fault.kind == "stuck":
            level_pa = STUCK_PA if fault.level_pa is None else fault.level_pa
        constant = self._rest_code[slots] + level_pa * self._code_per_pa[slots]
        code[there] = np.broadcast_to(constant, code.shape)[there]

    def _break_lines(
        self,
        fault: InjectedFault,
        luck: Draws,
        words: NDArray[np.int64],
        pressure_pa: NDArray[np.float64],
        slots: NDArray[np.intp],
        t_s: NDArray[np.float64],
    ) -> None:
        ticks = np.flatnonzero(fault.active(t_s))
        if not len(ticks):
            return
        struck = np.ones(len(ticks), bool)
        if fault.chance < 1:
            struck = luck.uniform(len(ticks)) < fault.chance
        triangles = self.triangles if fault.triangle is None else (fault.triangle,)
        for triangle in triangles:
            if triangle not in self.triangles or triangle not in slots:
                continue
            bad = struck
            if fault.level_pa is not None:
                mine = pressure_pa[ticks, self.triangles.index(triangle)][:, PRESSURE_TAXELS]
                bad = struck & (mine.mean(axis=1) >= fault.level_pa)
            place = int(np.flatnonzero(slots == triangle)[0])
            words[ticks[bad], place] = OPEN_LINE if fault.kind == "loose" else 0

    def _hold(self, words: NDArray[np.int64], slots: NDArray[np.intp], number: NDArray[np.int64]) -> NDArray[np.int64]:
        """`words` (n_ticks, n_slots, 12), at each tick those of the first tick that saw the same sequence `number`."""
        if not len(number):
            return words
        new = number != np.concatenate([self._held_number[None, slots], number[:-1]])
        # Row 0 of what follows is what the last call left.
        since = np.maximum.accumulate(np.where(new, np.arange(1, len(number) + 1)[:, None], 0), axis=0)
        all_words = np.concatenate([self._held[None, slots], words])
        result: NDArray[np.int64] = np.take_along_axis(all_words, since[..., None], axis=0)
        self._held[slots] = result[-1]
        self._held_number[slots] = number[-1]
        return result


def _where(fault: InjectedFault, slots: NDArray[np.intp], t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n_ticks, n_slots, 12) which readings `fault` strikes."""
    triangles = np.ones(len(slots), bool) if fault.triangle is None else slots == fault.triangle
    taxels = PRESSURE_TAXELS if fault.taxel is None else np.arange(12) == fault.taxel
    there: NDArray[np.bool_] = fault.active(t_s)[:, None, None] & triangles[:, None] & taxels
    return there
