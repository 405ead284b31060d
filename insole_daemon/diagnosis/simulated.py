"""A recording beside a simulated one of the same trial, where the load has places: who and where the taxels are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ..calibration import clock as clocks
from ..errors import CalibrationError, DiagnosisError
from ..physics.calibration import Calibration
from ..physics.law import Array
from ..recording.loading import FootRecording, Recording
from ..skin.geometry import N_TAXELS
from .field import Field, field, pressure_of
from .floor import noise_of_readings
from .mapping import NOWHERE, PLACE, SPREAD, TIME, Askew, Interpolation, Projected, Sums
from .observed import Observed, block_starts
from .readings import filled

PA_PER_COUNT = 8000.0  # of a taxel that nobody calibrated: what the configuration assumes
USUAL_RATE = 3e-4  # that two quartzes differ by, at the most
LEAST_TOLD = 0.8  # of the cycles, that a simulation of the trial covers
FOLD_S, N_FOLDS = 4.0, 10  # some whole steps, held out together
SWAPPED = 0.5  # of what two triangles leave, that being each other takes away
SWAP_SIGMAS2 = 200.0  # in squares of what the insole leaves otherwise
LEAST_MM = 0.5  # RMS over the taxels, that a map is off by
LEAST_K = 0.12  # of crosstalk: less, and a load that is a little too sharp looks the same
SIGMAS = 5.0
SHARE = 0.25  # of what is left for a mixture of courses to explain
LEAST_MOVED = 0.03  # of a reading's noise, RMS


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """Who and where the taxels are, in truth, by what was found; `row` as `Askew.places_m` has it."""

    row: NDArray[np.intp]  # (n_triangles,)
    swaps: tuple[tuple[int, int], ...]  # rows of the triangles that are each other
    theta: Array
    std: Array  # of θ
    askew: bool
    spread: bool
    steps: tuple[tuple[str, float], ...]  # what is left after each that was found, mean square in units of noise


def observe(
    recording: Recording,
    foot: FootRecording,
    kept: NDArray[np.bool_],
    cycles: NDArray[np.bool_],
    simulation: Recording,
    model: Calibration | None,
    progress: Callable[[str], None],
) -> tuple[Observed, Mapped]:
    """What a diagnosis looks at, the load of `simulation` where the taxels were found to be.

    `kept` (n_triangles, 12): the taxels that are fit to be asked; `cycles` (n,) those that hold new readings.
    """
    told = field(simulation, foot)
    slots = np.flatnonzero(kept.ravel())
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    used = cycles & (np.diff(t_s, prepend=-1.0) > 0)
    t_s = t_s[used]
    count, valid = (each.reshape(len(foot), -1)[used][:, slots] for each in (foot.counts, foot.valid))
    read = filled(count, valid)
    noise = noise_of_readings(read)
    age_s = np.maximum(np.median(foot.age_ns[used], axis=0), 0.0)[slots // N_TAXELS] * 1e-9
    offset_s, rate, std = _clock(recording, simulation, foot, told, slots, t_s, read)
    at_s = offset_s + (1.0 + rate) * t_s
    inside = (at_s >= told.t_s[0] + age_s.max()) & (at_s <= told.t_s[-1])
    if inside.mean() < LEAST_TOLD:
        raise DiagnosisError(
            f"{simulation.folder}: it covers {inside.mean():.0%} of the recording {recording.folder.name}, expected at "
            f"least {LEAST_TOLD:.0%}: simulate the whole trial that was recorded"
        )
    t_s, at_s, read = t_s[inside], at_s[inside], read[inside]
    progress("looking where the taxels are")
    usable = model is not None and bool(model.usable.ravel()[slots].all())
    if model is not None and usable:
        pressure, pa_per_count = pressure_of(model, slots, read)
    else:
        pressure, pa_per_count = -PA_PER_COUNT * read, np.full(len(slots), PA_PER_COUNT)
    scale_pa = noise * pa_per_count
    fold = ((t_s - t_s[0]) // FOLD_S).astype(np.intp) % N_FOLDS
    sums = Sums(pressure / scale_pa, told, at_s, fold)
    askew = Askew(Interpolation(told), foot.layout, slots, scale_pa, age_s)
    mapped = look(askew, sums, len(foot.layout))
    load = told.load(askew.shapes(mapped.theta, mapped.row), age_s)
    first = block_starts(t_s)
    blocks = Observed(
        recording.folder.name, recording.folder, foot.layout, slots, t_s, first, np.empty(0), noise, None,
        load, offset_s, rate, std, False, 0.0,
    )  # fmt: skip
    return replace(blocks, count=blocks.blocks(read)), mapped


def look(askew: Askew, sums: Sums, n_triangles: int) -> Mapped:
    """Swaps first, then the map and what the cover spreads: each where it takes away enough of what is left."""
    at = sums.without()
    row = np.arange(n_triangles)
    every = np.ones(len(askew.slots), bool)
    theta, cost = askew.fit(NOWHERE, [TIME], row, at, every)
    swaps = _swaps(askew.as_another(theta, at), np.bincount(askew.slots // N_TAXELS, minlength=n_triangles))
    size = at.rows * len(askew.slots)
    steps = [("", cost / size)]
    for a, b in swaps:
        row[[a, b]] = b, a
    if swaps:
        theta, cost = askew.fit(theta, [TIME], row, at, every)
        steps.append(("swapped_triangles", cost / size))
    found = Mapped(row, swaps, theta, np.zeros_like(theta), False, False, ())
    for word, part in (("map_transform", PLACE), ("crosstalk", SPREAD)):
        tried = _with(askew, sums, at, found, part)
        if tried is not None:
            found = tried
            steps.append((word, float(np.sum(askew.left(found.theta, row, at)[0] ** 2)) / size))
    return replace(found, steps=tuple(steps))


def _with(askew: Askew, sums: Sums, at: Projected, known: Mapped, part: slice) -> Mapped | None:
    """`known` with another part of θ; None where that is too little, or explains too little."""
    free = [*([PLACE] if known.askew else []), part, TIME]
    theta, kept = known.theta, np.ones(len(askew.slots), bool)
    for _ in range(3):  # which taxels lie where the load is known depends on where they lie
        theta, after = askew.fit(theta, free, known.row, at, kept)
        kept = askew.known(theta, known.row)
    theta, after = askew.fit(theta, free, known.row, at, kept)
    before = askew.fit(known.theta, free[:-2] + free[-1:], known.row, at, kept)[1]
    others = [askew.fit(theta, free, known.row, sums.without(i), kept)[0] for i in range(sums.folds)]
    std = np.sqrt((sums.folds - 1) * np.var(others, axis=0))
    noise = float(kept.sum() * (at.z.shape[1] - 1))
    gain = before - after
    enough = gain > SHARE * max(before - noise, 0.0) if part is PLACE else True
    enough = enough and gain > LEAST_MOVED**2 * at.rows * kept.sum()
    if part is PLACE:
        nowhere = askew.places_m(NOWHERE, known.row)
        moved = float(np.sqrt(np.mean(np.sum((askew.places_m(theta, known.row) - nowhere) ** 2, axis=1)))) * 1e3
        sure = np.abs(theta[PLACE]) > SIGMAS * std[PLACE]
        return replace(known, theta=theta, std=std, askew=True) if enough and moved > LEAST_MM and sure.any() else None
    spread = float(theta[SPREAD][0])
    sure_k = spread > max(LEAST_K, SIGMAS * float(std[SPREAD][0]))
    return replace(known, theta=theta, std=std, spread=True) if enough and sure_k else None


def _swaps(left: Array, taxels: NDArray[np.intp]) -> tuple[tuple[int, int], ...]:
    """Pairs of triangles that are each other, by what each leaves as another (n_triangles, n_triangles)."""
    own = np.diag(left)
    there = np.flatnonzero(taxels > 0)
    usual = float(np.median(own[there] / taxels[there]))
    chosen = np.arange(len(left))
    chosen[there] = there[linear_sum_assignment(left[np.ix_(there, there)])[1]]
    found = []
    for a, b in enumerate(chosen.tolist()):
        if a < b and chosen[b] == a:
            before, after = own[a] + own[b], left[a, b] + left[b, a]
            if before - after > max(SWAPPED * before, SWAP_SIGMAS2 * max(usual, 1.0)):
                found.append((a, b))
    return tuple(found)


def _clock(
    recording: Recording, simulation: Recording, foot: FootRecording, told: Field, slots: NDArray[np.intp],
    t_s: Array, read: Array,
) -> tuple[float, float, tuple[float, float]]:  # fmt: skip
    """Offset and rate of the simulation's clock against the recording's, by the edges that all boards see."""
    boards = foot.layout.identities[:, 0]
    mine, its = boards[slots // N_TAXELS], boards[told.slots // N_TAXELS]
    both = [board for board in np.unique(boards) if (mine == board).any() and (its == board).any()]
    reference = np.stack([told.courses @ told.shapes[its == board].mean(axis=0) for board in both], axis=1)
    x = np.stack([-read[:, mine == board].mean(axis=1) for board in both], axis=1)
    x = (x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-9)
    features = np.concatenate([np.ones((len(x), 1)), x, x**2], axis=1)
    try:
        found = clocks.fit(t_s, features, told.t_s, reference, most_rate=USUAL_RATE)
    except CalibrationError as error:
        raise DiagnosisError(
            f"{simulation.folder}: no stretch of it goes with {recording.folder.name} ({error}): expected a simulation "
            "of the same trial, which starts at the same instant within 20 s"
        ) from error
    return found.offset_s, found.rate, (found.offset_std_s, found.rate_std)
