"""Curves and memory planted in a simulated chamber are fitted, and inverted by the chain."""

from __future__ import annotations

import json

import numpy as np
import pytest

from insole_daemon.calibration import memory
from insole_daemon.calibration.memory import Memories
from insole_daemon.errors import CalibrationError
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics.calibration import Calibration
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import effect
from insole_daemon.recording.copies import write_calibration
from insole_daemon.simulation.conditions import ChamberCycles
from insole_daemon.simulation.scenarios.chamber import programme
from insole_daemon.skin import layout as layouts

TURNS = programme(300_000.0, (8_000.0, 40_000.0), ChamberCycles(cycles=1, hold_s=40.0))
T_S = np.arange(0.0, TURNS[-1, 0], 0.1)
LOAD_PA = np.interp(T_S, TURNS[:, 0], TURNS[:, 1])
LAYOUT = layouts.builtin("left", (5, 6, 7))
MEMORIES = Memories(r_pa=(20_000.0,), tau_s=(20.0,))
SLOTS = np.array([0, 5, 16, 40])
BASELINE = np.array([240.0, 238.5, 243.0, 236.0])
COEFFICIENTS = np.array([0.0, 6000.0, 20.0, 0.4])


def counts(*effects, noise=0.0, seed=0):
    """Return (n, m) counts of the slots, not rounded."""
    baseline = np.full((len(LAYOUT), 12), np.nan)
    baseline.ravel()[SLOTS] = BASELINE
    coefficients = np.where(np.isnan(baseline)[..., None], np.nan, COEFFICIENTS)
    true = Calibration("left", baseline, coefficients, None, ~np.isnan(baseline), {})
    load = np.broadcast_to(LOAD_PA[:, None, None], (len(T_S), len(LAYOUT), 12))
    whole = Chain(effects, LAYOUT, true).forward()(load, T_S).reshape(len(T_S), -1)[:, SLOTS]
    return whole + np.random.default_rng(seed).normal(0.0, noise, whole.shape) if noise else whole


def fit_curves(read, stiffness=1e-6):
    held = memory.memory_states(T_S, LOAD_PA, MEMORIES, LAYOUT)
    return memory.fit_memory(BASELINE - read, LOAD_PA, held, MEMORIES, stiffness)


@pytest.mark.parametrize("spikes", [False, True])
def test_planted_memory_is_fitted_and_inverted(spikes):
    read = counts(effect("hysteresis", r_pa=[20_000.0], w=[0.08]), effect("creep", a=[0.1], tau_s=[20.0]), noise=0.2)
    if spikes:
        read[np.random.default_rng(1).integers(0, len(read), 60)] -= 30.0
    curves = fit_curves(read)
    np.testing.assert_allclose(curves.w, 0.08, atol=0.02)
    np.testing.assert_allclose(curves.a, 0.1, atol=0.02)
    made = memory.memory_calibration(curves, SLOTS, BASELINE, LAYOUT, {})
    clean = counts(effect("hysteresis", r_pa=[20_000.0], w=[0.08]), effect("creep", a=[0.1], tau_s=[20.0]))
    whole = np.full((len(T_S), len(LAYOUT) * 12), np.nan)
    whole[:, SLOTS] = clean
    undone = Chain(made.effects, LAYOUT, made).inverse()(whole.reshape(len(T_S), -1, 12), T_S)
    left = undone.reshape(len(T_S), -1)[:, SLOTS] - LOAD_PA[:, None]
    assert np.sqrt((left**2).mean()) < 2000.0  # what is left out are products of w and a


def test_a_taxel_without_memory_gets_no_shares_and_an_increasing_curve():
    curves = fit_curves(counts(noise=0.2))
    assert curves.w.max() < 0.01
    assert curves.a.max() < 0.01
    x = np.linspace(0.0, 35.0, 50)
    slopes = [np.polyval(np.polyder(coefficients[::-1]), x).min() for coefficients in curves.coefficients_pa]
    assert min(slopes) >= 0.0
    assert not curves.coefficients_pa[:, 0].any()


def test_missing_samples_are_ignored_and_too_few_are_refused():
    read = counts(noise=0.1)
    gaps = read.copy()
    gaps[500:900, 1] = np.nan
    np.testing.assert_allclose(fit_curves(gaps).coefficients_pa[0], fit_curves(read).coefficients_pa[0])
    x = np.array([5.0, 15.0, 30.0])
    curve, whole = (np.polyval(fit_curves(samples).coefficients_pa[1, ::-1], x) for samples in (gaps, read))
    np.testing.assert_allclose(curve, whole, rtol=0.02)
    gaps[20:, 1] = np.nan
    with pytest.raises(CalibrationError, match="a taxel has 20 samples, expected at least 50: leave it out"):
        fit_curves(gaps)


def test_cross_validated_error_is_lower_with_memory():
    read = counts(effect("hysteresis", r_pa=[20_000.0], w=[0.15]), noise=0.5)
    fold = np.arange(len(T_S)) * 5 // len(T_S)
    with_memory, without = (
        memory.cv_rmse_pa(BASELINE - read, LOAD_PA, memory.memory_states(T_S, LOAD_PA, m, LAYOUT), m, 1e-4, fold)
        for m in (MEMORIES, Memories())
    )
    assert with_memory.shape == (len(SLOTS),)
    assert (with_memory < 0.8 * without).all()


def test_a_saved_memory_calibration_gives_the_same_pressures(tmp_path):
    read = counts(effect("hysteresis", r_pa=[20_000.0], w=[0.1]), noise=0.3)
    made = memory.memory_calibration(fit_curves(read), SLOTS, BASELINE, LAYOUT, {"source": "a test"})
    path = tmp_path / "calibration.json"
    write_calibration(path, made, LAYOUT)
    document = json.loads(path.read_text())
    assert [entry["effect"] for entry in document["effects"]] == ["hysteresis"] * 4 + ["creep"] * 4
    assert document["effects"][1]["where"] == {"scope": "taxel", "ids": [[5, 0, 5]]}
    loaded = calibrations.load(path, LAYOUT)
    whole = np.full((len(T_S), len(LAYOUT) * 12), np.nan)
    whole[:, SLOTS] = read
    whole = whole.reshape(len(T_S), -1, 12)
    np.testing.assert_allclose(
        Chain(loaded.effects, LAYOUT, loaded).inverse()(whole, T_S),
        Chain(made.effects, LAYOUT, made).inverse()(whole, T_S),
    )
