"""The digitiser, bit for bit, against tables made from the firmware's rules as they stand in words.

    value = raw16 − baseline16 − drift; byte = clamp(no_load − floor(value / 2^shift), 0, 255), with the exact rules
    255 if value ≤ −((255 − no_load) << shift), 0 if value ≥ no_load << shift;
    out of range if value ≤ −2·((255 − no_load) << shift) or value ≥ 2·(no_load << shift)

The tables are made with Python's whole numbers and fractions; nothing of the digitiser is used for them.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from insole_daemon.physics.digitiser import (
    GAINS_TYPE_0,
    GAINS_TYPE_8,
    clamp_counts,
    codes_of,
    compensation_codes,
    count_of,
    digitise,
    low_bytes,
)

SHIFTS = range(8)
NO_LOADS = range(235, 256)


def byte_by_rule(value: int, no_load: int, shift: int) -> int:
    if value <= -((255 - no_load) * 2**shift):
        return 255
    if value >= no_load * 2**shift:
        return 0
    return min(255, max(0, no_load - math.floor(Fraction(value, 2**shift))))


def flag_by_rule(value: int, no_load: int, shift: int) -> bool:
    return value <= -2 * (255 - no_load) * 2**shift or value >= 2 * no_load * 2**shift


def interesting(no_load: int, shift: int) -> list[int]:
    """Return values at and next to every threshold: steps, limits, flags, the ends of 16 bits; and random ones."""
    step = 2**shift
    edges = [0, step, 5 * step, (no_load - 1) * step, no_load * step, 2 * no_load * step]
    edges += [-step, -(255 - no_load) * step, -(254 - no_load) * step, -2 * (255 - no_load) * step, -65535, 65535]
    luck = np.random.default_rng([no_load, shift]).integers(-no_load * step, 2 * no_load * step, 40).tolist()
    values = {edge + beside for edge in edges for beside in (-1, 0, 1)} | set(luck)
    return sorted(value for value in values if -65535 <= value <= 65535)


def words(values: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return raw words and baselines (n, 12) with the differences `values`, equal for all twelve taxels."""
    raw = np.array([max(value, 0) for value in values], np.int64)
    baseline = raw - np.array(values)
    return np.repeat(raw[:, None], 12, axis=1), np.repeat(baseline[:, None], 12, axis=1)


@pytest.mark.parametrize("shift", SHIFTS)
def test_counts_equal_the_firmware_table_for_every_no_load(shift: int) -> None:
    for no_load in NO_LOADS:
        values = interesting(no_load, shift)
        raw, baseline = words(values)
        counts, status = digitise(raw, baseline, no_load, np.array([[shift]]))
        expected = np.array([byte_by_rule(value, no_load, shift) for value in values])
        flags = np.array([0xFFF0 if flag_by_rule(value, no_load, shift) else 0 for value in values])
        np.testing.assert_array_equal(counts, np.repeat(expected[:, None], 12, axis=1), f"no_load {no_load}")
        np.testing.assert_array_equal(status & 0xFFF0, flags, f"no_load {no_load}")
        np.testing.assert_array_equal(clamp_counts(np.array(values), no_load, np.array(shift)), expected)


@pytest.mark.parametrize("shift", SHIFTS)
def test_an_mtb3_equals_an_mtb4_within_16_bits(shift: int) -> None:
    for no_load in NO_LOADS:
        values = [value for value in interesting(no_load, shift) if -32768 <= value <= 32767]
        raw, baseline = words(values)
        counts, status = digitise(raw, baseline, no_load, np.array([[shift]]), is_16_bit=True)
        np.testing.assert_array_equal(counts[:, 5], [byte_by_rule(value, no_load, shift) for value in values])
        if shift < 7:  # where 2·(no_load << shift) no longer fits, its flags mean nothing
            flags = [0xFFF0 if flag_by_rule(value, no_load, shift) else 0 for value in values]
            np.testing.assert_array_equal(status & 0xFFF0, flags)


BY_HAND = [  # no_load, shift, value, byte, out of range
    (240, 3, 0, 240, False),
    (240, 3, 7, 240, False),
    (240, 3, 8, 239, False),
    (240, 3, -1, 241, False),  # a floor: −1/8 is −1
    (240, 3, -8, 241, False),
    (240, 3, -9, 242, False),
    (240, 3, 1919, 1, False),
    (240, 3, 1920, 0, False),
    (240, 3, -112, 254, False),
    (240, 3, -113, 255, False),
    (240, 3, -120, 255, False),
    (240, 3, 3839, 0, False),
    (240, 3, 3840, 0, True),
    (240, 3, -239, 255, False),
    (240, 3, -240, 255, True),
    (255, 3, 0, 255, True),  # no negative headroom: flagged at rest
    (255, 3, 1, 255, False),
    (255, 3, 8, 254, False),
    (255, 3, 2039, 1, False),
    (255, 3, 2040, 0, False),
    (245, 2, 979, 1, False),
    (245, 2, 980, 0, False),
    (245, 2, -36, 254, False),
    (245, 2, -37, 255, False),
    (235, 7, 30079, 1, False),
    (235, 7, 30080, 0, False),
    (235, 7, -2432, 254, False),
    (235, 7, -2433, 255, False),
    (245, 0, 244, 1, False),
    (245, 0, 245, 0, False),
    (245, 0, -9, 254, False),
    (245, 0, -10, 255, False),
    (245, 0, -20, 255, True),
]


