"""The signs of the frame of reference, and what a wrench leaves out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from insole_daemon.mechanics.wrench import Wrench, WrenchEstimator, WrenchSeries
from insole_daemon.skin.geometry import PRESSURE_TAXELS, TAXELS_MM
from insole_daemon.skin.layout import Foot, builtin

LEFT, RIGHT = builtin("left", (5, 6, 7)), builtin("right", (8, 9, 10))
N = len(LEFT)
AREA = LEFT.taxel_area_m2
VALID = np.tile(PRESSURE_TAXELS, (N, 1))


def estimator(min_force_n: float = 20.0, min_pressure_pa: float = 20_000.0) -> WrenchEstimator:
    return WrenchEstimator(LEFT, min_force_n, min_pressure_pa)


def point(row: int, taxel: int, force_n: float = 100.0) -> NDArray[np.float64]:
    """A pressure map of one taxel that bears `force_n`, NaN on the thermal pads as a static curve gives it."""
    pressure = np.where(VALID, 0.0, np.nan)
    pressure[row, taxel] = force_n / AREA
    return pressure


def nan_fields(wrench: Wrench) -> set[str]:
    return {name for name in Wrench._fields if np.isnan(getattr(wrench, name))}


@pytest.mark.parametrize(("row", "taxel"), [(0, 0), (3, 9), (11, 5), (14, 3), (27, 11)])
def test_a_point_load(row: int, taxel: int) -> None:
    x, y = LEFT.xy_m[row, taxel]
    wrench = estimator()(point(row, taxel), VALID, None)
    assert wrench.f_z_n == pytest.approx(100.0)
    assert wrench.m_x_nm == pytest.approx(100.0 * y)
    assert wrench.m_y_nm == pytest.approx(-100.0 * x)
    assert (wrench.cop_x_m, wrench.cop_y_m) == pytest.approx((x, y))
    assert wrench.contact_area_m2 == pytest.approx(AREA)
    assert wrench.valid_fraction == 1.0


def test_moments_are_those_of_r_cross_f() -> None:
    pressure = np.where(VALID, np.random.default_rng(0).uniform(0, 3e5, VALID.shape), np.nan)
    wrench = estimator()(pressure, VALID, None)
    r = np.concatenate([LEFT.xy_m[VALID], np.zeros((VALID.sum(), 1))], axis=1)
    f = np.zeros_like(r)
    f[:, 2] = pressure[VALID] * AREA
    m = np.cross(r, f).sum(axis=0)
    assert (wrench.m_x_nm, wrench.m_y_nm) == pytest.approx((m[0], m[1]))
    assert m[2] == 0


@pytest.mark.parametrize("foot", ["left", "right"])
def test_directions_a_person_can_check(foot: Foot) -> None:
    """x is forward, y to the wearer's left on both feet: the big toe is at y < 0 of the left, y > 0 of the right."""
    layout = LEFT if foot == "left" else RIGHT
    inwards = -1.0 if foot == "left" else 1.0
    estimate = WrenchEstimator(layout, 20.0, 20_000.0)
    toe = int(np.argmax(layout.xy_m[:, 3, 0] + inwards * layout.xy_m[:, 3, 1]))
    heel = int(np.argmin(layout.xy_m[:, 3, 0]))
    on_toe, on_heel = (estimate(point(row, 3), VALID, None) for row in (toe, heel))
    assert on_toe.f_z_n > 0
    assert on_toe.cop_x_m > 0.18 > 0.06 > on_heel.cop_x_m > 0
    assert on_toe.cop_y_m * inwards > 0
    assert on_toe.m_x_nm * inwards > 0, "the ground pushes the inner side up: about +x on the right foot"
    assert on_toe.m_y_nm < on_heel.m_y_nm < 0, "a load in front turns the toes up, which is about −y"


def test_two_loads_have_their_cop_between_them() -> None:
    pressure = point(0, 0, 300.0)
    pressure[20, 4] = 100.0 / AREA
    wrench = estimator()(pressure, VALID, None)
    expected = 0.75 * LEFT.xy_m[0, 0] + 0.25 * LEFT.xy_m[20, 4]
    assert (wrench.cop_x_m, wrench.cop_y_m) == pytest.approx(tuple(expected))
    assert wrench.f_z_n == pytest.approx(400.0)


