"""Computes mean bytes from the load, with the concealed effects in the order of the signal path."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import laws
from .effect import LINEAR_IN_TIME, ON_THE_LOAD, Effect, crosstalk_field, departure
from .geometry import PADS
from .sensor import Sensors
from .trial import Trial


@dataclass(frozen=True)
class Signal:
    """Readings of some taxels during a trial; `columns` are the flat numbers of the taxels, 12 per triangle."""

    trial: Trial
    taxels_mm: np.ndarray  # (28, 12, 2) true positions
    sensors: Sensors
    effects: tuple[Effect, ...]
    columns: np.ndarray

    @cached_property
    def load(self) -> np.ndarray:
        """Effective load (n, n_columns) in Pa on the trial's grid, or (n, 1) if all taxels feel the same; float32."""
        trial = self.trial
        taxels_mm = self.taxels_mm.reshape(-1, 2)[self.columns]
        load_pa = trial.pressure(taxels_mm[:1] if trial.kind == "chamber" else taxels_mm)
        is_unchanged = True
        for effect in sorted((e for e in self.effects if e.law in ON_THE_LOAD), key=lambda e: ON_THE_LOAD.index(e.law)):
            is_affected = effect.place.ravel()[self.columns]
            if not is_affected.any():
                continue
            if effect.law == "crosstalk":
                field = effect.amplitude * crosstalk_field(trial, self.taxels_mm)[self.columns] * is_affected[:, None]
                load_pa = load_pa + trial.courses.astype(np.float32) @ field.T.astype(np.float32)
                continue
            spread = 1.0 if effect.law in ("lag", "preload") else self.sensors.spread.ravel()[self.columns][is_affected]
            weight = np.zeros(len(is_affected), np.float32)
            weight[is_affected] = spread if effect.law == "lag" else effect.amplitude * spread
            if load_pa.shape[1] == 1:
                load_pa = load_pa + departure(effect, trial, load_pa) * weight
            elif is_unchanged and effect.law in LINEAR_IN_TIME:
                # The law is linear: a few regions are computed instead of hundreds of taxels.
                of_regions = departure(effect, trial, trial.courses.astype(np.float32))
                load_pa += of_regions @ (trial.field(taxels_mm) * weight[:, None]).T.astype(np.float32)
            elif is_affected.all():
                load_pa += departure(effect, trial, load_pa) * weight
            else:
                load_pa[:, is_affected] += (
                    departure(effect, trial, np.ascontiguousarray(load_pa[:, is_affected])) * weight[is_affected]
                )
            is_unchanged = False
        return load_pa

    def mean(self, seconds: np.ndarray, pick: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Mean byte (n, n_picked) of readings taken at `seconds` (n,), not clipped; `pick` selects from `columns`."""
        columns = self.columns[pick]
        delays = [delay for delay in self.effects if delay.law == "delay" and delay.place.ravel()[columns].any()]
        if not delays:
            return self._bytes(seconds, pick, self.effects)
        mean_byte = self._bytes(seconds, pick, self.effects)
        for delay in delays:
            is_affected = delay.place.ravel()[columns]
            late_columns = np.arange(len(self.columns))[pick][is_affected]
            mean_byte[:, is_affected] = self._bytes(seconds - delay.amplitude, late_columns, self.effects)
        return mean_byte

    def _bytes(self, seconds: np.ndarray, pick: slice | np.ndarray, effects: tuple[Effect, ...]) -> np.ndarray:
        """Mean byte (n, n_picked) at `seconds`, without the delays."""
        trial = self.trial
        load = self.load if self.load.shape[1] == 1 else self.load[:, pick]
        return self.bytes_of(trial.at(load, seconds), seconds, pick, effects)

    def bytes_of(
        self, load_pa: np.ndarray, seconds: np.ndarray, pick: slice | np.ndarray, effects: tuple[Effect, ...]
    ) -> np.ndarray:
        """Mean byte of effective loads (n, n_picked) or (n, 1), Pa, felt at `seconds`."""
        trial, columns = self.trial, self.columns[pick]
        if load_pa.shape[1] == 1:
            load_pa = np.repeat(load_pa, len(columns), 1)
        for effect in effects:
            if effect.law == "stiffening":
                knee = effect.shape["knee_pa"]
                beyond = np.maximum(load_pa - knee, 0) / knee
                load_pa = load_pa - effect.place.ravel()[columns] * knee * beyond * (
                    1 - 1 / (1 + effect.amplitude * beyond)
                )
        warming_k = trial.at(trial.temperature_c, seconds) - float(trial.at(trial.temperature_c, np.zeros(1))[0])
        return self._counts(seconds, columns, pick, self.sensors.activation(load_pa, columns), warming_k, effects)

    def _counts(
        self,
        seconds: np.ndarray,
        columns: np.ndarray,
        pick: slice | np.ndarray,
        activation: np.ndarray,
        warming_k: np.ndarray,
        effects: tuple[Effect, ...],
    ) -> np.ndarray:
        """Mean byte (n, n_picked) of an activation (n, n_picked), with the effects that act on counts."""
        sensors, main_s = self.sensors, self.trial.main_s
        shift = np.zeros(activation.shape, np.float32)
        for effect in effects:
            is_affected, strength, shape = effect.place.ravel()[columns], effect.signed, effect.shape
            if not is_affected.any():
                continue
            if effect.law == "gain":
                activation = activation * np.where(is_affected, 1 + strength, 1.0)
            elif effect.law == "humidity":
                seconds_since = np.maximum(seconds - shape["start_s"], 0)
                wetted = 1 - np.exp(-seconds_since / shape["tau_s"])
                dried = np.exp(-np.maximum(seconds_since - 0.45 * main_s, 0) / shape["tau_s"])
                activation = activation * (1 + np.outer(effect.amplitude * wetted * dried, is_affected))
            elif effect.law == "loose_contact":
                grid = self.trial.seconds
                is_loose = laws.telegraph(np.random.default_rng(shape["seed"]), grid, shape["hold_s"])
                activation = activation * (
                    1 - np.outer(effect.amplitude * self.trial.at(is_loose, seconds), is_affected)
                )
            elif effect.law == "temperature":
                activation = activation * (1 + np.outer(shape["gain_per_k"] * warming_k, is_affected))
                shift += np.outer(strength * warming_k, is_affected)
            elif effect.law == "baseline":
                shift += strength * is_affected
            elif effect.law == "drift":
                seconds_since = np.maximum(seconds - shape["start_s"], 0) / shape["settle_s"]
                shift += np.outer(strength * (1 - np.exp(-seconds_since)), is_affected)
            elif effect.law == "hum":
                shift += np.outer(effect.amplitude * np.sin(2 * np.pi * shape["frequency_hz"] * seconds), is_affected)
        count = sensors.rest.ravel()[columns].astype(np.float32) - activation + shift
        pads = np.isin(columns % 12, PADS)
        count[:, pads] = sensors.no_load - sensors.pad_count_per_k * warming_k[:, None]
        for effect in effects:
            is_affected = effect.place.ravel()[columns]
            if effect.law == "rezero" and is_affected.any():
                rezero_s = np.array([effect.amplitude * main_s])
                before = self._bytes(rezero_s, pick, tuple(other for other in effects if other.law != "rezero"))[0]
                jump = np.where(is_affected, sensors.no_load + 0.5 - before, 0)
                count = count + np.outer(seconds >= rezero_s[0], jump)
            elif effect.law == "bit_shift" and is_affected.any():
                declared_shift, real_shift = sensors.shift, sensors.shift + extra_shift(effect)
                value = sensors.no_load + (1 - 2.0**-declared_shift) / 2 - count
                moved = sensors.no_load + (1 - 2.0**-real_shift) / 2 - value * 2.0 ** (declared_shift - real_shift)
                count = np.where(is_affected, moved, count)
        return count

    def noise_factor(self, seconds: np.ndarray, pick: slice | np.ndarray = slice(None)) -> np.ndarray:
        """(n, n_picked): factor by which the concealed effects raise the noise."""
        columns = self.columns[pick]
        factor = np.ones((len(seconds), len(columns)), np.float32)
        for effect in self.effects:
            if effect.law == "load_noise":
                load_pa = self.load if self.load.shape[1] == 1 else self.load[:, pick]
                share = self.trial.at(load_pa, seconds) / self.trial.span_pa
                factor = factor * np.sqrt(1 + (effect.amplitude * share) ** 2 * effect.place.ravel()[columns])
        return factor


def extra_shift(effect: Effect) -> int:
    """Real shift of a board minus its declared shift."""
    return int(effect.shape["step"])


def taxels(place: np.ndarray) -> np.ndarray:
    """Flat numbers of the taxels in a place (28, 12)."""
    return np.flatnonzero(place.ravel())
