"""From the load to the mean byte, with the concealed effects in the order of the signal path."""

from dataclasses import dataclass

import numpy as np

from benchmarks.blind import laws
from benchmarks.blind.effect import ON_THE_LOAD, Effect
from benchmarks.blind.geometry import PADS
from benchmarks.blind.loads import Load
from benchmarks.blind.sensor import Sensors


def _linear(effect: Effect, stream: np.ndarray, load: Load) -> np.ndarray:
    """The departure a linear law makes of one stream, per unit of the amplitude (of a lag: the departure itself)."""
    if effect.law == "creep" and load.cycle is not None:
        one = laws.power_law_steady(stream[: len(load.cycle)], effect.shape["exponent"])
        return np.resize(one, len(stream))
    lead = load.lead
    stream = np.concatenate([stream[:lead], stream])
    if effect.law == "viscoelasticity":
        out = laws.relaxation(stream, effect.shape["tau_s"], effect.shape["width"])
    elif effect.law == "creep":
        out = laws.power_law(stream, effect.shape["exponent"], effect.shape["onset_s"])
    else:
        out = laws.low_pass(stream, effect.amplitude) - stream
    return out[lead:]


@dataclass(frozen=True)
class Chain:
    """The effective load of taxel (t, k) is the sum of `streams` weighted with `weights[t, k]`."""

    load: Load
    sensors: Sensors
    effects: tuple[Effect, ...]
    streams: list[np.ndarray]
    weights: np.ndarray  # (28, 12, n_streams)

    def _named(self, *laws_wanted: str) -> list[Effect]:
        return [e for e in self.effects if e.law in laws_wanted]

    def mean_byte(self, seconds: np.ndarray) -> np.ndarray:
        """The byte without noise (n, 28, 12), of triangle t at seconds[:, t] since the first frame; not clipped."""
        out = np.empty((*seconds.shape, 12))
        for t in range(seconds.shape[1]):
            out[:, t] = self.triangle(t, seconds[:, t])
        return out

    def triangle(self, t: int, seconds: np.ndarray) -> np.ndarray:
        """The same of the twelve taxels of triangle t: (n, 12)."""
        for effect in self._named("delay"):
            if effect.place[t].any():
                seconds = seconds - effect.amplitude
        grid = self.load.seconds
        streams = np.stack([np.interp(seconds, grid, s) for s in self.streams], 1)
        q = streams @ self.weights[t].T
        for effect in self._named("stiffening"):
            beyond = np.maximum(q - effect.shape["knee_pa"], 0) / effect.shape["knee_pa"]
            q = q - effect.place[t] * effect.shape["knee_pa"] * beyond * (1 - 1 / (1 + effect.amplitude * beyond))
        warmth = np.interp(seconds, grid, self.load.temperature_c) - self.load.temperature_c[0]
        return self._counts(t, seconds, self.sensors.activation(q, t), warmth)

    def _counts(self, t: int, seconds: np.ndarray, activation: np.ndarray, warmth: np.ndarray) -> np.ndarray:
        shift = np.zeros_like(activation)
        for e in self.effects:
            here, strength = e.place[t], e.amplitude * e.shape.get("sign", 1.0)
            if e.law == "gain":
                activation = activation * np.where(here, 1 + strength, 1.0)
            elif e.law == "humidity":
                late = np.maximum(seconds - e.shape["start_s"], 0)
                wet = 1 - np.exp(-late / e.shape["tau_s"])
                dry = np.exp(-np.maximum(late - 0.45 * self.load.main_s, 0) / e.shape["tau_s"])
                activation = activation * (1 + np.outer(e.amplitude * wet * dry, here))
            elif e.law == "temperature":
                activation = activation * (1 + np.outer(e.shape["gain_per_k"] * warmth, here))
                shift += np.outer(strength * warmth, here)
            elif e.law == "baseline":
                shift += strength * here
            elif e.law == "rezero":
                shift += np.outer(strength * (seconds >= e.shape["t_s"]), here)
            elif e.law == "drift":
                late = np.maximum(seconds - e.shape["start_s"], 0) / e.shape["settle_s"]
                shift += np.outer(strength * (1 - np.exp(-late)), here)
            elif e.law == "hum":
                shift += np.outer(e.amplitude * np.sin(2 * np.pi * e.shape["frequency_hz"] * seconds), here)
        count = self.sensors.rest[t] - activation + shift
        count[:, list(PADS)] = self.sensors.no_load - self.sensors.pad_count_per_k * warmth[:, None]
        for e in self._named("bit_shift"):
            said, real = self.sensors.shift, self.sensors.shift + e.shape["step"]
            value = self.sensors.no_load + (1 - 2.0**-said) / 2 - count
            moved = self.sensors.no_load + (1 - 2.0**-real) / 2 - value * 2.0 ** (said - real)
            count = np.where(e.place[t], moved, count)
        return count

    def noise_factor(self, seconds: np.ndarray) -> np.ndarray:
        """What multiplies the noise at (n, 28, 12)."""
        factor = np.ones((*seconds.shape, 12))
        for e in self._named("load_noise"):
            load = np.interp(seconds, self.load.seconds, self.load.pressure_pa) / self.load.span_pa
            factor *= np.sqrt(1 + (e.amplitude * load[..., None]) ** 2 * e.place)
        return factor


def chain(load: Load, sensors: Sensors, effects: tuple[Effect, ...]) -> Chain:
    streams = [load.pressure_pa]
    weights = np.ones((28, 12, 1))
    for e in effects:
        if e.law in ON_THE_LOAD:
            streams.append(e.departure)
            weights = np.concatenate([weights, (e.amplitude * sensors.spread * e.place)[..., None]], 2)
    for e in effects:
        if e.law in ("viscoelasticity", "creep"):
            streams += [_linear(e, s, load) for s in streams]
            weights = np.concatenate([weights, (e.amplitude * sensors.spread * e.place)[..., None] * weights], 2)
    for e in effects:
        if e.law == "lag":
            streams += [_linear(e, s, load) for s in streams]
            weights = np.concatenate([weights, e.place[..., None] * weights], 2)
    return Chain(load, sensors, effects, streams, weights)
