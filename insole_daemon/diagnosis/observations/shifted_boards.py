"""Detects boards whose digitiser shifts by another number of bits than the recording says.

Such a board's activation is off by a power of two, and its noise with it; a sensor's gain changes the activation alone.
The factor is estimated under a known load from the readings, on a walk from the board's share of the reference wrench.
Noise is that of all readings in a chamber, where the load changes slowly, and elsewhere that of unloaded readings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...physics.digitiser import codes_of, count_of
from ...physics.effect import Where
from ...physics.effects import laws
from ...physics.law import Array
from ...recording.document import RecordedBoard
from ...recording.loading import FootRecording
from ..finding import Finding, Quantity
from ..places import said
from .chamber import ChamberObservation
from .wrench import WrenchObservation

LEAST_BOARDS = 3  # with two, nobody knows which is off
MOST_BITS = 2
NEAR = 0.15  # of an octave: calibrations and curves that bend
ALL_NEAR = 0.3  # of an octave, of all boards alike: a memory moves them, too
LESS_NOISE = 0.8  # of the other boards', of a board whose readings are half as large; rounding keeps some
LEAST_EXPLAINED = 0.5  # of the mean square error of a walk's wrench, which a board at half or twice its load makes
UNLOADED = 0.02  # of the reference's range of f_z
LEAST_UNLOADED = 50  # pairs of successive unloaded readings: fewer do not determine the noise
MOST_MOVED = 0.98  # quantile of differences between unloaded readings that is still noise

Seen = TypeVar("Seen", bound=WrenchObservation)


def with_shifts(
    foot: FootRecording, seen: WrenchObservation, working: NDArray[np.bool_]
) -> tuple[WrenchObservation, list[Finding]]:
    """Return `seen` with the curves of such boards corrected, and a finding for each; from `working` taxels (T, 12)."""
    if seen.has_own_curves or len(np.unique(_boards(seen)[working.any(axis=1)])) < LEAST_BOARDS:
        return seen, []
    if isinstance(seen, ChamberObservation):
        return _of_known_load(foot, seen, working)
    return _of_walk(foot, seen, working)


def _of_known_load(
    foot: FootRecording, seen: ChamberObservation, working: NDArray[np.bool_]
) -> tuple[ChamberObservation, list[Finding]]:
    known = working & ~seen.cut_off & np.isfinite(seen.weight_variance)[..., None]
    noises = _noises(seen, working)
    factors = {board: _factor(seen, known & (_boards(seen) == board)[:, None]) for board in noises}
    findings: list[Finding] = []
    for board, factor in factors.items():
        others = [factors[other] for other in factors if other != board]
        octaves = float(np.log2(np.median(others) / factor))
        bits = _whole(octaves)
        if bits == 0 or abs(octaves - bits) > NEAR or not _is_as_loud(noises, board, bits):
            continue
        before = np.mean((seen.activation_count - seen.expected_count) ** 2, where=known)
        seen = _as_shifted(foot, seen, board, bits)
        after = np.mean((seen.activation_count - seen.expected_count) ** 2, where=known)
        findings.append(_finding(foot, seen, board, bits, max(float(before - after), 0.0)))
    settled = {("bit_shift", "board")} if np.isfinite(list(noises.values())).all() else set()
    octaves = -float(np.log2(np.median(list(factors.values()))))
    if np.rint(octaves) == 0.0 or abs(octaves - np.rint(octaves)) > ALL_NEAR:
        settled |= {("bit_shift", "insole")}
    return replace(seen, settled=seen.settled | settled), findings


def _of_walk(
    foot: FootRecording, seen: WrenchObservation, working: NDArray[np.bool_]
) -> tuple[WrenchObservation, list[Finding]]:
    noises, shares = _noises(seen, working), _shares(seen)
    findings: list[Finding] = []
    for board in noises:
        bits = _whole(float(np.log2(shares[board])))  # roughly: curves bend
        if bits == 0 or not _is_as_loud(noises, board, bits):
            continue
        right = _as_shifted(foot, seen, board, bits)
        before, after = float(seen.square_error[0]), float(right.square_error[0])
        shares_after = _shares(right)
        if after < (1.0 - LEAST_EXPLAINED) * before and abs(np.log2(shares_after[board])) < NEAR:
            seen, shares = right, shares_after
            findings.append(_finding(foot, seen, board, bits, before - after))
    return seen, findings


def _boards(seen: WrenchObservation) -> NDArray[np.int64]:
    return np.asarray(seen.layout.identities[:, 0])


def _whole(octaves: float) -> int:
    return int(np.clip(np.rint(octaves), -MOST_BITS, MOST_BITS))


def _is_as_loud(noises: Mapping[int, float], board: int, bits: int) -> bool:
    """Whether the board's noise beside the others' is what a shift by so many bits makes of it."""
    noise = noises[board] / float(np.median([own for each, own in noises.items() if each != board]))  # NaN: not known
    return noise < LESS_NOISE if bits > 0 else noise > 1.0 / LESS_NOISE


def _factor(seen: ChamberObservation, known: NDArray[np.bool_]) -> float:
    """How many times as much as the static curves say a part of the insole reads."""
    expected = np.where(known, seen.expected_count, 0.0)
    return max(float(np.sum(expected * seen.activation_count) / max(float(np.sum(expected**2)), 1e-12)), 1e-6)


def _shares(seen: WrenchObservation) -> dict[int, float]:
    """By board, its share of the reference wrench over that by its static curves; least squares."""
    boards = _boards(seen)
    addresses = np.unique(boards).tolist()
    weights = 1.0 / np.sqrt(seen.weight_variance)  # 0 where the reference is not known
    columns = np.stack([seen.by_triangle[:, boards == each].sum(axis=1) for each in addresses], axis=-1)
    reference = seen.reference.smooth_at(seen.reference_s)
    columns = (columns * weights[..., None]).reshape(-1, len(addresses))
    shares, *_ = np.linalg.lstsq(columns, (reference * weights).reshape(-1), rcond=None)
    return {board: max(float(share), 1e-6) for board, share in zip(addresses, shares, strict=True)}


def _noises(seen: WrenchObservation, working: NDArray[np.bool_]) -> dict[int, float]:
    """By board, the noise of its readings in counts; NaN: too few of them are without load."""
    boards = _boards(seen)
    addresses = np.unique(boards[working.any(axis=1)]).tolist()
    if isinstance(seen, ChamberObservation) and seen.is_uniform:
        return {each: float(np.median(seen.noise_count[working & (boards == each)[:, None]])) for each in addresses}
    noises = {}
    for each in addresses:
        rows = np.flatnonzero(boards == each).tolist()
        own = np.concatenate([_noise_unloaded(seen, row, working[row]) for row in rows])
        noises[each] = float(np.median(own)) if len(own) else np.nan
    return noises


def _noise_unloaded(seen: WrenchObservation, row: int, working: NDArray[np.bool_]) -> Array:
    """(k,) noise in counts of a triangle's working taxels without load; none where too few readings are so."""
    own = seen.readings[row]
    column = row if seen.load_is_known else 0  # its own load, or the force on all
    load = seen.reference.smooth_at(seen.offset_s + (1.0 + seen.rate) * own.t_s)[:, column]
    is_unloaded = load < UNLOADED * float(np.nanmax(seen.reference.fine[:, column], initial=0.0))
    both = is_unloaded[1:] & is_unloaded[:-1]
    if both.sum() < LEAST_UNLOADED:
        return np.zeros(0)
    moved = np.abs(np.diff(own.counts[:, working], axis=0)[both])
    kept = moved <= np.quantile(moved, MOST_MOVED, axis=0)
    return np.asarray(np.sqrt(np.mean(moved**2, axis=0, where=kept) / 2.0))