def test_below_the_contact_force_there_is_no_cop() -> None:
    below, at = estimator()(point(0, 0, 19.999), VALID, None), estimator(20.0)(point(0, 0, 20.001), VALID, None)
    std = {"f_z_std_n", "m_x_std_nm", "m_y_std_nm"}
    assert nan_fields(below) == {"cop_x_m", "cop_y_m"} | std
    assert below.f_z_n == pytest.approx(19.999)
    assert nan_fields(at) == std


def test_a_pull_is_no_contact() -> None:
    wrench = estimator()(point(0, 0, -100.0), VALID, None)
    assert wrench.f_z_n == pytest.approx(-100.0)
    assert np.isnan([wrench.cop_x_m, wrench.cop_y_m]).all()
    assert wrench.contact_area_m2 == 0


def test_wrench_without_a_valid_taxel_is_unknown() -> None:
    wrench = estimator()(point(0, 0), np.zeros_like(VALID), np.ones(VALID.shape))
    assert nan_fields(wrench) == set(Wrench._fields) - {"contact_area_m2", "valid_fraction"}
    assert (wrench.contact_area_m2, wrench.valid_fraction) == (0.0, 0.0)


def test_invalid_taxels_count_nothing_whatever_they_read() -> None:
    pressure = point(0, 0)
    pressure[5], pressure[6, 0] = 1e7, np.nan
    valid = VALID.copy()
    valid[5], valid[6, 0] = False, False
    wrench = estimator()(pressure, valid, None)
    assert wrench.f_z_n == pytest.approx(100.0)
    assert (wrench.cop_x_m, wrench.cop_y_m) == pytest.approx(tuple(LEFT.xy_m[0, 0]))
    assert wrench.contact_area_m2 == pytest.approx(AREA)
    assert wrench.valid_fraction == pytest.approx((280 - 11) / 280)


def test_contact_area_counts_from_the_least_pressure_on() -> None:
    pressure = np.where(VALID, 19_999.0, np.nan)
    pressure[2, :4] = 20_000.0, 20_001.0, 1e6, -1e6
    assert estimator()(pressure, VALID, None).contact_area_m2 == pytest.approx(3 * AREA)


def test_contact_area_is_of_valid_taxels_also_from_0_pa_on() -> None:
    valid = VALID.copy()
    valid[5] = False
    wrench = estimator(min_pressure_pa=0.0)(point(0, 0), valid, None)
    assert wrench.contact_area_m2 == pytest.approx(270 * AREA)


def test_force_follows_the_area_the_layout_states() -> None:
    wide = WrenchEstimator(replace(LEFT, taxel_area_m2=2 * AREA), 20.0, 20_000.0)(point(0, 0), VALID, None)
    assert wide.f_z_n == pytest.approx(200.0)
    assert (wide.cop_x_m, wide.cop_y_m) == pytest.approx(tuple(LEFT.xy_m[0, 0]))


def test_standard_deviations_are_those_of_independent_taxels() -> None:
    rng = np.random.default_rng(1)
    mean = np.where(VALID, rng.uniform(0, 3e5, VALID.shape), np.nan)
    std_pa = np.where(VALID, rng.uniform(1e3, 2e4, VALID.shape), np.nan)
    estimate = estimator()
    wrench = estimate(mean, VALID, std_pa**2)
    drawn = [estimate(mean + std_pa * rng.standard_normal(VALID.shape), VALID, None) for _ in range(4000)]
    for name, std in (("f_z_n", "f_z_std_n"), ("m_x_nm", "m_x_std_nm"), ("m_y_nm", "m_y_std_nm")):
        assert getattr(wrench, std) == pytest.approx(np.std([getattr(of, name) for of in drawn]), rel=0.06)
    x, y = LEFT.xy_m[VALID].T
    assert wrench.f_z_std_n == pytest.approx(AREA * np.sqrt((std_pa[VALID] ** 2).sum()))
    assert wrench.m_x_std_nm == pytest.approx(AREA * np.sqrt((y**2 * std_pa[VALID] ** 2).sum()))
    assert wrench.m_y_std_nm == pytest.approx(AREA * np.sqrt((x**2 * std_pa[VALID] ** 2).sum()))


