"""Boards whose digitiser shifts by another number of bits than believed, told from their readings.

Under a load that is the same everywhere, boards differ by a factor alone, whatever memory or clock they go through. A
power of two, with as much less or more noise, is a shift: no sensor is off by just that.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.effects import laws
from ...physics.law import Array
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


def with_shifts(
    foot: FootRecording, seen: WrenchObservation, working: NDArray[np.bool_]
) -> tuple[WrenchObservation, list[Finding]]:
    """`seen` with the curves of such boards as for their real shift, and what is said of them.

    Of the `working` taxels (T, 12).
    """
    if not isinstance(seen, ChamberObservation) or not seen.is_uniform or seen.has_own_curves:
        return seen, []
    boards = seen.layout.identities[:, 0]
    known = working & ~seen.cut_off & np.isfinite(seen.weight_variance)[..., None]
    addresses = np.unique(boards[working.any(axis=1)]).tolist()
    factors = {each: _factor(seen, known & (boards == each)[:, None]) for each in addresses}
    noises = {each: float(np.median(seen.noise_count[working & (boards == each)[:, None]])) for each in addresses}
    findings: list[Finding] = []
    if len(addresses) < LEAST_BOARDS:
        return seen, []
    for board in addresses:
        others = [each for each in addresses if each != board]
        octaves = np.log2(np.median([factors[each] for each in others]) / factors[board])
        bits = int(np.clip(np.rint(octaves), -MOST_BITS, MOST_BITS))
        noise = noises[board] / float(np.median([noises[each] for each in others]))
        as_loud = noise < LESS_NOISE if bits > 0 else noise > 1.0 / LESS_NOISE
        if bits == 0 or abs(octaves - bits) > NEAR or not as_loud:
            continue
        before = np.mean((seen.activation_count - seen.expected_count) ** 2, where=known)
        seen = _as_shifted(seen, boards == board, bits)
        after = np.mean((seen.activation_count - seen.expected_count) ** 2, where=known)
        believed = next(each.shift for each in foot.boards if each.address == board)
        findings.append(_finding(seen, board, believed or 0, bits, max(float(before - after), 0.0)))
    told = {("bit_shift", "board")}
    octaves = -float(np.log2(np.median([factors[each] for each in addresses])))
    if np.rint(octaves) == 0.0 or abs(octaves - np.rint(octaves)) > ALL_NEAR:
        told |= {("bit_shift", "insole")}
    return replace(seen, told=seen.told | told), findings


def _factor(seen: ChamberObservation, known: NDArray[np.bool_]) -> float:
    """How many times as much as the static curves say a part of the insole reads."""
    expected = np.where(known, seen.expected_count, 0.0)
    return max(float(np.sum(expected * seen.activation_count) / max(float(np.sum(expected**2)), 1e-12)), 1e-6)


def _as_shifted(seen: ChamberObservation, rows: NDArray[np.bool_], bits: int) -> ChamberObservation:
    """With curves that take an activation 2^bits times as large."""
    calibration, times = seen.calibration, 2.0**bits
    powers = times ** np.arange(calibration.coefficients_pa.shape[-1])
    believed_pa: Array = calibration.coefficients_pa
    coefficients_pa = np.where(rows[:, None, None], believed_pa * powers, believed_pa)
    highest = calibration.highest_count
    if highest is not None:
        highest = np.where(rows[:, None], highest / times, highest)
    return replace(seen, calibration=replace(calibration, coefficients_pa=coefficients_pa, highest_count=highest))


def _finding(seen: ChamberObservation, board: int, believed: int, bits: int, explains: float) -> Finding:
    where = Where("board", ((board,),))
    times = f"{2.0**-bits:g} times as large"
    text = f"the digitiser shifts by {believed + bits} bits instead of {believed}: activation is {times}"
    return Finding(
        effect="bit_shift", foot=seen.layout.foot, where=where, equation=laws()["bit_shift"].equation,
        recordings=(seen.name,), parameters={"shift": Quantity(believed + bits, 0.0, "1")}, explains=explains,
        confidence=0.95, sentence=f"{said(where)}: {text}.",
    )  # fmt: skip
