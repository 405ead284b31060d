"""Strength k of an effect in multiples of the noise floor, as formats.md defines it.

k is the RMS of the noise-free mismatch after the best static recalibration and clock, divided by the standard deviation
of the noise: over the affected taxels, or of the wrench. Effects that a recalibration removes are measured before it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import nnls

from .effect import MAPPING, ON_THE_LOAD, RECALIBRATION, Effect, positions
from .geometry import PRESSURE_TAXELS, Geometry
from .imitators import EITHER_SIGN, small_effects
from .sensor import Sensors
from .signal_path import Signal, taxels
from .trial import Trial, arms

GRID_S = 0.04
_SAMPLED_TAXELS = 24  # affected taxels that represent all of them where the load is known per taxel
_PRESSURE_COLUMNS = np.array([12 * t + k for t in range(28) for k in PRESSURE_TAXELS])
_SOLVER_STEPS = 6


@dataclass(frozen=True)
class Clock:
    """The reference's clock shows offset_s + (1 + rate) s at s seconds."""

    declared: str = "can"  # can, own, or none: rows without times
    offset_s: float = 0.0
    rate: float = 0.0

    def true_seconds(self, reading: np.ndarray) -> np.ndarray:
        """Times at which the clock shows `reading`."""
        return (reading - self.offset_s) / (1 + self.rate)