def test_a_taxel_without_a_stated_uncertainty_is_not_certain() -> None:
    """A calibration may give a covariance for some taxels only: the sum is then unknown, not small."""
    variance = np.where(VALID, 1e6, np.nan)
    variance[0, 0] = np.nan
    wrench = estimator()(point(3, 3), VALID, variance)
    assert np.isnan([wrench.f_z_std_n, wrench.m_x_std_nm, wrench.m_y_std_nm]).all()
    assert wrench.f_z_n == pytest.approx(100.0)
    valid = VALID.copy()
    valid[0, 0] = False
    assert estimator()(point(3, 3), valid, variance).f_z_std_n > 0


def test_taxel_3_is_where_the_triangle_is() -> None:
    assert TAXELS_MM[3].tolist() == [0.0, 0.0]
    centres = [(t.x_mm / 1000, t.y_mm / 1000) for t in LEFT.triangles]
    np.testing.assert_allclose(LEFT.xy_m[:, 3], centres)


def test_a_series_is_its_wrenches_one_by_one() -> None:
    rng = np.random.default_rng(5)
    pressure = np.where(VALID, rng.uniform(-2e4, 3e5, (40, *VALID.shape)), np.nan)
    valid = VALID & (rng.random(pressure.shape) < 0.7)
    valid[7] = False
    pressure[8] *= 1e-3
    for variance in (None, np.where(VALID, rng.uniform(0, 1e6, pressure.shape), np.nan)):
        series = estimator().series(pressure, valid, variance)
        assert len(series) == 40
        for row in range(40):
            one = estimator()(pressure[row], valid[row], None if variance is None else variance[row])
            for name in Wrench._fields:
                expected = pytest.approx(getattr(one, name), rel=1e-12, nan_ok=True)
                if row == 7 and name not in ("contact_area_m2", "valid_fraction"):
                    expected = pytest.approx(np.nan, nan_ok=True)
                assert getattr(series, name)[row] == expected, (row, name)
    assert len(WrenchSeries.concatenate([series, series])) == 80
    assert len(WrenchSeries.concatenate([])) == 0


def test_a_series_equals_its_cycles_at_every_limit() -> None:
    """Exactly the least force and pressure of contact; one valid taxel, all, none; with and without variance."""
    one = np.zeros_like(VALID)
    one[3, 4] = True
    all_but_one = VALID.copy()
    all_but_one[0, 0] = False
    limit_pa = 20_000.0
    cases = [
        (point(3, 4), VALID), (point(3, 4), one), (point(3, 4), np.zeros_like(VALID)), (point(3, 4), all_but_one),
        (point(3, 4, limit_pa * AREA), VALID), (point(5, 2, 20.0), VALID), (point(5, 2, 20.0), one),
    ]  # fmt: skip
    pressure, valid = np.stack([case[0] for case in cases]), np.stack([case[1] for case in cases])
    force_n = float(estimator()(point(3, 4, 20.0), VALID, None).f_z_n)
    for min_force_n in (force_n, 20.0, 0.0):
        calculated = estimator(min_force_n, limit_pa)
        for variance in (None, np.full(valid.shape, 4.0)):
            series = calculated.series(pressure, valid, variance)
            for at, (own, which) in enumerate(cases):
                single = calculated(own, which, None if variance is None else variance[at])
                for name in Wrench._fields:
                    expected = getattr(single, name)
                    assert getattr(series, name)[at] == pytest.approx(expected, rel=1e-12, nan_ok=True), (at, name)
    at_limit = estimator(0.0, limit_pa)(np.where(VALID, limit_pa, np.nan), VALID, None)
    assert at_limit.contact_area_m2 == pytest.approx(VALID.sum() * AREA), "the least pressure is contact"
    unloaded = estimator(0.0)(np.where(VALID, 0.0, np.nan), VALID, None)
    assert (unloaded.f_z_n, unloaded.contact_area_m2) == (0.0, 0.0)
    assert np.isnan(unloaded.cop_x_m), "no force has no centre, whatever the least force of contact is"
    whole = estimator().series(pressure[:1], valid[:1], None)
    assert np.isnan(whole.f_z_std_n[0]), "nothing is missing and nothing is known of the curve"
    assert np.isfinite(estimator().series(pressure[3:4], valid[3:4], None).f_z_std_n[0])
