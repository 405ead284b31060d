"""k x the floor, as formats.md defines it.

What is left of the noise-free mismatch, over the affected taxels or of the wrench, after the best static recalibration
and clock, divided by the standard deviation of the noise. What recalibration removes is measured before it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import nnls

from .effect import MAPPING, ON_THE_LOAD, RECALIBRATION, Effect, positions
from .geometry import PRESSURE_TAXELS, Geometry
from .sensor import Sensors
from .signal_path import Signal, taxels
from .trial import Trial, arms

GRID_S = 0.04
_SOME = 24  # affected taxels that stand for all of them where the load is known per taxel
_ALL = np.array([12 * t + k for t in range(28) for k in PRESSURE_TAXELS])
_STEPS = 6


@dataclass(frozen=True)
class Clock:
    """The reference's reading at s seconds is offset_s + (1 + rate) s."""

    declared: str = "can"  # can, own, or none: rows without times
    offset_s: float = 0.0
    rate: float = 0.0

    def true_seconds(self, reading: np.ndarray) -> np.ndarray:
        return (reading - self.offset_s) / (1 + self.rate)


def _without(values: np.ndarray, columns: np.ndarray) -> np.ndarray:
    basis = np.linalg.qr(columns)[0]
    return values - basis @ (basis.T @ values)


