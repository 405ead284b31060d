"""A recording into what a diagnosis looks at: usable taxels, blocks, and the load on a regular grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter
from scipy.stats import trim_mean

from ..calibration import clock as clocks
from ..errors import DiagnosisError
from ..physics.law import Array
from ..recording.loading import FootRecording, Recording
from ..recording.read_times import at_cycles
from ..skin.geometry import N_TAXELS
from .audit import Audit
from .floor import noise_of_readings
from .jumps import despiked
from .observations.alignment import fit_own_clock
from .observed import Load, Observed, block_starts, stretches
from .readings import bridged

STEP_S = 0.02  # of the load's grid: finer than a block of cycles
SMOOTH_S = 0.1  # over so long a reference is smoothed: its noise would otherwise drive plays
FINE = 4  # steps in one of them, in which it is smoothed
LEAST_TOLD = 0.3
LEAST_CYCLES = 100  # two seconds: what a diagnosis needs is asked of the load, later
TEMPERATURE = "temperature_c"


def observe(
    recording: Recording,
    foot: FootRecording,
    kept: NDArray[np.bool_],
    audited: Audit,
) -> tuple[Observed, tuple[tuple[float, float], ...]]:
    """What a diagnosis looks at of `foot`, and when its reference had spikes, which are taken out.

    `kept` (n_triangles, 12): the taxels that are asked; `audited`: which of their readings are believed.
    """
    slots = np.flatnonzero(kept.ravel())
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    used = audited.cycles & (np.diff(t_s, prepend=-1.0) > 0)
    if used.sum() < LEAST_CYCLES:
        raise DiagnosisError(
            f"{recording.folder}: {used.sum()} of {len(used)} cycles have new readings of most taxels that work, "
            f"expected at least {LEAST_CYCLES}: do the boards send what they read, and do all of them?"
        )
    cycle_s = t_s[used]
    counts, believed = (each.reshape(len(foot), -1)[used][:, slots] for each in (foot.counts, audited.believed))
    behind_s = foot.behind_ns[used][:, slots // N_TAXELS] * 1e-9
    count = bridged(at_cycles(counts, believed, cycle_s, behind_s), believed, cycle_s)
    noise_count = noise_of_readings(counts.astype(float), believed)
    reference = foot.reference
    if reference is None or recording.kind != "chamber":
        raise DiagnosisError(
            f"{recording.folder}: expected a chamber's pressure, found kind {recording.kind}: what was the load? "
            "Record it, or give a simulated recording of the trial with --simulation"
        )
    reference_s = reference.time_s
    rows = reference_s is None
    if reference_s is None:
        reference_s = clocks.row_times_s(t_s, len(reference))  # of all cycles: a row stood beside each
    else:
        reference_s = reference_s - (foot.t_ns[0] * 1e-9 if reference.clock == "can" else reference_s[0])
    pressure_pa, spike = despiked(reference_s, reference["pressure_pa"])
    began_s = float(reference.time_s[0]) if reference.time_s is not None and reference.clock == "own" else 0.0
    offset_s, rate, std = 0.0, 0.0, (0.0, 0.0)
    if reference.clock == "own" or rows:
        # The middle half of the taxels: one that leaps or a board that steps bends edges by seconds.
        mean = -trim_mean(count, 0.25, axis=1)
        found = fit_own_clock(cycle_s, mean, reference_s, pressure_pa, memory=not rows)
        offset_s, rate, std = found.offset_s, found.rate, (found.offset_std_s, found.rate_std)
    load = Load(*_on_grid(reference_s, pressure_pa), "own" if rows else reference.clock)
    # Where the reference says nothing the load is not known.
    said_s = offset_s + (1.0 + rate) * cycle_s
    told = (said_s >= load.t_s[0]) & (said_s <= load.t_s[-1])
    if told.mean() < LEAST_TOLD:
        raise DiagnosisError(
            f"{recording.folder}: the reference covers {told.mean():.0%} of the cycles, expected at least "
            f"{LEAST_TOLD:.0%}: is it of the same trial, and did it run all the time?"
        )
    cycle_s, count = cycle_s[told], count[told]
    first = block_starts(cycle_s)
    blocks = Observed(
        recording.folder.name, recording.folder, foot.layout, slots, cycle_s, first, np.empty(0),
        noise_count, None, load, offset_s, rate, std, rows, began_s,
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


def _on_grid(time_s: Array, pressure_pa: Array) -> tuple[float, float, Array]:
    """Where the grid begins, its step, and (N, 1) the readings smoothed over SMOOTH_S.

    By parabolas: a mean would be a memory itself, symmetric in time, and beside it a lag that shall be as wide as the
    one that is there is not as skew, which a lag with a share does better.
    """
    known = ~np.isnan(pressure_pa)
    t, p = time_s[known], pressure_pa[known]
    grid_s = np.arange(t[0], t[-1], STEP_S / FINE)
    fine = savgol_filter(np.interp(grid_s, t, p), 2 * round(SMOOTH_S * FINE / STEP_S / 2) + 1, 2)
    return float(t[0]), STEP_S, fine[::FINE, None]
