"""A recording beside a simulated one of the same trial, where the load has places: who and where the taxels are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from ..calibration import clock as clocks
from ..errors import CalibrationError, DiagnosisError
from ..physics.calibration import Calibration
from ..physics.effect import Effect, Where, effect
from ..physics.effects import laws
from ..physics.law import Array
from ..recording.loading import FootRecording, Recording
from ..recording.read_times import at_cycles
from ..skin.geometry import N_TAXELS
from .audit import Audit
from .deciding import sure
from .explained import Insole
from .field import Field, field, pressure_of
from .finding import Finding, Quantity
from .floor import noise_of_readings
from .mapping import NOWHERE, PLACE, SPREAD, TIME, Askew, Interpolation, Projected, Sums
from .observed import Observed, moments

PA_PER_COUNT = 8000.0  # of a taxel that nobody calibrated: what the configuration assumes
USUAL_RATE = 3e-4  # that two quartzes differ by, at the most
ALIKE_S = 0.5  # some of a step
EDGE_S = 0.1  # of a simulation, left out at both ends: physics moves the clock that its edges agree on
LEAST_TOLD = 0.8  # of the cycles, that a simulation of the trial covers
FOLD_S, N_FOLDS = 4.0, 10  # some whole steps, held out together
SWAPPED = 0.5  # of what two triangles leave, that being each other takes away
SWAP_SIGMAS2 = 200.0  # in squares of what the insole leaves otherwise
LEAST_MM = 0.5  # RMS over the taxels, that a map is off by
LEAST_K = 0.12  # of crosstalk: less, and a load that is a little too sharp looks the same
SIGMAS = 5.0
SHARE = 0.25  # of what is left for a mixture of courses to explain
LEAST_MOVED = 0.03  # of a reading's noise, RMS
SHARP = 0.06  # of k: what a load that is a little too sharp adds to it


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """Who and where the taxels are, in truth, by what was found; `row` as `Askew.places_m` has it."""

    row: NDArray[np.intp]  # (n_triangles,)
    swaps: tuple[tuple[int, int], ...]  # rows of the triangles that are each other
    theta: Array
    std: Array  # of θ
    askew: bool
    spread: bool
    left: Mapping[str, tuple[float, float]]  # by word: held-out mean square without and with it, in units of noise
    floor: float  # of it: what is no mixture of the courses at all, and what noise leaves of one
    chance: float  # by how much it is off by chance


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
    new = foot.valid & foot.is_new[..., None]
    count, new = (each.reshape(len(foot), -1)[used][:, slots] for each in (foot.counts, new))
    behind_s = foot.behind_ns[used][:, slots // N_TAXELS] * 1e-9
    # Each triangle as long before the cycles as it usually is.
    age_s = np.median(behind_s, axis=0)
    read = at_cycles(count, new, t_s, behind_s - age_s)
    noise = noise_of_readings(count.astype(float), new)
    offset_s, rate, std = clock(recording, simulation, foot, told, slots, t_s, read)
    at_s = offset_s + (1.0 + rate) * t_s
    inside = (at_s >= told.t_s[0] + age_s.max() + EDGE_S) & (at_s <= told.t_s[-1] - EDGE_S)
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
    first = moments(t_s)
    blocks = Observed(
        recording.folder.name, recording.folder, foot.layout, slots, t_s, first, np.empty(0), noise, None,
        load, offset_s, rate, std, False, 0.0,
    )  # fmt: skip
    return replace(blocks, count=blocks.blocks(read)), mapped


def loads(
    recording: Recording, foot: FootRecording, audited: Audit, simulation: Recording, xy_m: Array
) -> Callable[[Array], Array]:
    """What gives the (n, n_triangles, 12) Pa of `simulation` at the places `xy_m` (n_triangles, 12, 2).

    It is asked with the (n, n_triangles) moments of the recording, in s since its first frame, when each was read. What
    comes after the end of the simulation is a guess: the load of that earlier stretch whose readings were most alike.
    """
    told = field(simulation, foot)
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    used = audited.cycles & (np.diff(t_s, prepend=-1.0) > 0)
    slots = np.flatnonzero(audited.kept.ravel())
    new = foot.valid & foot.is_new[..., None]
    counts, new = (each.reshape(len(foot), -1)[used][:, slots] for each in (foot.counts, new))
    read = at_cycles(counts, new, t_s[used], foot.behind_ns[used][:, slots // N_TAXELS] * 1e-9)
    offset_s, rate, _ = clock(recording, simulation, foot, told, slots, t_s[used], read)
    shapes = Interpolation(told).shapes(xy_m.reshape(-1, 2)).reshape(*xy_m.shape[:2], -1)
    courses = CubicSpline(told.t_s, told.courses)
    missing_s = offset_s + (1.0 + rate) * float(t_s[-1]) - float(told.t_s[-1])
    back_s = _alike(t_s[used], read, missing_s) if missing_s > 0 else 0.0

    def at(read_s: Array) -> Array:
        its_s = offset_s + (1.0 + rate) * read_s
        its_s = np.clip(np.where(its_s > told.t_s[-1], its_s - back_s, its_s), told.t_s[0], told.t_s[-1])
        pressure: Array = np.einsum("ntr,tkr->ntk", courses(its_s), shapes)
        return pressure

    return at


def _alike(t_s: Array, read: Array, missing_s: float) -> float:
    """How long before its end the recording read (n, m) what is most like its last `missing_s` with ALIKE_S before."""
    n, rows = len(t_s), int(np.count_nonzero(t_s > t_s[-1] - missing_s - ALIKE_S))
    back = np.arange(int(np.count_nonzero(t_s > t_s[-1] - missing_s)), n - rows)
    if not back.size:
        return 0.0
    apart = [float(np.sum((read[n - rows - each : n - each] - read[n - rows :]) ** 2)) for each in back]
    return float(t_s[-1] - t_s[-1 - int(back[np.argmin(apart)])])


def look(askew: Askew, sums: Sums, n_triangles: int) -> Mapped:
    """Swaps first, then the map and what the cover spreads: each where it takes away enough on held-out steps."""
    at, row = sums.without(), np.arange(n_triangles)
    every = np.ones(len(askew.slots), bool)
    theta, _ = askew.fit(NOWHERE, [TIME], row, at, every)
    swaps = _swaps(askew.as_another(theta, at), np.bincount(askew.slots // N_TAXELS, minlength=n_triangles))
    floor = float(np.mean(at.beyond + at.z.shape[1])) / at.rows
    chance = SIGMAS * float(np.sqrt(2.0 / at.z.size)) * at.z.shape[1] / at.rows
    known = Mapped(row, (), theta, np.zeros_like(theta), False, False, {}, floor, chance)
    if swaps:
        row = row.copy()
        for a, b in swaps:
            row[[a, b]] = b, a
        theta, _ = askew.fit(theta, [TIME], row, at, every)
        left = tuple(askew.held_out(theta, [TIME], each, sums, every)[0] for each in (known.row, row))
        known = replace(known, row=row, swaps=swaps, theta=theta, left={"swapped_triangles": (left[0], left[1])})
    known = _askew(askew, sums, at, known)
    return _spread(askew, sums, at, known)


def _askew(askew: Askew, sums: Sums, at: Projected, known: Mapped) -> Mapped:
    theta, row, kept = known.theta, known.row, np.ones(len(askew.slots), bool)
    for _ in range(3):  # which taxels lie where the load is known depends on where they lie
        theta, _ = askew.fit(theta, [PLACE, TIME], row, at, kept)
        kept = askew.known(theta, row)
        if not kept.any():
            return known
    theta, _ = askew.fit(theta, [PLACE, TIME], row, at, kept)
    after, thetas = askew.held_out(theta, [PLACE, TIME], row, sums, kept)
    before, _ = askew.held_out(known.theta, [TIME], row, sums, kept)
    std = np.sqrt((sums.folds - 1) * np.var(thetas, axis=0))
    moved = askew.places_m(theta, row) - askew.places_m(NOWHERE, row)
    moved_mm = 1e3 * float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    # Nothing explains what is no mixture of the courses at all, and what noise leaves of one.
    floor = float(np.mean(at.beyond[kept] + at.z.shape[1])) / at.rows
    enough = before - after > max(SHARE * (before - floor), LEAST_MOVED**2)
    if not (enough and moved_mm > LEAST_MM and (np.abs(theta[PLACE]) > SIGMAS * std[PLACE]).any()):
        return known
    return replace(known, theta=theta, std=std, askew=True, left={**known.left, "map_transform": (before, after)})


def _spread(askew: Askew, sums: Sums, at: Projected, known: Mapped) -> Mapped:
    kept, row = askew.known(known.theta, known.row), known.row
    rest = [PLACE, TIME] if known.askew else [TIME]
    if not kept.any():
        return known
    theta, _ = askew.fit(known.theta, [SPREAD, *rest], row, at, kept)
    spread = float(theta[SPREAD][0])
    if spread < LEAST_K:
        return known
    after, thetas = askew.held_out(theta, [SPREAD, *rest], row, sums, kept)
    before, _ = askew.held_out(known.theta, rest, row, sums, kept)
    std = np.sqrt((sums.folds - 1) * np.var(thetas, axis=0))
    floor = float(np.mean(at.beyond[kept] + at.z.shape[1])) / at.rows
    if before - after < max(SHARE * (before - floor), LEAST_MOVED**2) or spread < SIGMAS * float(std[SPREAD][0]):
        return known
    return replace(known, theta=theta, std=std, spread=True, left={**known.left, "crosstalk": (before, after)})


def findings(insole: Insole, mapped: Mapped) -> tuple[list[Finding], list[Effect]]:
    """What is said of it, and the same as effects of the model."""
    found: list[Finding] = []
    identities = insole.layout.identities
    noise = float(np.sqrt(np.mean(insole.noise_count**2)))

    def say(word: str, place: Where, parameters: dict[str, Quantity], text: str) -> None:
        left = mapped.left[word]
        before, after = (noise * float(np.sqrt(each)) for each in left)
        confidence = sure(left[0] - mapped.floor, max(left[1] - mapped.floor, mapped.chance))
        found.append(
            Finding(
                effect=word, foot=insole.foot, where=place, recordings=insole.recordings,
                equation=laws()[word].equation, parameters=parameters, explains=before**2 - after**2,
                heldout_count=(before, after), confidence=confidence,
                sentence=f"{text} On held-out steps it takes the error from {before:.2f} to {after:.2f} counts.",
            )
        )  # fmt: skip

    effects: list[Effect] = []
    for pair in mapped.swaps:
        ids = tuple(tuple(each) for each in identities[list(pair)].tolist())
        names = " and ".join(f"{board}.{triangle}" for board, triangle in ids)
        quantity = Quantity([list(each) for each in ids], [[0, 0], [0, 0]], "1")
        say("swapped_triangles", Where("triangle", ids), {"pair": quantity}, f"triangles {names} report as each other.")
        effects.append(effect("swapped_triangles", Where("triangle", ids), pair=ids))
    if mapped.askew:
        (x, y, turned, size), std = mapped.theta[PLACE].tolist(), mapped.std[PLACE].tolist()
        say(
            "map_transform", Where(),
            {
                "x_mm": Quantity(x, std[0], "mm"), "y_mm": Quantity(y, std[1], "mm"),
                "rotation_deg": Quantity(turned, std[2], "deg"),
                "scale": Quantity(float(np.exp(size)), float(np.exp(size)) * std[3], "1"),
            },
            f"the insole lies {x:+.1f} mm forward, {y:+.1f} mm to the left and turned by {turned:+.2f}° from its map.",
        )  # fmt: skip
        effects.append(effect("map_transform", Where(), x_mm=x, y_mm=y, rotation_deg=turned, scale=float(np.exp(size))))
    if mapped.spread:
        k, std_k = float(mapped.theta[SPREAD][0]), float(np.hypot(mapped.std[SPREAD][0], SHARP))
        say(
            "crosstalk",
            Where(),
            {"k": Quantity(k, std_k, "1")},
            f"the cover spreads {k:.0%} of a load to its neighbours.",
        )
        effects.append(effect("crosstalk", Where(), k=k))
    return found, effects


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


def clock(
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
        found = clocks.fit_clock(t_s, features, told.t_s, reference, most_rate=USUAL_RATE)
    except CalibrationError as error:
        raise DiagnosisError(
            f"{simulation.folder}: no stretch of it goes with {recording.folder.name} ({error}): expected a simulation "
            "of the same trial, which starts at the same instant within 20 s"
        ) from error
    return found.offset_s, found.rate, (found.offset_std_s, found.rate_std)
