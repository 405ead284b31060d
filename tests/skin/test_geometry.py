from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.skin.geometry import (
    CELL_SIDE_MM,
    NEIGHBOUR_MM,
    OUTLINE_MM,
    PRESSURE_TAXELS,
    TAXELS_MM,
    THERMAL_PADS,
    taxel_positions,
)


def test_ten_pressure_taxels_and_two_thermal_pads() -> None:
    assert THERMAL_PADS == (6, 10)
    assert PRESSURE_TAXELS.sum() == 10
    assert not PRESSURE_TAXELS[[6, 10]].any()


def test_pressure_taxels_are_a_lattice_of_one_pitch_around_taxel_3() -> None:
    pressure = TAXELS_MM[PRESSURE_TAXELS]
    np.testing.assert_allclose(pressure.mean(axis=0), TAXELS_MM[3], atol=1e-3)
    distance = np.linalg.norm(pressure[:, None] - pressure, axis=-1)
    assert distance[distance > 0].min() == pytest.approx(6.533, abs=0.01)
    nearest = np.sort(distance, axis=1)[:, 1]
    np.testing.assert_allclose(nearest, 6.533, atol=0.01)


def test_thermal_pads_lie_between_pressure_taxels_within_the_outline() -> None:
    assert TAXELS_MM[list(THERMAL_PADS)].tolist() == [[-6.510, -3.750], [0.0, 7.532]]
    assert np.ptp(OUTLINE_MM, axis=0) == pytest.approx([27.94, 24.257])  # 27.9 × 24.3 mm


def test_cells_of_the_tiling() -> None:
    side, area_mm2 = CELL_SIDE_MM, 3**0.5 / 4 * CELL_SIDE_MM**2
    assert side == pytest.approx(33.46, abs=0.01)
    assert area_mm2 == pytest.approx(485, abs=1)
    assert abs(CELL_SIDE_MM / 3**0.5 - NEIGHBOUR_MM) < 1e-9


def test_unplaced_triangles_are_the_table_in_metres() -> None:
    xy_m = taxel_positions([(0, 0)], [0], [False])
    assert xy_m.shape == (1, 12, 2)
    assert xy_m.dtype == np.float64
    np.testing.assert_allclose(xy_m[0], TAXELS_MM * 1e-3)


def test_rotation_is_counter_clockwise() -> None:
    xy_m = taxel_positions([(100, 0)], [90], [False])
    np.testing.assert_allclose(xy_m[0, 0], [0.100, 0.006533], atol=1e-12)  # +x turns to +y
    np.testing.assert_allclose(xy_m[0, 9], [0.100 - 0.011317, 0.0], atol=1e-12)  # the tip, +y, turns to −x


def test_mirroring_flips_x_before_rotating() -> None:
    xy_m = taxel_positions([(0, 0), (0, 0)], [0, 90], [True, True])
    np.testing.assert_allclose(xy_m[0], TAXELS_MM * [-1e-3, 1e-3], atol=1e-12)
    np.testing.assert_allclose(xy_m[1, 0], [0, -0.006533], atol=1e-12)


def test_handedness_is_that_of_the_position_files_unless_mirrored() -> None:
    plain, mirrored = taxel_positions([(10, 20)] * 2, [33, 33], [False, True]) - [0.010, 0.020]

    def turn(triangle: np.ndarray) -> float:
        return float(triangle[9, 0] * triangle[1, 1] - triangle[9, 1] * triangle[1, 0])

    assert turn(plain) < 0 < turn(mirrored)
