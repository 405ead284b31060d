"""Simulate the reference instrument: a force shoe or a chamber's gauge with its own clock, noise and drift.

    t_reference = offset + (1 + rate)·t        the effect `clock` if there is one, else drawn from the seed

The drift is a random walk. Readings are rounded to the resolution of such an instrument, which also makes them equal on
every machine.
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

Clock = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # (n,) CAN times since the start → reference times, in s


def draw_clock(draws: Draws, chosen: InstrumentConditions) -> Clock:
    """Return a clock with constant offset and rate error: the `chosen` ones, else drawn."""
    constants = reference_insole()
    offset_s = _chosen_or(chosen.offset_s, constants.reference_offset_s * float(draws.normal(1)[0]))
    rate_ppm = _chosen_or(chosen.rate_ppm, constants.reference_ppm * float(draws.normal(1)[0]))
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
    """Return the readings of the instrument of `foot` for `seconds` from the start.

    `start_s` is the start on the CAN clock, in s since the epoch. Values in `chosen` override insole-reference.yaml.
    """
    constants = reference_insole()
    moment = (
        _chosen_or(chosen.moment_noise_nm, constants.shoe_moment_noise_nm),
        _chosen_or(chosen.moment_drift_nm, constants.shoe_drift_nm),
    )
    noise = {
        "fz_n": (
            _chosen_or(chosen.force_noise_n, constants.shoe_force_noise_n),
            _chosen_or(chosen.force_drift_n, constants.shoe_drift_n),
        ),
        "mx_nm": moment,
        "my_nm": moment,
        "pressure_pa": (
            _chosen_or(chosen.pressure_noise_pa, constants.gauge_noise_pa),
            _chosen_or(chosen.pressure_drift_pa, constants.gauge_drift_pa),
        ),
    }
    empty_columns = load.reference(foot, np.empty(0))
    rate_hz = _chosen_or(
        chosen.rate_hz, constants.gauge_rate_hz if "pressure_pa" in empty_columns else constants.shoe_rate_hz
    )
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    columns: dict[str, NDArray[np.float64]] = {TIME: start_s + clock(t_s)}
    for name, values in load.reference(foot, t_s).items():
        std, drift = noise[name]
        random_walk = np.cumsum(draws.normal(len(t_s))) * (drift / math.sqrt(_DRIFT_OVER_S * rate_hz))
        columns[name] = values + std * draws.normal(len(t_s)) + random_walk
    columns["temperature_c"] = temperature_c(t_s)
    for name, digits in _DIGITS.items():
        if name in columns:
            columns[name] = np.round(columns[name], digits) + 0.0  # + 0.0 turns -0 into 0
    return ReferenceContents(foot, "own", columns)


def _chosen_or(chosen: float | None, drawn: float) -> float:
    return drawn if chosen is None else chosen
