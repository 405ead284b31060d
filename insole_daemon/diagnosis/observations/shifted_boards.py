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
from ..places import place_in_words
from .chamber import ChamberObservation
from .wrench import WrenchObservation

LEAST_BOARDS = 3  # with two, the wrong one is unknown
MOST_BITS = 2
MOST_OFF_BITS = 0.15  # of the ratio's binary logarithm from an integer
MOST_NOISE_RATIO = 0.8  # to the other boards, of a board whose readings are half as large; rounding keeps some noise
LEAST_EXPLAINED = 0.5  # of the mean square error of a walk's wrench
UNLOADED = 0.02  # of the reference's range of f_z
LEAST_UNLOADED = 50  # pairs of successive unloaded readings: fewer do not determine the noise
MOST_MOVED = 0.98  # quantile of differences between unloaded readings that is still noise

Observation = TypeVar("Observation", bound=WrenchObservation)


def correct_bit_shifts(
    foot: FootRecording, seen: WrenchObservation, working: NDArray[np.bool_]
) -> tuple[WrenchObservation, list[Finding]]:
    """Return `seen` with the curves of such boards corrected, and a finding for each; from `working` taxels (T, 12)."""
    if seen.has_own_curves or len(np.unique(_boards(seen)[working.any(axis=1)])) < LEAST_BOARDS:
        return seen, []
    if isinstance(seen, ChamberObservation):
        return _correct_under_known_load(foot, seen, working)
    return _correct_on_walk(foot, seen, working)


def _correct_under_known_load(
    foot: FootRecording, seen: ChamberObservation, working: NDArray[np.bool_]
) -> tuple[ChamberObservation, list[Finding]]:
    known = working & ~seen.cut_off & np.isfinite(seen.weight_variance)[..., None]
    noises = _noise_of_boards(seen, working)
    factors = {board: _factor(seen, known & (_boards(seen) == board)[:, None]) for board in noises}
    usual = float(np.median(list(factors.values())))
    findings: list[Finding] = []
    for board, factor in factors.items():
        octaves = float(np.log2(usual / factor))
        bits = _whole_bits(octaves)
        if bits == 0 or abs(octaves - bits) > MOST_OFF_BITS or not _has_noise_of_shift(noises, board, bits):
            continue
        before = np.mean((seen.activation_count - seen.expected_count) ** 2, where=known)
        seen = _with_shift(foot, seen, board, bits)
        after = np.mean((seen.activation_count - seen.expected_count) ** 2, where=known)
        findings.append(_finding(foot, seen, board, bits, max(float(before - after), 0.0)))
    settled = {("bit_shift", "board")} if np.isfinite(list(noises.values())).all() else set()
    octaves = -float(np.log2(np.median(list(factors.values()))))
    if np.rint(octaves) == 0.0 or abs(octaves - np.rint(octaves)) > MOST_OFF_BITS:
        settled |= {("bit_shift", "insole")}
    return replace(seen, settled=seen.settled | settled), findings


def _correct_on_walk(
    foot: FootRecording, seen: WrenchObservation, working: NDArray[np.bool_]
) -> tuple[WrenchObservation, list[Finding]]:
    noises = _noise_of_boards(seen, working)
    findings: list[Finding] = []
    for board in noises:
        # The scale of a board as it was read does not tell the bits: its count without load is another, too.
        possible = [
            (float(corrected.mean_square_error[0]), bits, corrected)
            for bits in range(-MOST_BITS, MOST_BITS + 1)
            if bits != 0 and _has_noise_of_shift(noises, board, bits)
            for corrected in [_with_shift(foot, seen, board, bits)]
        ]
        if not possible:
            continue
        before = float(seen.mean_square_error[0])
        after, bits, corrected = min(possible, key=lambda one: one[0])
        is_exact = abs(np.log2(_scales_of_boards(corrected)[board])) < MOST_OFF_BITS
        if after < (1.0 - LEAST_EXPLAINED) * before and is_exact:
            saturated = corrected.saturated & (_boards(corrected) == board)
            seen = replace(corrected, missing=corrected.missing | saturated) if bits < 0 else corrected
            findings.append(_finding(foot, seen, board, bits, before - after))
    return seen, findings


def _boards(seen: WrenchObservation) -> NDArray[np.int64]:
    return np.asarray(seen.layout.identities[:, 0])


def _whole_bits(bits: float) -> int:
    return int(np.clip(np.rint(bits), -MOST_BITS, MOST_BITS))


def _has_noise_of_shift(noises: Mapping[int, float], board: int, bits: int) -> bool:
    """Return whether the board's noise, relative to the others', is that of a shift by `bits`."""
    noise = noises[board] / float(
        np.median([other_noise for other, other_noise in noises.items() if other != board])
    )  # NaN: unknown
    return noise < MOST_NOISE_RATIO if bits > 0 else noise > 1.0 / MOST_NOISE_RATIO