def _without_span(values: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """`values` (n,) without their projection on the columns of `directions` (n, p)."""
    basis = np.linalg.qr(directions)[0]
    return values - basis @ (basis.T @ values)


@dataclass(frozen=True)
class Bench:
    """Measures strengths of effects on a trial and an insole, against a reference or a simulation."""

    trial: Trial
    geometry: Geometry
    sensors: Sensors
    per_taxel: bool  # the load of every taxel is known; otherwise only the wrench
    own_clock: bool
    reference_noise: np.ndarray  # (3,) N, N m, N m
    load_error: Trial | None = None  # the trial with the load of the simulation, on the trial's time
    _loads: dict[object, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @cached_property
    def seconds(self) -> np.ndarray:
        """Times (n,) at which mismatches are computed."""
        return np.arange(0, self.trial.main_s, GRID_S)

    @cached_property
    def _arms(self) -> np.ndarray:
        """(3, 280): f_z, m_x and m_y of 1 Pa on each pressure taxel."""
        return arms(self.geometry.taxel_mm.reshape(-1, 2)[_PRESSURE_COLUMNS])

    @cached_property
    def _clean(self) -> np.ndarray:
        """(n, 280) mean byte where nothing is concealed."""
        return Signal(self.trial, self.geometry.taxel_mm, self.sensors, (), _PRESSURE_COLUMNS).mean(self.seconds)

    @cached_property
    def _pressure(self) -> np.ndarray:
        """(n, 280) Pa by the static curve where nothing is concealed."""
        return self._pascal(self._clean)

    def _pascal(self, counts: np.ndarray) -> np.ndarray:
        """Pressure (n, 280) in Pa of counts (n, 280), by the static curve."""
        return self.sensors.pressure(self.sensors.rest.ravel()[_PRESSURE_COLUMNS] - counts, _PRESSURE_COLUMNS)

    @cached_property
    def _recalibration(self) -> list[np.ndarray]:
        """Regressors (n, 10) of each of f_z, m_x, m_y: a constant, and three powers of the pressure on each board."""
        board_of_column = self.geometry.board[_PRESSURE_COLUMNS // 12]
        relative_pressure = self._pressure / self.trial.span_pa
        regressors = []
        for arm in self._arms:
            columns = [np.ones(len(relative_pressure))]
            for board in range(3):
                on_board = board_of_column == board
                columns += [(relative_pressure[:, on_board] ** p) @ arm[on_board] * 1e6 for p in (1, 2, 3)]
            regressors.append(np.stack(columns, 1))
        return regressors

    @cached_property
    def wrench_noise(self) -> np.ndarray:
        """(3,) standard deviation of the noise of insole and shoe together, N and N m."""
        activation = self.sensors.rest.ravel()[_PRESSURE_COLUMNS] - self._clean
        mean_slope2 = np.mean(self.sensors.pa_per_count(activation, _PRESSURE_COLUMNS) ** 2, 0)
        insole_variance = (self._arms**2) @ (mean_slope2 * self.sensors.noise_of_byte.ravel()[_PRESSURE_COLUMNS] ** 2)
        return np.sqrt(insole_variance + self.reference_noise**2)

    def _counts(self, effects: tuple[Effect, ...], columns: np.ndarray) -> np.ndarray:
        """Mean byte (n, n_columns). The change of the load is proportional to the amplitude and is computed once."""
        taxels_mm = positions(self.geometry, effects)
        signal = Signal(self.trial, taxels_mm, self.sensors, effects, columns)
        if len(effects) != 1 or effects[0].law not in ON_THE_LOAD or effects[0].law == "lag":
            return signal.mean(self.seconds)
        key = (id(effects[0].shape), columns.tobytes())
        if key not in self._loads:
            unit = replace(signal, effects=(effects[0].with_amplitude(1.0),))
            without_effect = self.trial.at(replace(signal, effects=()).load, self.seconds)
            self._loads[key] = without_effect, self.trial.at(unit.load, self.seconds) - without_effect
        without_effect, per_amplitude = self._loads[key]
        return signal.bytes_of(
            without_effect + np.float32(effects[0].amplitude) * per_amplitude, self.seconds, slice(None), effects
        )

    def wrench_mismatch(self, effects: tuple[Effect, ...], clock: Clock = Clock()) -> np.ndarray:
        """(n, 3): wrench of the handed-out static model minus that of the reference, without noise."""
        taxels_mm = positions(self.geometry, effects)
        believed = self._pascal(self._counts(effects, _PRESSURE_COLUMNS)) @ self._arms.T
        return believed - self.trial.at(self.trial.wrench(taxels_mm), clock.true_seconds(self.seconds))

    def _columns(self, effect: Effect) -> np.ndarray:
        """Flat numbers of the taxels on which the effect's strength is measured."""
        if effect.word in ("clock", "crosstalk", "map_transform") or not effect.place.any():
            columns = _PRESSURE_COLUMNS
        else:
            columns = taxels(effect.place)
        if effect.word in MAPPING or self.trial.kind == "walk":
            return columns
        return columns[:: max(1, len(columns) // _SAMPLED_TAXELS)]

    def count_mismatch(self, effects: tuple[Effect, ...], columns: np.ndarray, clock: Clock = Clock()) -> np.ndarray:
        """(n, n_columns): counts minus those of the handed-out model at the reference's times, without noise."""
        counts = self._counts(effects, columns)
        clean = Signal(self.trial, self.geometry.taxel_mm, self.sensors, (), columns)
        return counts - clean.mean(clock.true_seconds(self.seconds))

    def _static(self, columns: np.ndarray) -> np.ndarray:
        """(n_columns, n, 4): orthonormal basis of the changes that a static recalibration of a taxel can make."""
        clean = self._clean[:, np.searchsorted(_PRESSURE_COLUMNS, columns)]
        relative_count = (clean - clean.max(0)) / np.maximum(np.ptp(clean, axis=0), 1e-6)
        return np.linalg.qr(np.stack([relative_count**p for p in range(4)], -1).transpose(1, 0, 2))[0]

    def without_static(self, values: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """`values` (n, n_columns) without the part that a static recalibration removes."""
        basis = self._static(columns)
        return values - np.einsum("cnp,cp->nc", basis, np.einsum("cnp,nc->cp", basis, values))

    def _floor2(self, columns: np.ndarray) -> float:
        """Variance of noise and load error of these taxels, in count^2."""
        noise_variance = float(np.mean(self.sensors.noise_of_byte.ravel()[columns] ** 2))
        if self.load_error is None:
            return noise_variance
        believed = Signal(self.load_error, self.geometry.taxel_mm, self.sensors, (), columns).mean(self.seconds)
        load_error = self._clean[:, np.searchsorted(_PRESSURE_COLUMNS, columns)] - believed
        return noise_variance + float(np.mean(self.without_static(load_error, columns) ** 2))

    def k(self, effect: Effect, clock: Clock = Clock()) -> float:
        """Strength of an effect alone, in multiples of the floor."""
        if effect.law == "load_noise":
            return self._noise_strength(effect)
        return _strongest(self.remainder(effect, self._columns(effect), clock))

    def remainder(
        self, effect: Effect, columns: np.ndarray, clock: Clock = Clock(), keep_all: bool | None = None
    ) -> np.ndarray:
        """Mismatch divided by the floor, without the part that recalibration and clock remove.

        Returns (n, 3) for a wrench, (n, 1, n_columns) where the load is known per taxel.
        keep_all: nothing is removed; the default is True for the effects of `RECALIBRATION`.
        """
        keep_all = effect.word in RECALIBRATION if keep_all is None else keep_all
        if self.per_taxel:
            mismatch = self.count_mismatch((effect,), columns, clock)
            if not keep_all:
                mismatch = self.without_static(mismatch, columns)
                if self.own_clock and len(columns) >= len(
                    _PRESSURE_COLUMNS[:: max(1, len(_PRESSURE_COLUMNS) // _SAMPLED_TAXELS)]
                ):
                    mismatch = self._without_clock(mismatch, columns, effect.word == "clock")
            return (mismatch / np.sqrt(self._floor2(columns)))[:, None]
        mismatch = self.wrench_mismatch((effect,), clock) / self.wrench_noise
        if keep_all:
            return mismatch
        channels = []
        for channel in range(3):
            slope = np.gradient(self._pressure @ self._arms[channel], GRID_S)
            removed = [self._recalibration[channel]]
            if self.own_clock:
                removed.append(slope[:, None])
                if effect.word != "clock":
                    removed.append((slope * self.seconds)[:, None])
            channels.append(_without_span(mismatch[:, channel], np.concatenate(removed, 1)))
        return np.stack(channels, 1)

    def _without_clock(self, mismatch: np.ndarray, columns: np.ndarray, only_offset: bool) -> np.ndarray:
        """`mismatch` (n, n_columns) without the part that an offset of the clock, and its rate, explain."""
        clean = self._clean[:, np.searchsorted(_PRESSURE_COLUMNS, columns)]
        slope = np.gradient(clean, GRID_S, axis=0)
        directions = [slope] if only_offset else [slope, slope * self.seconds[:, None]]
        directions = [self.without_static(direction, columns) for direction in directions]
        gram = np.array([[np.vdot(a, b) for b in directions] for a in directions])
        projections = np.array([np.vdot(direction, mismatch) for direction in directions])
        shifts = np.linalg.lstsq(gram, projections, rcond=None)[0]
        return mismatch - sum(shift * direction for shift, direction in zip(shifts, directions, strict=True))

    def _noise_strength(self, effect: Effect) -> float:
        """RMS of the noise that the effect adds, divided by the floor."""
        columns = taxels(effect.place)
        share = self.trial.at(self.trial.pressure(self.geometry.taxel_mm.reshape(-1, 2)[columns]), self.seconds)
        noise = self.sensors.noise.ravel()[columns]
        added_noise = effect.amplitude * share / self.trial.span_pa * noise
        return float(np.sqrt(np.mean(added_noise**2) / np.mean(self.sensors.noise_of_byte.ravel()[columns] ** 2)))

    def amplitude_fraction(self, effect: Effect) -> float:
        """Half the peak-to-peak value of the effect after recalibration, divided by the span of the reading."""
        columns = taxels(effect.place)
        reading_span = np.ptp(self._clean[:, np.searchsorted(_PRESSURE_COLUMNS, columns)], axis=0)
        columns = columns[np.argsort(-reading_span)[:_SAMPLED_TAXELS]]
        columns.sort()
        contribution = self.without_static(self.count_mismatch((effect,), columns), columns)
        span = np.ptp(self._clean[:, np.searchsorted(_PRESSURE_COLUMNS, columns)], axis=0)
        return float(np.mean(np.ptp(contribution, axis=0) / 2 / span))

    def imitated(self, effect: Effect, word: str) -> float:
        """Residual of the best fit of an effect by effects called `word` at the same place, divided by the floor."""
        columns, keep_all = self._columns(effect), effect.word in RECALIBRATION
        wanted = self.remainder(effect, columns, keep_all=keep_all)
        candidates = [
            self.remainder(other, columns, keep_all=keep_all).ravel()
            for other in small_effects(effect, word, self.trial)
        ]
        if word in EITHER_SIGN:
            candidates += [-candidate for candidate in candidates]
        features = np.stack(candidates, 1)
        amplitudes = nnls(features.T @ features, features.T @ wanted.ravel())[0]
        return _strongest(wanted - (features @ amplitudes).reshape(wanted.shape))


def _strongest(remainder: np.ndarray) -> float:
    """Largest RMS of a channel, axis 1 of `remainder`."""
    return float(np.sqrt(np.mean(remainder**2, axis=tuple(k for k in range(remainder.ndim) if k != 1))).max())


def clock_of(effect: Effect, declared: str) -> Clock:
    """The reference's clock with the concealed effect `clock` in it."""
    if effect.shape.get("solved") == "offset_s":
        return Clock(declared, effect.amplitude, 0.0)
    return Clock(declared, 0.0, 1e-6 * effect.signed)


def solve(bench: Bench, effect: Effect, wanted: float, declared: str) -> tuple[Effect, float]:
    """The effect with the amplitude at which it is `wanted` x the floor, or the nearest within its range; and its k."""

    def k(amplitude: float) -> float:
        candidate = effect.with_amplitude(amplitude)
        return bench.k(candidate, clock_of(candidate, declared) if effect.word == "clock" else Clock())

    if effect.word in ("bit_shift", "swapped_triangles"):
        amplitude = effect.amplitude or 1.0
        return effect.with_amplitude(amplitude), k(amplitude)
    low, high = effect.limits
    if effect.word == "rezero":
        fractions = np.linspace(low, high, 9)
        strengths = [(k(float(f)), float(f)) for f in fractions]
        best = min(strengths, key=lambda pair: abs(np.log(max(pair[0], 1e-6) / wanted)))
        return effect.with_amplitude(best[1]), best[0]
    amplitude = float(np.sqrt(low * high))
    reached = k(amplitude)
    for _ in range(_SOLVER_STEPS):
        if abs(np.log(max(reached, 1e-9) / wanted)) < 0.03:
            break
        next_amplitude = float(np.clip(amplitude * np.clip(wanted / max(reached, 1e-9), 0.02, 50), low, high))
        if next_amplitude == amplitude:
            break
        amplitude, reached = next_amplitude, k(next_amplitude)
    return effect.with_amplitude(amplitude), reached
