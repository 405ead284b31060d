"""From the load to the mean byte, with the concealed effects in the order of the signal path."""

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
    """What some taxels make of a trial; `columns` are their flat numbers, 12 per triangle."""

    trial: Trial
    at_mm: np.ndarray  # (28, 12, 2), where the taxels truly lie
    sensors: Sensors
    effects: tuple[Effect, ...]
    columns: np.ndarray

    @cached_property
    def load(self) -> np.ndarray:
        """(n, n_columns) Pa on the trial's grid, or (n, 1) where all taxels feel the same; float32."""
        trial = self.trial
        at = self.at_mm.reshape(-1, 2)[self.columns]
        q = trial.pressure(at[:1] if trial.kind == "chamber" else at)
        untouched = True
        for effect in sorted((e for e in self.effects if e.law in ON_THE_LOAD), key=lambda e: ON_THE_LOAD.index(e.law)):
            here = effect.place.ravel()[self.columns]
            if not here.any():
                continue
            if effect.law == "crosstalk":
                field = effect.amplitude * crosstalk_field(trial, self.at_mm)[self.columns] * here[:, None]
                q = q + trial.courses.astype(np.float32) @ field.T.astype(np.float32)
                continue
            spread = 1.0 if effect.law in ("lag", "preload") else self.sensors.spread.ravel()[self.columns][here]
            weight = np.zeros(len(here), np.float32)
            weight[here] = spread if effect.law == "lag" else effect.amplitude * spread
            if q.shape[1] == 1:
                q = q + departure(effect, trial, q) * weight
            elif untouched and effect.law in LINEAR_IN_TIME:
                # A few regions instead of hundreds of taxels.
                of_regions = departure(effect, trial, trial.courses.astype(np.float32))
                q += of_regions @ (trial.field(at) * weight[:, None]).T.astype(np.float32)
            elif here.all():
                q += departure(effect, trial, q) * weight
            else:
                q[:, here] += departure(effect, trial, np.ascontiguousarray(q[:, here])) * weight[here]
            untouched = False
        return q

    def mean(self, seconds: np.ndarray, pick: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Mean byte (n, n_picked) of readings taken at `seconds` (n,); not clipped."""
        columns = self.columns[pick]
        delays = [e for e in self.effects if e.law == "delay" and e.place.ravel()[columns].any()]
        if not delays:
            return self._bytes(seconds, pick, self.effects)
        out = self._bytes(seconds, pick, self.effects)
        for e in delays:
            here = e.place.ravel()[columns]
            late = np.arange(len(self.columns))[pick][here]
            out[:, here] = self._bytes(seconds - e.amplitude, late, self.effects)
        return out

    def _bytes(self, seconds: np.ndarray, pick: slice | np.ndarray, effects: tuple[Effect, ...]) -> np.ndarray:
        trial = self.trial
        load = self.load if self.load.shape[1] == 1 else self.load[:, pick]
        return self.bytes_of(trial.at(load, seconds), seconds, pick, effects)

    def bytes_of(
        self, q: np.ndarray, seconds: np.ndarray, pick: slice | np.ndarray, effects: tuple[Effect, ...]
    ) -> np.ndarray:
        """Mean byte of effective loads (n, n_picked) or (n, 1), Pa, felt at `seconds`."""
        trial, columns = self.trial, self.columns[pick]
        if q.shape[1] == 1:
            q = np.repeat(q, len(columns), 1)
        for e in effects:
            if e.law == "stiffening":
                knee = e.shape["knee_pa"]
                beyond = np.maximum(q - knee, 0) / knee
                q = q - e.place.ravel()[columns] * knee * beyond * (1 - 1 / (1 + e.amplitude * beyond))
        warmth = trial.at(trial.temperature_c, seconds) - float(trial.at(trial.temperature_c, np.zeros(1))[0])
        return self._counts(seconds, columns, pick, self.sensors.activation(q, columns), warmth, effects)

    def _counts(
        self,
        seconds: np.ndarray,
        columns: np.ndarray,
        pick: slice | np.ndarray,
        activation: np.ndarray,
        warmth: np.ndarray,
        effects: tuple[Effect, ...],
    ) -> np.ndarray:
        these, main_s = self.sensors, self.trial.main_s
        shift = np.zeros(activation.shape, np.float32)
        for e in effects:
            here, strength, s = e.place.ravel()[columns], e.signed, e.shape
            if not here.any():
                continue
            if e.law == "gain":
                activation = activation * np.where(here, 1 + strength, 1.0)
            elif e.law == "humidity":
                late = np.maximum(seconds - s["start_s"], 0)
                wet = 1 - np.exp(-late / s["tau_s"])
                dry = np.exp(-np.maximum(late - 0.45 * main_s, 0) / s["tau_s"])
                activation = activation * (1 + np.outer(e.amplitude * wet * dry, here))
            elif e.law == "loose_contact":
                grid = self.trial.seconds
                bad = laws.telegraph(np.random.default_rng(s["seed"]), grid, s["hold_s"])
                activation = activation * (1 - np.outer(e.amplitude * self.trial.at(bad, seconds), here))
            elif e.law == "temperature":
                activation = activation * (1 + np.outer(s["gain_per_k"] * warmth, here))
                shift += np.outer(strength * warmth, here)
            elif e.law == "baseline":
                shift += strength * here
            elif e.law == "drift":
                late = np.maximum(seconds - s["start_s"], 0) / s["settle_s"]
                shift += np.outer(strength * (1 - np.exp(-late)), here)
            elif e.law == "hum":
                shift += np.outer(e.amplitude * np.sin(2 * np.pi * s["frequency_hz"] * seconds), here)
        count = these.rest.ravel()[columns].astype(np.float32) - activation + shift
        pads = np.isin(columns % 12, PADS)
        count[:, pads] = these.no_load - these.pad_count_per_k * warmth[:, None]
        for e in effects:
            here = e.place.ravel()[columns]
            if e.law == "rezero" and here.any():
                when = np.array([e.amplitude * main_s])
                before = self._bytes(when, pick, tuple(x for x in effects if x.law != "rezero"))[0]
                jump = np.where(here, these.no_load + 0.5 - before, 0)
                count = count + np.outer(seconds >= when[0], jump)
            elif e.law == "bit_shift" and here.any():
                said, real = these.shift, these.shift + s_step(e)
                value = these.no_load + (1 - 2.0**-said) / 2 - count
                moved = these.no_load + (1 - 2.0**-real) / 2 - value * 2.0 ** (said - real)
                count = np.where(here, moved, count)
        return count

    def noise_factor(self, seconds: np.ndarray, pick: slice | np.ndarray = slice(None)) -> np.ndarray:
        """(n, n_picked): what multiplies the noise."""
        columns = self.columns[pick]
        factor = np.ones((len(seconds), len(columns)), np.float32)
        for e in self.effects:
            if e.law == "load_noise":
                load = self.load if self.load.shape[1] == 1 else self.load[:, pick]
                share = self.trial.at(load, seconds) / self.trial.span_pa
                factor = factor * np.sqrt(1 + (e.amplitude * share) ** 2 * e.place.ravel()[columns])
        return factor


def s_step(effect: Effect) -> int:
    """How much a digitiser's real shift is more than the declared one."""
    return int(effect.shape["step"])


def taxels(place: np.ndarray) -> np.ndarray:
    """Flat numbers of the taxels in a place (28, 12)."""
    return np.flatnonzero(place.ravel())
