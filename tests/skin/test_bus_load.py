from __future__ import annotations

import pytest

from insole_daemon.errors import BusError
from insole_daemon.skin.bus_load import Stream, bus_load, check_fits


def load(n_triangles, period_ms, boards=6):
    return bus_load("can0", [Stream(address, n_triangles, period_ms) for address in range(5, 5 + boards)])


@pytest.mark.parametrize(("n", "period_ms", "least", "most"), [(16, 50, 43, 52), (16, 20, 107, 130)])
def test_bus_load_of_six_boards_with_all_triangles(n, period_ms, least, most):
    result = load(n, period_ms)
    assert (round(100 * result.least), round(100 * result.most)) == (least, most)


def test_both_insoles_fit_at_50_hz_with_the_triangles_they_have():
    result = bus_load("can0", [Stream(a, n, 20) for a, n in zip(range(5, 11), (12, 5, 11, 12, 5, 11), strict=True)])
    assert result.frames_per_s == 5600
    assert (round(100 * result.least), round(100 * result.most)) == (62, 76)
    check_fits(result)


def test_a_load_above_the_limit_is_refused_with_numbers_and_remedy():
    with pytest.raises(BusError) as refused:
        check_fits(load(16, 20))
    text = str(refused.value)
    for words in ("can0", "9600 frames/s", "107% to 130%", "at most 80%", "board 5: 16 triangles every 20 ms",
                  "at most 59 of 96 fit", "50 ms"):  # fmt: skip
        assert words in text
    check_fits(load(16, 50))
    check_fits(bus_load("can0", []))