@pytest.mark.parametrize(("no_load", "shift", "value", "byte", "out"), BY_HAND)
def test_counts_equal_hand_computed_values(no_load: int, shift: int, value: int, byte: int, out: bool) -> None:
    raw, baseline = words([value])
    counts, status = digitise(raw + 5, baseline + 5, no_load, np.array([[shift]]))
    assert counts.tolist() == [[byte] * 12]
    assert status.tolist() == [0xFFF0 if out else 0]
    assert byte_by_rule(value, no_load, shift) == byte


# ---- temperature, from pad 6: drift_k = ((|dT| >> 2) · gain_k) >> 5, with the sign of dT


@pytest.mark.parametrize("gains", [GAINS_TYPE_0, GAINS_TYPE_8])
def test_compensation_equals_the_firmware_arithmetic(gains: tuple[int, ...]) -> None:
    changes = [*range(-1200, 1201), -40000, 40000]
    baseline = np.full((len(changes), 12), 20_000, np.int64)
    raw = baseline.copy()
    raw[:, 6] += changes
    for k, gain in enumerate(gains):
        sizes = [Fraction(abs(change) // 4 * gain, 32) for change in changes]
        mtb4 = [math.floor(size if change > 0 else -size) for size, change in zip(sizes, changes, strict=True)]
        mtb3 = [math.floor(size) * (1 if change > 0 else -1) for size, change in zip(sizes, changes, strict=True)]
        np.testing.assert_array_equal(compensation_codes(raw, baseline, gains)[:, k], mtb4)
        fits = np.array([abs(change) // 4 * gain < 65536 for change in changes])
        np.testing.assert_array_equal(
            compensation_codes(raw, baseline, gains, is_16_bit=True)[fits, k], np.array(mtb3)[fits]
        )


def test_compensation_equals_hand_computed_values() -> None:
    baseline = np.full((1, 12), 1000, np.int64)
    raw = baseline.copy()
    raw[0, 6] = 1131  # dT 131: 32 · gain, then >> 5, is gain
    assert compensation_codes(raw, baseline, GAINS_TYPE_0).tolist() == [[70, 96, 83, 38, 38, 70, 0, 45, 77, 164, 0, 77]]
    raw[0, 6] = 995  # dT −5: 1 · gain / 32 is 5.125 for taxel 9: −6 on an MTB4, −5 on an MTB3
    assert compensation_codes(raw, baseline, GAINS_TYPE_0)[0, 9] == -6
    assert compensation_codes(raw, baseline, GAINS_TYPE_0, is_16_bit=True)[0, 9] == -5
    counts, _ = digitise(raw, baseline, 240, np.array([[0]]), GAINS_TYPE_0)
    assert counts[0, 9] == 240 - 6, "what is cold is taken off with its sign"
    assert counts[0, 6] == 245, "the pad itself is not compensated"


# ---- the error code, and raw test mode


def test_error_codes_and_flag_bits() -> None:
    baseline = np.full((4, 12), 30_000, np.int64)
    raw = baseline.copy()
    raw[0] = 0xFFFF  # every word: not connected
    raw[1, 3] = 0  # some channel reads 0, its baseline does not: no ack, and far out of range
    raw[2, 11] = 30_000 + 2 * 240 * 8
    baseline[3, 3] = raw[3, 3] = 0
    _, status = digitise(raw, baseline, 240, np.array([[3]]))
    assert status.tolist() == [0xFFF2, 1 << (4 + 3) | 1, 1 << (4 + 11), 0]


def test_low_bytes_of_raw_test_mode() -> None:
    counts, status = low_bytes(np.array([[0x1234] * 12]))
    assert counts.tolist() == [[0x34] * 12]
    assert status.tolist() == [0]


# ---- counts on average


@pytest.mark.parametrize("shift", SHIFTS)
def test_count_of_is_the_mean_of_the_counts(shift: int) -> None:
    settings = np.array(240), np.array(shift)
    step = 2**shift
    values = np.arange(8 * step, 11 * step)
    mean = clamp_counts(values, *settings).reshape(-1, step).mean()
    assert count_of(np.array(values.mean()), *settings) == pytest.approx(mean)
    assert codes_of(np.array(mean), *settings) == pytest.approx(values.mean())
