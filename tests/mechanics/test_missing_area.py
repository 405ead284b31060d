"""What missing taxels may bear, against the words of the module taken literally."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.mechanics.wrench import WrenchEstimator
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
VALID = np.tile(PRESSURE_TAXELS, (len(LAYOUT), 1))
ESTIMATE = WrenchEstimator(LAYOUT, 20.0, 20_000.0)


def literally(pressure: np.ndarray, valid: np.ndarray) -> list[float]:
    places = [(row, taxel) for row, taxel in np.argwhere(VALID).tolist()]
    sums = [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]
    for row, taxel in places:
        if valid[row, taxel]:
            continue
        x, y = LAYOUT.xy_m[row, taxel]
        others = sorted(
            (place for place in places if place != (row, taxel)),
            key=lambda place: np.hypot(*(LAYOUT.xy_m[place] - (x, y))),
        )[:24]
        near = [pressure[place] for place in others if valid[place]]
        most = max(near) if near else pressure[valid].max()
        for of, arm in zip(sums, (1.0, y, -x), strict=True):
            of[int(arm < 0)] += LAYOUT.taxel_area_m2 * abs(arm) * max(most, 0.0)
    return [max(of) for of in sums]


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 20))
def test_the_uncertainty_equals_the_formula_of_the_docstring(seed: int, n_missing: int) -> None:
    rng = np.random.default_rng(seed)
    pressure = np.where(VALID, rng.uniform(-1e4, 3e5, VALID.shape), np.nan)
    valid = VALID.copy()
    valid[rng.choice(len(LAYOUT), n_missing, replace=False)] = False
    valid &= rng.random(valid.shape) < 0.95
    wrench = ESTIMATE(pressure, valid, None)
    # Taxels at the same distance may stand in any order, so that the 24th is one or another.
    assert (wrench.f_z_std_n, wrench.m_x_std_nm, wrench.m_y_std_nm) == pytest.approx(
        literally(pressure, valid), rel=0.05
    )


def test_nothing_missing_adds_nothing() -> None:
    pressure, variance = np.where(VALID, 1e5, np.nan), np.where(VALID, 1e6, np.nan)
    assert np.isnan(ESTIMATE(pressure, VALID, None).f_z_std_n)
    whole = ESTIMATE(pressure, VALID, variance).f_z_std_n
    valid = VALID.copy()
    valid[0, 0] = False
    part = ESTIMATE(pressure, valid, variance).f_z_std_n
    assert part**2 == pytest.approx(whole**2 * 279 / 280 + (1e5 * LAYOUT.taxel_area_m2) ** 2)


def test_even_pressure_is_missed_by_no_more_than_is_stated() -> None:
    pressure = np.where(VALID, 1e5, np.nan)
    for row in range(len(LAYOUT)):
        valid = VALID.copy()
        valid[row] = False
        wrench, whole = ESTIMATE(pressure, valid, None), ESTIMATE(pressure, VALID, None)
        assert whole.f_z_n - wrench.f_z_n == pytest.approx(wrench.f_z_std_n)
        assert abs(whole.m_x_nm - wrench.m_x_nm) <= wrench.m_x_std_nm * (1 + 1e-9)
        assert abs(whole.m_y_nm - wrench.m_y_nm) <= wrench.m_y_std_nm * (1 + 1e-9)


def test_what_is_kept_of_a_cycle_serves_only_cycles_with_the_same_taxels_missing() -> None:
    rng = np.random.default_rng(1)
    some, others = VALID.copy(), VALID.copy()
    some[3], others[11] = False, False
    for valid in (some, some, others, some, others):
        pressure = np.where(VALID, rng.uniform(0, 3e5, VALID.shape), np.nan)
        fresh = WrenchEstimator(LAYOUT, 20.0, 20_000.0)
        assert ESTIMATE(pressure, valid, None) == fresh(pressure, valid, None)