def _factor(seen: ChamberObservation, known: NDArray[np.bool_]) -> float:
    """Return the slope of the regression of readings on the activation expected by the static curves.

    With an intercept: another shift also changes the count without load.
    """
    expected, activation = seen.expected_count[known], seen.activation_count[known]
    if not expected.size:
        return 1e-6
    expected = expected - expected.mean()
    return max(float(expected @ activation) / max(float(expected @ expected), 1e-12), 1e-6)


def _scales_of_boards(seen: WrenchObservation) -> dict[int, float]:
    """Return by board the factor on its wrench that fits the reference wrench best; least squares of all boards."""
    boards = _boards(seen)
    addresses = np.unique(boards).tolist()
    weights = 1.0 / np.sqrt(seen.weight_variance)  # 0 where the reference is not known
    columns = np.stack([seen.by_triangle[:, boards == address].sum(axis=1) for address in addresses], axis=-1)
    reference = seen.reference.smooth_at(seen.reference_s)
    columns = (columns * weights[..., None]).reshape(-1, len(addresses))
    scales, *_ = np.linalg.lstsq(columns, (reference * weights).reshape(-1), rcond=None)
    return {board: max(float(scale), 1e-6) for board, scale in zip(addresses, scales, strict=True)}


def _noise_of_boards(seen: WrenchObservation, working: NDArray[np.bool_]) -> dict[int, float]:
    """Return by board the noise of its readings in counts; NaN if too few of them are unloaded."""
    boards = _boards(seen)
    addresses = np.unique(boards[working.any(axis=1)]).tolist()
    if isinstance(seen, ChamberObservation) and seen.is_uniform:
        return {
            address: float(np.median(seen.noise_count[working & (boards == address)[:, None]])) for address in addresses
        }
    noises = {}
    for address in addresses:
        rows = np.flatnonzero(boards == address).tolist()
        noise = np.concatenate([_noise_unloaded(seen, row, working[row]) for row in rows])
        noises[address] = float(np.median(noise)) if len(noise) else np.nan
    return noises


def _noise_unloaded(seen: WrenchObservation, row: int, working: NDArray[np.bool_]) -> Array:
    """Return the noise of a triangle's working taxels without load (k,), counts; empty with too few such readings."""
    readings = seen.readings[row]
    column = row if seen.load_is_known else 0  # the triangle's load, or the vertical force of the insole
    load = seen.reference.smooth_at(seen.offset_s + (1.0 + seen.rate) * readings.t_s)[:, column]
    is_unloaded = load < UNLOADED * float(np.nanmax(seen.reference.fine[:, column], initial=0.0))
    is_pair = is_unloaded[1:] & is_unloaded[:-1]
    if is_pair.sum() < LEAST_UNLOADED:
        return np.zeros(0)
    difference = np.abs(np.diff(readings.counts[:, working], axis=0)[is_pair])
    is_noise = difference <= np.quantile(difference, MOST_MOVED, axis=0)
    return np.asarray(np.sqrt(np.mean(difference**2, axis=0, where=is_noise) / 2.0))


def _with_shift(foot: FootRecording, seen: Observation, board: int, bits: int) -> Observation:
    """Return `seen` with baselines and curves of a board that shifts by `bits` more than configured.

    The board keeps its no-load count.
    """
    rows = _boards(seen) == board
    calibration, factor = seen.calibration, 2.0**bits
    powers = factor ** np.arange(calibration.coefficients_pa.shape[-1])
    believed_pa: Array = calibration.coefficients_pa
    coefficients_pa = np.where(rows[:, None, None], believed_pa * powers, believed_pa)
    highest = calibration.highest_count
    if highest is not None:
        highest = np.where(rows[:, None], highest / factor, highest)
    baseline: Array = calibration.baseline_count
    settings = _board_settings(foot, board)
    if settings.no_load is not None and settings.shift is not None:
        true_shift = np.array(max(settings.shift + bits, 0))
        codes = codes_of(baseline, np.array(settings.no_load), np.array(settings.shift))
        baseline = np.where(rows[:, None], count_of(codes, np.array(settings.no_load), true_shift), baseline)
    corrected = replace(calibration, coefficients_pa=coefficients_pa, highest_count=highest, baseline_count=baseline)
    baseline_change = np.where(seen.usable, baseline - calibration.baseline_count, 0.0)
    return replace(seen, calibration=corrected, activation_count=seen.activation_count + baseline_change)


def _board_settings(foot: FootRecording, address: int) -> RecordedBoard:
    return next(board for board in foot.boards if board.address == address)


def _finding(foot: FootRecording, seen: WrenchObservation, board: int, bits: int, explains: float) -> Finding:
    believed = _board_settings(foot, board).shift or 0
    where = Where("board", ((board,),))
    times = f"{2.0**-bits:g} times as large"
    text = f"the digitiser shifts by {believed + bits} bits instead of {believed}: activation is {times}"
    return Finding(
        effect="bit_shift", foot=seen.layout.foot, where=where, equation=laws()["bit_shift"].equation,
        recordings=(seen.name,), parameters={"shift": Quantity(believed + bits, 0.0, "1")}, explains=explains,
        sentence=f"{place_in_words(where)}: {text}.",
    )  # fmt: skip
