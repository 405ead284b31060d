"""Simulated trials load as what was simulated, with the same bytes everywhere."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy._core import _multiarray_umath as of_numpy

import insole_daemon
from insole_daemon import config
from insole_daemon.errors import BusError, SimulationError
from insole_daemon.physics.effect import effect
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.trial import START_NS, Trial
from insole_daemon.skin import layout as layouts

LEFT = layouts.builtin("left", (5, 6, 7))
RIGHT = layouts.builtin("right", (8, 9, 10))
ONE_FOOT = config.Config(insoles=config.Config().insoles[:1])
# Of tests/simulation/whole_trial.py: it changes with insole-reference.yaml, a scenario or a law, and with nothing else.
DIGEST = "b2a2fe4dc2f817f413c1dfe131ab0aca0b5e53d27b43c434ee66e18f185c9068"


def written(tmp_path, name, seconds, settings=ONE_FOOT, feet=(LEFT,), **given):
    path = Trial(name, settings, feet, **given).write(tmp_path / f"{name}-{len(list(tmp_path.iterdir()))}", seconds)
    return insole_daemon.load(path)


def test_a_shoe_trial_loads_with_the_simulated_forces(tmp_path):
    recording = written(tmp_path, "t4", 10.0, config.Config(), (LEFT, RIGHT))
    assert (recording.kind, recording.can_origin, recording.warnings) == ("shoe", "simulated", ())
    for foot in recording.feet:
        t_s = (foot.t_ns - START_NS) * 1e-9
        true_n = Trial("t4", config.Config(), (LEFT, RIGHT)).load.reference(foot.foot, t_s)["fz_n"]
        assert np.corrcoef(foot.wrench.f_z_n, true_n)[0, 1] > 0.995
        assert foot.wrench.f_z_n[true_n > 400].mean() == pytest.approx(true_n[true_n > 400].mean(), rel=0.05)
        assert foot.wrench.valid_fraction.min() > 0.95
        assert foot.reference.clock == "own"
        assert len(foot.reference) == 1000
        assert foot.calibration.coefficients_pa.shape == (28, 12, 4)
    assert len(np.unique(foot.reference["temperature_c"])) > 2, "a shoe warms up"


def test_a_chamber_trial_without_effects_loads_with_its_pressure(tmp_path):
    foot = written(tmp_path, "plenum", 45.0)["left"]
    usable = foot.calibration.usable
    mean_pa = foot.pressure_pa[-100:, usable].astype(float).mean()
    t_s = (foot.t_ns[-100:] - START_NS) * 1e-9
    expected = Trial("plenum", ONE_FOOT, [LEFT]).load.level_pa(t_s).mean()
    assert expected > 250e3
    assert mean_pa == pytest.approx(expected, rel=0.01)


def test_an_effect_changes_the_frames_and_is_not_named_in_the_recording(tmp_path):
    plain = written(tmp_path, "plenum", 30.0)
    odd = written(tmp_path, "plenum", 30.0, effects={"left": [effect("gain", gain=1.3)]})
    depth = [
        240.44 - r["left"].counts[-50:][:, r["left"].calibration.usable].astype(float).mean() for r in (plain, odd)
    ]
    assert depth[1] / depth[0] == pytest.approx(1.3, abs=0.02)
    for name in ("recording.yaml", "calibration.json", "reference.csv"):
        assert (plain.folder / name).read_text() == (odd.folder / name).read_text()


def test_a_wrong_shift_doubles_the_counts_of_its_boards(tmp_path):
    shifted = effect("bit_shift", shift=2)
    one, two = (written(tmp_path, "vacuum", 25.0, effects={"left": effects})["left"] for effects in ([], [shifted]))
    depth = [240.44 - foot.counts[-50:][:, foot.calibration.usable].astype(float).mean() for foot in (one, two)]
    assert depth[1] / depth[0] == pytest.approx(2.0, abs=0.05)


def test_a_clock_effect_sets_the_reference_clock(tmp_path):
    effects = {"left": [effect("clock", offset_s=0.75, rate=1e-4)]}
    reference = written(tmp_path, "t1", 5.0, effects=effects)["left"].reference
    since = reference.time_s - START_NS * 1e-9
    assert since[0] == pytest.approx(0.75, abs=1e-6)
    assert (since[-1] - since[0]) / 4.99 - 1 == pytest.approx(1e-4, abs=1e-6)


def test_injected_faults_appear_in_the_recording(tmp_path):
    broken = Conditions(faults=(InjectedFault("loose", 0.0, None, 5, 0, level_pa=60e3),))
    foot = written(tmp_path, "vacuum", 35.0, conditions=broken)["left"]
    row = LEFT.rows[5, 0]
    opened = foot.status[:, row] & 0xF == 2
    assert 0.1 < opened.mean() < 0.9, "it opens under pressure"
    assert not foot.valid[opened, row].any()


# ---- same seed, same bytes


def process(**environment):
    script = Path(__file__).with_name("whole_trial.py")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", script],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **environment},
    )
    return done.stdout


def test_the_same_seed_gives_the_same_bytes_on_any_machine():
    assert process() == DIGEST


def test_other_vector_units_give_the_same_bytes():
    """Emulates an older CPU: numpy and BLAS may not use what they would choose at run time."""
    features = " ".join(name for name in of_numpy.__cpu_dispatch__ if of_numpy.__cpu_features__.get(name))
    assert process(NPY_DISABLE_CPU_FEATURES=features, OPENBLAS_CORETYPE="Prescott") == DIGEST


def test_another_seed_is_another_insole_and_another_trial_has_other_noise(tmp_path):
    one, other = (written(tmp_path, "t1", 1.0, seed=seed) for seed in (1, 2))
    again = written(tmp_path, "t2", 1.0, seed=1)
    coefficients = [r["left"].calibration.coefficients_pa for r in (one, other, again)]
    assert not np.array_equal(coefficients[0], coefficients[1], equal_nan=True)
    assert np.array_equal(coefficients[0], coefficients[2], equal_nan=True)
    assert (one["left"].counts[:40] != again["left"].counts[:40]).any(), "nobody stands there yet"


# ---- bad input


def test_an_unknown_scenario_and_too_long_a_trial_are_refused(tmp_path):
    with pytest.raises(SimulationError, match='unknown scenario "jump"'):
        Trial("jump", ONE_FOOT, [LEFT])
    trial = Trial("t1", ONE_FOOT, [LEFT])
    with pytest.raises(SimulationError, match="t1: seconds: expected at most 60 s"):
        trial.write(tmp_path / "x", 61.0)
    assert not list(tmp_path.iterdir())
    with pytest.raises(SimulationError, match="more than 0 s"):
        Trial("walk", ONE_FOOT, [LEFT]).length_s(-1.0)


def test_a_layout_on_missing_boards_is_refused():
    elsewhere = layouts.builtin("left", (5, 6, 11))
    with pytest.raises(
        SimulationError, match=r"triangles\[\]\.board: expected the boards of this foot \(5, 6, 7\).*11"
    ):
        Trial("walk", ONE_FOOT, [elsewhere])


def test_a_layout_with_too_many_triangles_is_refused():
    again = replace(
        LEFT, triangles=(*LEFT.triangles, LEFT.triangles[0]), xy_m=np.concatenate([LEFT.xy_m, LEFT.xy_m[:1]])
    )
    with pytest.raises(SimulationError, match="board 5: expected triangles 0 to 15, each once"):
        Trial("walk", ONE_FOOT, [again])


def test_boards_that_exceed_the_bus_capacity_are_refused():
    fast = replace(
        ONE_FOOT.insoles[0], boards=tuple(replace(board, period_ms=5) for board in ONE_FOOT.insoles[0].boards)
    )
    with pytest.raises(BusError, match="exceed the capacity.*at most 80%"):
        Trial("walk", config.Config(insoles=(fast,)), [LEFT])
