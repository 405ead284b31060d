"""Simulate a recorded chamber trial: an insole with the model's curves and effects under the recorded pressure.

The pressure of the reference is smoothed by local cubics, because its noise would act on the simulated insole.
The boards are emulated and send as often as those of the recording had new readings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..config import Board, Config, Insole
from ..errors import SimulationError
from ..physics.calibration import Calibration
from ..physics.effect import Effect
from ..recording.copies import InsoleContents
from ..recording.loading import FootRecording, Recording, as_configured
from ..recording.read_times import median_interval_ns
from ..recording.reference import Reference
from ..recording.writer import ReferenceContents, write
from ..skin.geometry import PRESSURE_TAXELS
from .emulator import Emulator
from .reference_insole import reference_insole
from .scenarios.chamber import Chamber
from .sensed import SensedLoad, SimulatedInsole
from .sensors import Temperature
from .trial import START_NS, check_boards_and_bus, with_progress

OF_THE_TRIAL = ("drift", "rezero")  # effects that belong to one trial and not to the insole
SMOOTH_S, LEAST_ROWS = 0.06, 3  # half the window of a cubic
DITHER_COUNT = 0.35  # standard deviation of added noise; the mean rounding error is then at most 0.03 counts
GAP_S, GAP_ROWS = 0.5, 3  # longest gap of the pressure that is interpolated
TEMPERATURE = "temperature_c"
_INTERFACE = "can0"
_MOST_PERIOD_MS = 255

Array = NDArray[np.float64]


def simulate_recorded(
    recording: Recording,
    foot: FootRecording,
    model: Calibration,
    folder: Path,
    progress: Callable[[float], None] = lambda share: None,
) -> Path:
    """Write the simulated trial as the recording `folder`, and return its path.

    The sensors have the curves and the effects of `model`. Raises SimulationError if `recording` is not of a chamber,
    because the load of its taxels is then unknown, or has no pressure.
    """
    refuse_unknown_load(recording, foot)
    reference = foot.reference
    assert reference is not None
    time_s, pressure_pa, warm = _course(recording, foot, reference)
    boards = [_as_sent(board, foot) for board in map(as_configured, foot.boards)]
    config = Config(insoles=(Insole(foot=foot.foot, boards=tuple(boards)),))
    check_boards_and_bus(config, [foot.layout])
    insole = SimulatedInsole(foot.layout, boards, _as_read(model, foot, boards), effects_of_the_insole(model))
    load = Chamber([foot.layout], np.stack([time_s - time_s[0], pressure_pa], axis=1))
    emulator = Emulator(
        config, [foot.layout], SensedLoad(load, [insole], warm), nominal_sensors=True, temperature_c=warm,
        shifts=insole.real_shifts(), noise=DITHER_COUNT / reference_insole().noise_count,
    )  # fmt: skip
    start_ns = round(time_s[0] * 1e9) if reference.clock == "can" and reference.time_s is not None else START_NS
    seconds = float(time_s[-1] - time_s[0])
    columns = {"time_s": start_ns * 1e-9 + time_s - time_s[0], "pressure_pa": np.round(pressure_pa, 1)}
    return write(
        folder,
        kind="chamber",
        can_origin="simulated",
        insoles=[InsoleContents(foot.foot, boards, foot.layout, replace(insole.calibration, effects=()))],
        frames=with_progress(emulator.batches(start_ns, seconds), start_ns, seconds, progress),
        interfaces=(_INTERFACE,),
        reference=[ReferenceContents(foot.foot, "can", columns)],
        source=f"insole diagnose --simulate: the trial of {recording.folder.name}",
    )


def effects_of_the_insole(model: Calibration) -> list[Effect]:
    """Return the effects of `model` that belong to the insole."""
    return [effect for effect in model.effects if effect.law.word not in OF_THE_TRIAL]


def refuse_unknown_load(recording: Recording, foot: FootRecording) -> None:
    """Raise SimulationError if no reference gives the load of every taxel."""
    if recording.kind == "shoe":
        taxels = int(np.count_nonzero(PRESSURE_TAXELS)) * len(foot.layout)
        raise SimulationError(
            f"{recording.folder}: --simulate is of chambers alone: three channels of a shoe do not determine the load "
            f"of {taxels} taxels; leave it out, or give a simulated recording of the trial with --simulation"
        )
    if recording.kind != "chamber" or foot.reference is None:
        raise SimulationError(
            f"{recording.folder}: --simulate needs the pressure of a chamber, which is the load of every taxel, found "
            f"kind {recording.kind}: give a simulated recording of the trial with --simulation"
        )


def _course(recording: Recording, foot: FootRecording, reference: Reference) -> tuple[Array, Array, Temperature | None]:
    """Return times (n,) in s, pressures (n,) in Pa and, if known, the temperature of the longest part without a gap.

    If the reference has no times, its rows are spread evenly over the cycles.
    """
    pressure = reference["pressure_pa"]
    time_s = reference.time_s
    if time_s is None:
        cycle_s = np.maximum.accumulate(foot.t_ns - foot.t_ns[0]) * 1e-9
        time_s = np.arange(len(pressure)) * float(cycle_s[-1]) / max(len(cycle_s) - 1, 1)
    known = np.isfinite(pressure) & (np.diff(time_s, prepend=-np.inf) > 0)
    t, p = time_s[known], pressure[known]
    if len(t) < 2 * LEAST_ROWS:
        raise SimulationError(
            f"{recording.folder}: --simulate needs a pressure of the chamber all the time, found {len(t)} rows of the "
            "reference that have one: was the gauge recorded?"
        )
    row_s = float(np.median(np.diff(t)))
    edges = np.flatnonzero(np.diff(t) > max(GAP_S, GAP_ROWS * row_s)) + 1
    first, end = max(zip([0, *edges], [*edges, len(t)], strict=True), key=lambda each: t[each[1] - 1] - t[each[0]])
    grid_s = np.arange(t[first], t[end - 1], row_s)
    smooth_pa = _smoothed(np.interp(grid_s, t[first:end], p[first:end]), max(round(SMOOTH_S / row_s), LEAST_ROWS))
    return grid_s, smooth_pa, _temperature(reference, time_s, float(grid_s[0]))


def _smoothed(values: Array, half: int) -> Array:
    """Return values (n,) smoothed by cubics over `half` values on both sides (Savitzky & Golay 1964), but the ends."""
    if len(values) <= 2 * half:
        return values
    x = np.arange(-half, half + 1) / half
    weights = np.linalg.pinv(np.vander(x, 4, increasing=True))[0]
    smoothed = values.copy()
    smoothed[half:-half] = np.convolve(values, weights, mode="valid")
    return smoothed


def _temperature(reference: Reference, time_s: Array, began_s: float) -> Temperature | None:
    values = reference.columns.get(TEMPERATURE)
    if values is None or not np.isfinite(values).any():
        return None
    there = np.isfinite(values)
    times, known = time_s[there] - began_s, values[there]
    return lambda t_s: np.interp(t_s, times, known)


def _as_sent(board: Board, foot: FootRecording) -> Board:
    """The board with the period at which the recording has new readings of it, where it has any."""
    own = np.flatnonzero(foot.layout.identities[:, 0] == board.address)
    apart_ns = [median_interval_ns(foot.read_ns[foot.is_new[:, row], row]) for row in own.tolist()]
    apart_ms = 1e-6 * np.array([each for each in apart_ns if np.isfinite(each)])
    period_ms = round(float(np.median(apart_ms))) if len(apart_ms) else board.period_ms
    return replace(board, interface=_INTERFACE, period_ms=min(max(period_ms, 1), _MOST_PERIOD_MS))


def _as_read(model: Calibration, foot: FootRecording, boards: list[Board]) -> Calibration:
    """The curves of `model`, about what the emulated boards read at rest."""
    rest = {board.address: board.no_load + (1 - 2.0**-board.shift) / 2 for board in boards}  # a floor reads less
    of_row = np.array([rest[int(address)] for address in foot.layout.identities[:, 0]])
    return replace(
        model, baseline_count=np.where(model.usable, of_row[:, None], np.nan), covariance_pa2=None, highest_count=None,
        effects=(), extensions={}, provenance={"made_by": "insole diagnose --simulate"},
    )  # fmt: skip
