"""Peak and mean pressure by region against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.mechanics.region_map import RegionMap
from insole_daemon.mechanics.region_pressure import region_pressures

REGIONS = RegionMap(("heel", "toes"), np.repeat(np.array([[0], [1]], np.int8), 12, axis=1), ("midfoot",))
UNKNOWN = pytest.approx(np.nan, nan_ok=True)


def test_peak_and_mean_are_of_the_valid_taxels_of_a_region():
    pressure_pa, valid = np.zeros((1, 2, 12), np.float32), np.zeros((1, 2, 12), np.bool_)
    pressure_pa[0, 0, :3], valid[0, 0, :2] = (1000, 3000, 9000), True  # the third is not valid
    pressure_pa[0, 1, :2], valid[0, 1, :2] = (-50, 5000), True
    pressures = region_pressures(pressure_pa, valid, REGIONS, ["heel", "midfoot", "toes"])
    assert {name: float(values[0]) for name, values in pressures.items()} == {
        ("", "peak"): 5000, ("", "mean"): 2237.5,
        ("heel", "peak"): 3000, ("heel", "mean"): 2000,
        ("midfoot", "peak"): UNKNOWN, ("midfoot", "mean"): UNKNOWN,
        ("toes", "peak"): 5000, ("toes", "mean"): 2475,
    }  # fmt: skip


def test_a_region_without_a_valid_taxel_is_unknown_in_that_cycle_only():
    pressure_pa = np.full((2, 2, 12), 100, np.float32)
    valid = np.ones((2, 2, 12), np.bool_)
    valid[1, 0] = False
    pressures = region_pressures(pressure_pa, valid, REGIONS, ["heel"])
    np.testing.assert_array_equal(pressures["heel", "peak"], [100, np.nan])
    np.testing.assert_array_equal(pressures["heel", "mean"], [100, np.nan])
    np.testing.assert_array_equal(pressures["", "mean"], [100, 100])