@dataclass(frozen=True)
class Bench:
    """What strengths are measured on: a trial, an insole, and what stands beside the reading."""

    trial: Trial
    geometry: Geometry
    sensors: Sensors
    per_taxel: bool  # the load is known on every taxel, else as a wrench
    own_clock: bool
    reference_noise: np.ndarray  # (3,) N, N m, N m
    load_error: Trial | None = None  # the load that a simulation believes in, on the trial's time
    _loads: dict[object, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @cached_property
    def seconds(self) -> np.ndarray:
        return np.arange(0, self.trial.main_s, GRID_S)

    @cached_property
    def _arms(self) -> np.ndarray:
        return arms(self.geometry.taxel_mm.reshape(-1, 2)[_ALL])

    @cached_property
    def _clean(self) -> np.ndarray:
        """(n, 280) mean byte where nothing is concealed."""
        return Signal(self.trial, self.geometry.taxel_mm, self.sensors, (), _ALL).mean(self.seconds)

    @cached_property
    def _pressure(self) -> np.ndarray:
        return self._pascal(self._clean)

    def _pascal(self, counts: np.ndarray) -> np.ndarray:
        return self.sensors.pressure(self.sensors.rest.ravel()[_ALL] - counts, _ALL)

    @cached_property
    def _recalibration(self) -> list[np.ndarray]:
        """For f_z, m_x, m_y: constant and first three powers of the pressure on each board, (n, 10)."""
        board = self.geometry.board[_ALL // 12]
        v = self._pressure / self.trial.span_pa
        out = []
        for arm in self._arms:
            columns = [np.ones(len(v))]
            for b in range(3):
                mine = board == b
                columns += [(v[:, mine] ** p) @ arm[mine] * 1e6 for p in (1, 2, 3)]
            out.append(np.stack(columns, 1))
        return out

    @cached_property
    def wrench_noise(self) -> np.ndarray:
        """(3,) noise of insole and shoe together."""
        activation = self.sensors.rest.ravel()[_ALL] - self._clean
        slope2 = np.mean(self.sensors.pa_per_count(activation, _ALL) ** 2, 0)
        insole2 = (self._arms**2) @ (slope2 * self.sensors.noise_of_byte.ravel()[_ALL] ** 2)
        return np.sqrt(insole2 + self.reference_noise**2)

    def _counts(self, effects: tuple[Effect, ...], columns: np.ndarray) -> np.ndarray:
        """(n, n_columns) mean byte. What an effect adds to the load is proportional to its amplitude: computed once."""
        at = positions(self.geometry, effects)
        signal = Signal(self.trial, at, self.sensors, effects, columns)
        if len(effects) != 1 or effects[0].law not in ON_THE_LOAD or effects[0].law == "lag":
            return signal.mean(self.seconds)
        key = (id(effects[0].shape), columns.tobytes())
        if key not in self._loads:
            unit = replace(signal, effects=(effects[0].with_amplitude(1.0),))
            base = self.trial.at(replace(signal, effects=()).load, self.seconds)
            self._loads[key] = base, self.trial.at(unit.load, self.seconds) - base
        base, more = self._loads[key]
        return signal.bytes_of(base + np.float32(effects[0].amplitude) * more, self.seconds, slice(None), effects)

    def wrench_mismatch(self, effects: tuple[Effect, ...], clock: Clock = Clock()) -> np.ndarray:
        """(n, 3): what the believed static model reads less what the reference says, noise-free."""
        at = positions(self.geometry, effects)
        believed = self._pascal(self._counts(effects, _ALL)) @ self._arms.T
        return believed - self.trial.at(self.trial.wrench(at), clock.true_seconds(self.seconds))

    def _columns(self, effect: Effect) -> np.ndarray:
        if effect.word in ("clock", "crosstalk", "map_transform") or not effect.place.any():
            found = _ALL
        else:
            found = taxels(effect.place)
        if effect.word in MAPPING or self.trial.kind == "walk":
            return found
        return found[:: max(1, len(found) // _SOME)]

    def count_mismatch(self, effects: tuple[Effect, ...], columns: np.ndarray, clock: Clock = Clock()) -> np.ndarray:
        """(n, n_columns) count."""
        counts = self._counts(effects, columns)
        clean = Signal(self.trial, self.geometry.taxel_mm, self.sensors, (), columns)
        return counts - clean.mean(clock.true_seconds(self.seconds))

    def _static(self, columns: np.ndarray) -> np.ndarray:
        """(n_columns, n, 4) orthonormal: whatever a static recalibration of a taxel can do."""
        clean = self._clean[:, np.searchsorted(_ALL, columns)]
        u = (clean - clean.max(0)) / np.maximum(np.ptp(clean, axis=0), 1e-6)
        return np.linalg.qr(np.stack([u**p for p in range(4)], -1).transpose(1, 0, 2))[0]

    def without_static(self, values: np.ndarray, columns: np.ndarray) -> np.ndarray:
        basis = self._static(columns)
        return values - np.einsum("cnp,cp->nc", basis, np.einsum("cnp,nc->cp", basis, values))

    def _floor2(self, columns: np.ndarray) -> float:
        """Mean square of noise and load error of these taxels, count^2."""
        noise2 = float(np.mean(self.sensors.noise_of_byte.ravel()[columns] ** 2))
        if self.load_error is None:
            return noise2
        believed = Signal(self.load_error, self.geometry.taxel_mm, self.sensors, (), columns).mean(self.seconds)
        wrong = self._clean[:, np.searchsorted(_ALL, columns)] - believed
        return noise2 + float(np.mean(self.without_static(wrong, columns) ** 2))

    def k(self, effect: Effect, clock: Clock = Clock()) -> float:
        """Strength of one effect alone."""
        if effect.law == "load_noise":
            return self._noise_strength(effect)
        return _strongest(self.remainder(effect, self._columns(effect), clock))

    def remainder(
        self, effect: Effect, columns: np.ndarray, clock: Clock = Clock(), kept: bool | None = None
    ) -> np.ndarray:
        """Mismatch over the floor, less what recalibration and clock remove.

        (n, 3) of a wrench, (n, 1, n_columns) where the load is known per taxel.
        kept: nothing is removed; by default that is so of what a recalibration would remove.
        """
        kept = effect.word in RECALIBRATION if kept is None else kept
        if self.per_taxel:
            found = self.count_mismatch((effect,), columns, clock)
            if not kept:
                found = self.without_static(found, columns)
                if self.own_clock and len(columns) >= len(_ALL[:: max(1, len(_ALL) // _SOME)]):
                    found = self._without_clock(found, columns, effect.word == "clock")
            return (found / np.sqrt(self._floor2(columns)))[:, None]
        found = self.wrench_mismatch((effect,), clock) / self.wrench_noise
        if kept:
            return found
        out = []
        for channel in range(3):
            slope = np.gradient(self._pressure @ self._arms[channel], GRID_S)
            removed = [self._recalibration[channel]]
            if self.own_clock:
                removed.append(slope[:, None])
                if effect.word != "clock":
                    removed.append((slope * self.seconds)[:, None])
            out.append(_without(found[:, channel], np.concatenate(removed, 1)))
        return np.stack(out, 1)

    def _without_clock(self, found: np.ndarray, columns: np.ndarray, only_offset: bool) -> np.ndarray:
        clean = self._clean[:, np.searchsorted(_ALL, columns)]
        slope = np.gradient(clean, GRID_S, axis=0)
        directions = [slope] if only_offset else [slope, slope * self.seconds[:, None]]
        directions = [self.without_static(d, columns) for d in directions]
        gram = np.array([[np.vdot(a, b) for b in directions] for a in directions])
        shifts = np.linalg.lstsq(gram, np.array([np.vdot(d, found) for d in directions]), rcond=None)[0]
        return found - sum(s * d for s, d in zip(shifts, directions, strict=True))

    def _noise_strength(self, effect: Effect) -> float:
        columns = taxels(effect.place)
        share = self.trial.at(self.trial.pressure(self.geometry.taxel_mm.reshape(-1, 2)[columns]), self.seconds)
        noise = self.sensors.noise.ravel()[columns]
        grown = effect.amplitude * share / self.trial.span_pa * noise
        return float(np.sqrt(np.mean(grown**2) / np.mean(self.sensors.noise_of_byte.ravel()[columns] ** 2)))

    def amplitude_fraction(self, effect: Effect) -> float:
        """Half the peak-to-peak of what the effect contributes, over the span of the reading, after recalibration."""
        columns = taxels(effect.place)
        reach = np.ptp(self._clean[:, np.searchsorted(_ALL, columns)], axis=0)
        columns = columns[np.argsort(-reach)[:_SOME]]
        columns.sort()
        left = self.without_static(self.count_mismatch((effect,), columns), columns)
        span = np.ptp(self._clean[:, np.searchsorted(_ALL, columns)], axis=0)
        return float(np.mean(np.ptp(left, axis=0) / 2 / span))

    def imitated(self, effect: Effect, by: str) -> float:
        """What the best `by` at the same place leaves of an effect, over the floor; amplitudes are fitted linearly."""
        columns, kept = self._columns(effect), effect.word in RECALIBRATION
        wanted = self.remainder(effect, columns, kept=kept)
        families = [self.remainder(other, columns, kept=kept).ravel() for other in _imitators(effect, by, self.trial)]
        if by in _EITHER_SIGN:
            families += [-f for f in families]
        features = np.stack(families, 1)
        amplitudes = nnls(features.T @ features, features.T @ wanted.ravel())[0]
        return _strongest(wanted - (features @ amplitudes).reshape(wanted.shape))


_EITHER_SIGN = ("gain", "baseline", "drift", "temperature")
# Words that might pass for a word, where it is weak or fast or the load has one speed.
IMITATORS = {
    "gain": ("baseline", "preload"),
    "baseline": ("gain", "preload"),
    "preload": ("gain", "baseline"),
    "lag": ("delay", "viscoelasticity"),
    "delay": ("lag",),
    "viscoelasticity": ("lag", "creep", "hysteresis"),
    "creep": ("viscoelasticity", "hysteresis"),
    "hysteresis": ("viscoelasticity", "creep"),
    "drift": ("temperature",),
    "temperature": ("drift",),
}


def _imitators(effect: Effect, by: str, trial: Trial) -> list[Effect]:
    """Small effects of another word at the same place, over the range of their other parameters."""
    shapes: dict[str, list[tuple[float, dict[str, Any]]]] = {
        "gain": [(0.02, {})],
        "baseline": [(1.0, {})],
        "preload": [(500.0, {})],
        "delay": [(0.01, {})],
        "lag": [(0.01, {}), (0.06, {})],
        "viscoelasticity": [(0.05, {"tau_s": tau, "width": 0.15}) for tau in (0.1, 0.35, 1.2)],
        "creep": [(0.05, {"exponent": 0.2, "onset_s": onset}) for onset in (1.0, 4.0)],
        "hysteresis": [
            (0.01, {"family": "bouc_wen", "width_pa": width * trial.span_pa, "beta": 0.6}) for width in (0.03, 0.09)
        ],
        "drift": [
            (1.0, {"settle_s": settle, "start_s": start * trial.main_s})
            for settle, start in ((25.0, 0.0), (60.0, 0.0), (40.0, 0.25))
        ],
        "temperature": [(1.0, {"gain_per_k": 0.0})],
    }
    return [
        Effect(by, by, effect.where, effect.place, a, {**shape, "span_pa": trial.span_pa}) for a, shape in shapes[by]
    ]


def _strongest(remainder: np.ndarray) -> float:
    """RMS of the channel in which it is largest."""
    return float(np.sqrt(np.mean(remainder**2, axis=tuple(k for k in range(remainder.ndim) if k != 1))).max())


def clock_of(effect: Effect, declared: str) -> Clock:
    """The clock that a concealed `clock` makes."""
    if effect.shape.get("solved") == "offset_s":
        return Clock(declared, effect.amplitude, 0.0)
    return Clock(declared, 0.0, 1e-6 * effect.signed)


def solve(bench: Bench, effect: Effect, wanted: float, declared: str) -> tuple[Effect, float]:
    """The effect with the amplitude that makes it `wanted` x the floor, or the nearest its range allows; and its k."""

    def k(amplitude: float) -> float:
        candidate = effect.with_amplitude(amplitude)
        return bench.k(candidate, clock_of(candidate, declared) if effect.word == "clock" else Clock())

    if effect.word in ("bit_shift", "swapped_triangles"):
        amplitude = effect.amplitude or 1.0
        return effect.with_amplitude(amplitude), k(amplitude)
    low, high = effect.limits
    if effect.word == "rezero":
        fractions = np.linspace(low, high, 9)
        found = [(k(float(f)), float(f)) for f in fractions]
        best = min(found, key=lambda x: abs(np.log(max(x[0], 1e-6) / wanted)))
        return effect.with_amplitude(best[1]), best[0]
    amplitude = float(np.sqrt(low * high))
    reached = k(amplitude)
    for _ in range(_STEPS):
        if abs(np.log(max(reached, 1e-9) / wanted)) < 0.03:
            break
        following = float(np.clip(amplitude * np.clip(wanted / max(reached, 1e-9), 0.02, 50), low, high))
        if following == amplitude:
            break
        amplitude, reached = following, k(following)
    return effect.with_amplitude(amplitude), reached
