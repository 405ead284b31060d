"""A recording into what a diagnosis looks at: usable taxels, blocks, and the load on a regular grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

from ..calibration import clock as clocks
from ..calibration.clock import Clock
from ..errors import DiagnosisError
from ..physics.law import Array
from ..recording.loading import FootRecording, Recording
from ..recording.reference import Reference
from ..skin.geometry import N_TAXELS
from .floor import noise_of_readings
from .jumps import despiked
from .observed import Load, Observed, block_starts, stretches

STEP_S = 0.04  # of the load's grid: finer than a block of cycles
SMOOTH_S = 0.1  # over so long a reference is averaged: its noise would otherwise drive plays
USUAL_RATE = 3e-4
SURE = 0.995  # of the edges explained: there is nothing to look for
SHARPER = 0.7  # of what is left unexplained, that another rate may leave at the most
TEMPERATURE = "temperature_c"
BEGAN = "began_t_ns"  # in a model's provenance: from when the times of its effects count


def observe(
    recording: Recording, foot: FootRecording, kept: NDArray[np.bool_], cycles: NDArray[np.bool_]
) -> tuple[Observed, tuple[tuple[float, float], ...]]:
    """What a diagnosis looks at of `foot`, and when its reference had spikes, which are taken out.

    `kept` (n_triangles, 12): the taxels that are fit to be asked; `cycles` (n,) those that hold new readings.
    """
    slots = np.flatnonzero(kept.ravel())
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    used = cycles & (np.diff(t_s, prepend=-1.0) > 0)
    cycle_s = t_s[used]
    counts, valid = (each.reshape(len(foot), -1)[used][:, slots] for each in (foot.counts, foot.valid))
    age_s = np.maximum(foot.age_ns[used], 0)[:, slots // N_TAXELS] * 1e-9
    read = _filled(counts, valid)
    count = _together(read, cycle_s, age_s)
    first = block_starts(cycle_s)
    reference = foot.reference
    if reference is None:
        raise DiagnosisError(f"{recording.folder}: expected a reference, found none: what was the load?")
    reference_s = reference.time_s
    rows = reference_s is None
    if reference_s is None:
        reference_s = clocks.row_times_s(cycle_s, len(reference))
    else:
        reference_s = reference_s - (foot.t_ns[0] * 1e-9 if reference.clock == "can" else reference_s[0])
    pressure_pa, spike = despiked(reference_s, _pressure_pa(recording, reference))
    began_s = float(reference.time_s[0]) if reference.time_s is not None and reference.clock == "own" else 0.0
    offset_s, rate, std = 0.0, 0.0, (0.0, 0.0)
    if reference.clock == "own" or rows:
        # The middle half of the taxels: one that leaps or a board that steps bends edges by seconds.
        mean = -trim_mean(count, 0.25, axis=1)
        x = (mean - mean.mean()) / mean.std()
        features = np.stack([x**0, x, x**2, x**3], axis=1)
        # Rows without times are no clock: how far they run apart says nothing about quartzes.
        align = clocks.fit if rows else _clock
        found = align(cycle_s, features, reference_s, pressure_pa)
        offset_s, rate, std = found.offset_s, found.rate, (found.offset_std_s, found.rate_std)
    load = Load(*_on_grid(reference_s, pressure_pa), "own" if rows else reference.clock)
    blocks = Observed(
        recording.folder.name, recording.folder, foot.layout, slots, cycle_s, first, np.empty(0),
        noise_of_readings(read), None, load, offset_s, rate, std, rows, began_s,
    )  # fmt: skip
    temperature = None
    if TEMPERATURE in reference.columns:
        known = ~np.isnan(reference[TEMPERATURE])
        if known.any():
            at = blocks.reference_s(cycle_s)
            temperature = blocks.blocks(np.interp(at, reference_s[known], reference[TEMPERATURE][known]))
    seen = replace(blocks, count=blocks.blocks(count), temperature_c=temperature)
    when = ((reference_s[a] - offset_s, reference_s[b] - offset_s) for a, b in stretches(spike))
    return seen, tuple((float(a), float(b)) for a, b in when)


def _clock(cycle_s: Array, features: Array, reference_s: Array, pressure_pa: Array) -> Clock:
    """By the edges; a rate that no two quartzes have only where it explains clearly more of them."""
    usual = clocks.fit(cycle_s, features, reference_s, pressure_pa, most_rate=USUAL_RATE)
    if abs(usual.rate) < USUAL_RATE and usual.explained > SURE:
        return usual
    wide = clocks.fit(cycle_s, features, reference_s, pressure_pa)
    return wide if 1.0 - wide.explained < SHARPER * (1.0 - usual.explained) else usual


def _together(count: Array, cycle_s: Array, age_s: Array) -> Array:
    """(n, m) counts at the moments of the cycles, between those at which each triangle was read."""
    found = count.copy()
    for column in np.flatnonzero(age_s.any(axis=0)):
        found[:, column] = np.interp(cycle_s, cycle_s - age_s[:, column], count[:, column])
    return found


def _pressure_pa(recording: Recording, reference: Reference) -> Array:
    if recording.kind != "chamber":
        raise DiagnosisError(f"{recording.folder}: expected a recording of kind chamber, found {recording.kind}")
    return reference["pressure_pa"]


def _on_grid(time_s: Array, pressure_pa: Array) -> tuple[float, float, Array]:
    """Where the grid begins, its step, and (N, 1) the readings averaged over SMOOTH_S."""
    known = ~np.isnan(pressure_pa)
    t, p = time_s[known], pressure_pa[known]
    n_fine, n_half = 4, max(round(SMOOTH_S / 2 / (STEP_S / 4)), 1)
    grid = np.arange(t[0], t[-1], STEP_S)
    fine = np.interp(t[0] + np.arange(n_fine * len(grid)) * STEP_S / n_fine, t, p)
    total = np.concatenate([[0.0], np.cumsum(fine)])
    middle = n_fine * np.arange(len(grid))
    low, high = np.maximum(middle - n_half, 0), np.minimum(middle + n_half + 1, len(fine))
    smooth = (total[high] - total[low]) / (high - low)
    return float(t[0]), STEP_S, smooth[:, None]


def _filled(count: NDArray[np.uint8], valid: NDArray[np.bool_]) -> Array:
    """(n, m) counts, with a straight line in the place of those that are not valid."""
    filled = count.astype(np.float64)
    rows = np.arange(len(count))
    for column in np.flatnonzero(~valid.all(axis=0) & valid.any(axis=0)):
        good = valid[:, column]
        filled[~good, column] = np.interp(rows[~good], rows[good], filled[good, column])
    return filled
