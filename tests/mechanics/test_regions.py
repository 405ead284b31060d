"""Where one region of a sole ends and the next begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.mechanics.regions import ENDS, REGIONS, regions
from insole_daemon.skin.geometry import N_TAXELS, PRESSURE_TAXELS, THERMAL_PADS
from insole_daemon.skin.layout import Layout, builtin

LEFT = builtin("left", (5, 6, 7))
LENGTH_M = 0.25  # a power of two: the parts of it are as exact as those of 1
HEEL, MIDFOOT, FOREFOOT = range(3)


def sole(parts: list[float], rear_m: float = 0.0) -> Layout:
    """Two triangles whose pressure taxels lie at `parts` of the length, the first and the last at its ends."""
    x_m: NDArray[np.float64] = np.full((2, N_TAXELS), 0.5)
    x_m[0, 0], x_m[1, -1] = 0.0, 1.0
    x_m[1, : len(parts)] = parts
    xy_m = np.stack([rear_m + LENGTH_M * x_m, np.linspace(-1.0, 1.0, x_m.size).reshape(x_m.shape)], axis=-1)
    return replace(LEFT, triangles=LEFT.triangles[:2], xy_m=xy_m)


def test_the_regions_are_named_from_heel_to_toes() -> None:
    assert REGIONS == ("heel", "midfoot", "forefoot", "toes")


@pytest.mark.parametrize(("end", "region"), [*zip(ENDS, (HEEL, MIDFOOT, FOREFOOT), strict=True)])
def test_a_region_ends_at_its_part_of_the_length(end: float, region: int) -> None:
    result = regions(sole([end - 1e-6, end, end + 1e-6]))
    assert result[1, :3].tolist() == [region, region + 1, region + 1]
    assert [REGIONS[number] for number in (result[0, 0], result[1, -1])] == ["heel", "toes"]


def test_hindfoot_and_midfoot_are_the_customary_masks_from_the_toes() -> None:
    assert ENDS[:2] == pytest.approx((1 - 0.73, 1 - 0.45))


@pytest.mark.parametrize("rear_m", [-1.0, 0.125])
def test_lengths_are_from_the_rearmost_taxel(rear_m: float) -> None:
    parts = [0.0, 0.26, 0.28, 0.54, 0.56, 0.79]
    assert regions(sole(parts, rear_m))[1, :6].tolist() == [HEEL, HEEL, MIDFOOT, MIDFOOT, FOREFOOT, FOREFOOT]


@pytest.mark.parametrize("part", [-2.0, 3.0])
def test_thermal_pads_are_of_no_region_and_do_not_count_for_the_length(part: float) -> None:
    layout = sole([0.26, 0.28])
    layout.xy_m[:, THERMAL_PADS, 0] = LENGTH_M * part
    result = regions(layout)
    assert result[1, :2].tolist() == [HEEL, MIDFOOT]
    assert ((result == -1) == ~PRESSURE_TAXELS).all()
