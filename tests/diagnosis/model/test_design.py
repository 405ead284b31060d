"""The regression on a wrench: inner products with the nuisance columns projected out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import insole_daemon
from insole_daemon.diagnosis.load_estimate import LoadEstimate
from insole_daemon.diagnosis.model.design import as_read, design
from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.model.regression import Timing
from insole_daemon.diagnosis.model.solve import solve_shares
from insole_daemon.diagnosis.model.wrench_nuisance import project
from insole_daemon.diagnosis.observations.reference_wrench import FINE_S
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.parameters import parameters_of
from insole_daemon.physics.effect import Where

from ..foot.shoe import write


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("walk") / "walk", seconds=20.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    return design(LoadEstimate(seen), seen.weight_variance**-0.5, np.zeros(len(seen.arms), bool))


def assert_projected(found, raw) -> None:
    """Asserts that the inner products of `found` are those of the columns `raw` (3N, p) after projection."""
    projected = project(found.base, raw.astype(float))
    expected, size = projected.T @ projected, np.linalg.norm(projected, axis=0)
    between = ~np.eye(len(size), dtype=bool)  # the diagonal is without the noise in the columns
    off = (found.gram - expected) / size / size[:, None]
    assert np.abs(off[between]).max() < 1e-3
    cross = projected.T @ found.target - found.product
    assert np.abs((found.cross - cross) / size / np.sqrt(found.total)).max() < 1e-4


def test_inner_products_are_those_of_projected_columns(whole):
    assert_projected(whole, whole.raw)


def test_inner_products_after_a_timing_are_those_of_the_moved_columns(whole):
    later = whole.retimed(Timing(delay_s=0.03, lag_s=0.02))
    raw = whole.raw.copy()
    raw[:, later.moved.numbers] = later.moved.raw
    assert not np.allclose(raw, whole.raw)
    assert_projected(later, raw)


def test_no_delay_explains_the_noise_of_the_reference(whole):
    """Between two rows the interpolation averages their noise."""
    seen = whole.load.observation
    grid_s = np.arange(len(seen.reference.fine)) * FINE_S
    row_s, noise = 2 * FINE_S, np.full(3, 1e6)  # beside which the load is nothing
    rows = noise * np.random.default_rng(1).standard_normal((int(grid_s[-1] / row_s) + 2, 3))
    fine = CubicSpline(np.arange(len(rows)) * row_s, rows)(grid_s)
    reference = replace(seen.reference, fine=fine, noise=noise, row_s=row_s)
    seen = replace(seen, reference=reference, offset_s=2.0 - seen.t_s[0], rate=0.0)  # from row to row
    noisy = replace(whole, load=LoadEstimate(seen), weights=(whole.weights > 0.0).astype(float), moved=None)
    totals = [noisy.retimed(Timing(delay_s)).total for delay_s in np.arange(5) * row_s / 4]
    assert np.array(totals) / np.median(totals) == pytest.approx(1.0, abs=0.03)


def test_noise_of_the_reference_does_not_decide_between_delay_and_lag(whole):
    """A short lag averages rows and a short delay does not, and the noise of readings is not independent of it."""
    seen, late_s = whole.load.observation, 0.004

    rng, clean, row_s = np.random.default_rng(1), seen.reference, seen.reference.row_s
    grid_s = np.arange(len(clean.fine)) * FINE_S
    more = []
    for _ in range(8):
        rows = 3.0 * clean.noise * rng.standard_normal((int(grid_s[-1] / row_s) + 2, 3))
        fine = clean.fine + CubicSpline(np.arange(len(rows)) * row_s, rows)(grid_s)
        noisy = replace(seen, reference=replace(clean, fine=fine, noise=np.sqrt(10.0) * clean.noise))
        loaded = replace(whole, load=LoadEstimate(noisy), moved=None)
        more.append(loaded.retimed(Timing(late_s)).total - loaded.retimed(Timing(0.0, late_s)).total)
    assert np.std(more) < 0.03 * whole.n_rows


def test_the_reference_is_interpolated_between_the_times_of_readings(tmp_path):
    """Readings of slow boards do not resolve a step, at any delay."""
    recording = insole_daemon.load(write(tmp_path / "walk", period_ms=50))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    course = 300.0 * np.sin(2 * np.pi * 7.0 * FINE_S * np.arange(len(seen.reference.fine)))
    reference = replace(seen.reference, fine=np.tile(course[:, None], 3), noise=np.full(3, 1.0))
    seen = replace(seen, reference=reference, t_s=seen.t_s + 0.02)  # rows between readings
    load, read_s = LoadEstimate(seen), seen.readings[0].t_s
    is_loaded = load.by_triangle[:, :, 0].sum(axis=1) > 100.0
    for delay_s in (0.0, 0.025):
        after = seen.timed(offset_s=seen.offset_s - delay_s)
        expected, _ = as_read(load, after, np.ones((len(seen.t_s), 1)))
        between = CubicSpline(read_s, reference.at(seen.offset_s + read_s - delay_s))(seen.t_s)
        assert np.abs(expected - between)[is_loaded].max() < 10.0
        assert np.abs(reference.at(after.reference_s) - between)[is_loaded].max() > 20.0


def test_a_set_with_another_setting_has_the_inner_products_of_the_new_column(whole):
    k = next(k for k, c in enumerate(whole.candidates) if "tau_s" in c.term.refine and len(c.columns) == 1)
    chosen = whole.subset([k, next(i for i, c in enumerate(whole.candidates) if c.word == "hysteresis")])
    setting = {**chosen.candidates[0].settings[0], "tau_s": 0.4}
    other = chosen.exchanged(0, setting)
    assert not np.allclose(other.raw, chosen.raw)
    assert_projected(other, other.raw)


def test_a_snap_beside_a_gain_has_thresholds(whole):
    """The gain is a companion of the snap and a term of the set at once."""
    chosen = [
        max((k for k, c in enumerate(whole.candidates) if (c.word, c.where) == (word, Where())), key=gain_of(whole))
        for word in ("snap", "gain")
    ]
    refined = refine(whole, tuple(chosen))
    snap = next(i for i, c in enumerate(refined.design.candidates) if c.word == "snap")
    parameters = parameters_of(refined, snap, None)
    assert set(parameters) == {"up_pa", "down_pa", "step_pa"}
    assert parameters["down_pa"].value < parameters["up_pa"].value


def gain_of(whole):
    """Return the function from the number of a candidate to its gain alone."""
    return lambda k: solve_shares(whole.subset([k]), whole.subset([k]).candidates)[1]
