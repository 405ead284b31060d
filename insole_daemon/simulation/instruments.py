"""The instruments beside the insole: a force shoe or a chamber's gauge, each with a clock, noise and drift of its own.

    t_reference = offset + (1 + rate)·t        the effect `clock`, if there is one, else drawn from the seed

What drifts is a random walk. Readings are rounded to what such an instrument shows, which also makes them the same
on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..physics.draws import Draws
from ..recording.reference import TIME
from ..recording.writer import ReferenceContents
from ..skin.layout import Foot
from .conditions import InstrumentConditions
from .reference_insole import reference_insole
from .scenarios import ReferencedLoad
from .sensors import Temperature

_DRIFT_OVER_S = 600.0
_DIGITS = {"fz_n": 3, "mx_nm": 4, "my_nm": 4, "pressure_pa": 1, "temperature_c": 2}

Clock = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # (n,) s since the start of the CAN's → of the reference's


def draw_clock(draws: Draws, chosen: InstrumentConditions) -> Clock:
    """A clock with a constant offset and rate error: the `chosen` ones, else drawn."""
    made = reference_insole()
    offset_s = _or(chosen.offset_s, made.reference_offset_s * float(draws.normal(1)[0]))
    rate_ppm = _or(chosen.rate_ppm, made.reference_ppm * float(draws.normal(1)[0]))
    return lambda t_s: offset_s + (1.0 + 1e-6 * rate_ppm) * t_s


def simulate_readings(
    foot: Foot,
    load: ReferencedLoad,
    seconds: float,
    start_s: float,
    clock: Clock,
    temperature_c: Temperature,
    draws: Draws,
    chosen: InstrumentConditions,
) -> ReferenceContents:
    """What the instrument of `foot` says from the start on for `seconds`; `start_s`: of the CAN, since the epoch.

    `chosen` stands before what insole-reference.yaml says of it.
    """
    made = reference_insole()
    moment = (
        _or(chosen.moment_noise_nm, made.shoe_moment_noise_nm),
        _or(chosen.moment_drift_nm, made.shoe_drift_nm),
    )
    noise = {
        "fz_n": (_or(chosen.force_noise_n, made.shoe_force_noise_n), _or(chosen.force_drift_n, made.shoe_drift_n)),
        "mx_nm": moment,
        "my_nm": moment,
        "pressure_pa": (
            _or(chosen.pressure_noise_pa, made.gauge_noise_pa),
            _or(chosen.pressure_drift_pa, made.gauge_drift_pa),
        ),
    }
    exact = load.reference(foot, np.empty(0))
    rate_hz = _or(chosen.rate_hz, made.gauge_rate_hz if "pressure_pa" in exact else made.shoe_rate_hz)
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    columns: dict[str, NDArray[np.float64]] = {TIME: start_s + clock(t_s)}
    for name, values in load.reference(foot, t_s).items():
        std, drift = noise[name]
        walked = np.cumsum(draws.normal(len(t_s))) * (drift / math.sqrt(_DRIFT_OVER_S * rate_hz))
        columns[name] = values + std * draws.normal(len(t_s)) + walked
    columns["temperature_c"] = temperature_c(t_s)
    for name, digits in _DIGITS.items():
        if name in columns:
            columns[name] = np.round(columns[name], digits) + 0.0  # which makes -0 a 0
    return ReferenceContents(foot, "own", columns)


def _or(chosen: float | None, drawn: float) -> float:
    return drawn if chosen is None else chosen
