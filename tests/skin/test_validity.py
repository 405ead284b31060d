"""Which readings may be believed, one reason after another."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.config import Board
from insole_daemon.skin.geometry import PRESSURE_TAXELS, THERMAL_PADS
from insole_daemon.skin.layout import builtin
from insole_daemon.skin.validity import Validity

MS = 1_000_000
STALE = 200 * MS
LAYOUT = builtin("left", (5, 6, 7))
N = len(LAYOUT)
FRONT = LAYOUT.rows[5, 0]
MIDDLE = LAYOUT.rows[6, 4]
REAR = LAYOUT.rows[7, 0]


def boards(no_load: int = 240, shift: int = 3) -> dict[int, Board]:
    """Three boards, of which the middle one has other settings."""
    usual = {address: Board(address=address, interface="can0") for address in (5, 7)}
    return usual | {6: Board(address=6, interface="can0", no_load=no_load, shift=shift)}


class Readings:
    """A cycle in which everything is well, to be spoilt."""

    def __init__(self) -> None:
        self.counts = np.full((N, 12), 200, np.uint8)
        self.status = np.zeros(N, np.uint16)
        self.age_ns = np.full(N, 5 * MS, np.int64)

    def invalid(self, boards: dict[int, Board] | None = None) -> list[tuple[int, int]]:
        """(row, taxel) of the pressure taxels that may not be believed; checks that thermal pads never may."""
        valid = Validity(LAYOUT, boards or globals()["boards"](), STALE)(self.counts, self.status, self.age_ns)
        assert valid.dtype == np.bool_
        assert not valid[:, list(THERMAL_PADS)].any()
        return [(row, taxel) for row, taxel in np.argwhere(~valid).tolist() if taxel not in THERMAL_PADS]


@pytest.fixture
def readings() -> Readings:
    return Readings()


def all_of(*rows: int) -> list[tuple[int, int]]:
    return [(row, taxel) for row in sorted(rows) for taxel in np.flatnonzero(PRESSURE_TAXELS).tolist()]


def test_a_fresh_reading_in_range_is_valid(readings: Readings) -> None:
    assert readings.invalid() == []


def test_never_received(readings: Readings) -> None:
    readings.age_ns[FRONT] = -1
    assert readings.invalid() == all_of(FRONT)


def test_stale_is_older_than_and_not_as_old_as(readings: Readings) -> None:
    readings.age_ns[[FRONT, REAR]] = STALE, STALE + 1
    assert readings.invalid() == all_of(REAR)


@pytest.mark.parametrize("code", [1, 2, 3, 4, 8, 15])
def test_a_triangle_that_reports_an_error(readings: Readings, code: int) -> None:
    readings.status[MIDDLE] = code
    assert readings.invalid() == all_of(MIDDLE)


@pytest.mark.parametrize("taxel", np.flatnonzero(PRESSURE_TAXELS).tolist())
def test_a_taxel_flagged_out_of_range(readings: Readings, taxel: int) -> None:
    readings.status[FRONT] = 1 << 4 + taxel
    assert readings.invalid() == [(FRONT, taxel)]


@pytest.mark.parametrize("pad", THERMAL_PADS)
def test_flag_of_a_thermal_pad_affects_no_other_taxel(readings: Readings, pad: int) -> None:
    readings.status[FRONT] = 1 << 4 + pad
    assert readings.invalid() == []


def test_clamped_counts(readings: Readings) -> None:
    readings.counts[FRONT, :5] = 0, 1, 254, 255, 200
    assert readings.invalid() == [(FRONT, 0), (FRONT, 3)]


def test_an_open_triangle_is_invalid_by_its_counts_alone(readings: Readings) -> None:
    readings.counts[FRONT] = (0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 0, 0)
    readings.counts[REAR] = (255,) * 9 + (0, 255, 255)
    assert readings.invalid() == all_of(FRONT, REAR)


def test_a_no_load_of_255_is_that_at_rest_with_its_flags_set(readings: Readings) -> None:
    readings.counts[MIDDLE] = 255
    readings.status[MIDDLE] = 0xFFF0
    assert readings.invalid(boards(no_load=255)) == []
    assert readings.invalid(boards(no_load=254)) == all_of(MIDDLE)


def test_a_no_load_of_255_leaves_the_other_rules(readings: Readings) -> None:
    readings.counts[MIDDLE, :4] = 255, 254, 0, 254
    readings.status[MIDDLE] = 1 << 4 | 1 << 5
    readings.counts[FRONT, 0] = 255
    assert readings.invalid(boards(no_load=255)) == sorted([(FRONT, 0), (MIDDLE, 1), (MIDDLE, 2)])
    readings.status[MIDDLE] |= 2
    assert readings.invalid(boards(no_load=255)) == sorted([(FRONT, 0), *all_of(MIDDLE)])


def test_flags_mean_nothing_at_shift_7(readings: Readings) -> None:
    readings.status[[MIDDLE, REAR]] = 0xFFF0
    assert readings.invalid(boards(shift=7)) == all_of(REAR)
    assert readings.invalid(boards(shift=6)) == all_of(MIDDLE, REAR)
    readings.status[MIDDLE] |= 1
    assert readings.invalid(boards(shift=7)) == all_of(MIDDLE, REAR)


def test_many_cycles_at_once(readings: Readings) -> None:
    """Any number of leading axes gives what each cycle gives alone."""
    rng = np.random.default_rng(0)
    counts = rng.choice(np.array([0, 1, 200, 254, 255], np.uint8), (6, N, 12))
    status = np.where(rng.random((6, N)) < 0.5, 0, rng.integers(0, 1 << 16, (6, N))).astype(np.uint16)
    age_ns = rng.choice(np.array([-1, 0, STALE, STALE + 1], np.int64), (6, N))
    status[3] = 0
    validity = Validity(LAYOUT, boards(no_load=255, shift=7), STALE)
    one_by_one = [validity(*of) for of in zip(counts, status, age_ns, strict=True)]
    np.testing.assert_array_equal(validity(counts, status, age_ns), one_by_one)