def _as_shifted(foot: FootRecording, seen: Seen, board: int, bits: int) -> Seen:
    """With the baselines and curves of a board that shifts by `bits` more than it says; it keeps its no-load value."""
    rows = _boards(seen) == board
    calibration, times = seen.calibration, 2.0**bits
    powers = times ** np.arange(calibration.coefficients_pa.shape[-1])
    believed_pa: Array = calibration.coefficients_pa
    coefficients_pa = np.where(rows[:, None, None], believed_pa * powers, believed_pa)
    highest = calibration.highest_count
    if highest is not None:
        highest = np.where(rows[:, None], highest / times, highest)
    baseline: Array = calibration.baseline_count
    settings = _settings(foot, board)
    if settings.no_load is not None and settings.shift is not None:
        real = np.array(max(settings.shift + bits, 0))
        codes = codes_of(baseline, np.array(settings.no_load), np.array(settings.shift))
        baseline = np.where(rows[:, None], count_of(codes, np.array(settings.no_load), real), baseline)
    right = replace(calibration, coefficients_pa=coefficients_pa, highest_count=highest, baseline_count=baseline)
    moved = np.where(seen.usable, baseline - calibration.baseline_count, 0.0)
    return replace(seen, calibration=right, activation_count=seen.activation_count + moved)


def _settings(foot: FootRecording, address: int) -> RecordedBoard:
    return next(board for board in foot.boards if board.address == address)


def _finding(foot: FootRecording, seen: WrenchObservation, board: int, bits: int, explains: float) -> Finding:
    believed = _settings(foot, board).shift or 0
    where = Where("board", ((board,),))
    times = f"{2.0**-bits:g} times as large"
    text = f"the digitiser shifts by {believed + bits} bits instead of {believed}: activation is {times}"
    return Finding(
        effect="bit_shift", foot=seen.layout.foot, where=where, equation=laws()["bit_shift"].equation,
        recordings=(seen.name,), parameters={"shift": Quantity(believed + bits, 0.0, "1")}, explains=explains,
        confidence=0.95, sentence=f"{said(where)}: {text}.",
    )  # fmt: skip
