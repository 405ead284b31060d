"""A recorded chamber trial simulated from its reference: its load, its boards, the model's effects, what is refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insole_daemon import config as configs
from insole_daemon.errors import SimulationError
from insole_daemon.physics.effect import Where, effect
from insole_daemon.recording.loading import FootRecording, load
from insole_daemon.recording.read_times import median_interval_ns
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.recorded_chamber import simulate_recorded
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.geometry import PRESSURE_TAXELS

EXAMPLES = Path(__file__).parents[1] / "data" / "examples"


def activation_count(foot: FootRecording, t_s: np.ndarray) -> np.ndarray:
    """(n, n_triangles, 12) below the baselines, at times (n,) since the epoch."""
    assert foot.calibration is not None
    rows = np.searchsorted(foot.t_ns * 1e-9, t_s).clip(0, len(foot) - 1)
    return foot.calibration.baseline_count - foot.counts[rows]


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> tuple[FootRecording, FootRecording]:
    """The chamber of another generator, and its simulation."""
    recording = load(EXAMPLES / "chamber")
    (foot,) = recording.feet
    assert foot.calibration is not None
    out = simulate_recorded(recording, foot, foot.calibration, tmp_path_factory.mktemp("out") / "simulation")
    return foot, load(out).feet[0]


def test_the_simulation_reads_what_the_recording_reads_but_for_noise(example):
    foot, simulated = example
    t_s = foot.t_ns[50:-50:5] * 1e-9
    recorded, simulated_counts = (activation_count(which, t_s)[:, :, PRESSURE_TAXELS] for which in (foot, simulated))
    usable = foot.calibration.usable[:, PRESSURE_TAXELS]
    off = (recorded - simulated_counts)[:, usable]
    assert simulated_counts[:, usable].max() > 10.0
    assert np.abs(off.mean()) < 0.15
    assert np.sqrt(np.mean(off**2)) < 1.8  # both have a noise of about a count


def test_the_simulation_has_the_layout_the_clock_and_a_static_calibration(example):
    foot, simulated = example
    np.testing.assert_array_equal(simulated.layout.identities, foot.layout.identities)
    np.testing.assert_allclose(simulated.layout.xy_m, foot.layout.xy_m, atol=1e-6)
    assert simulated.t_ns[0] * 1e-9 == pytest.approx(foot.reference.time_s[0], abs=0.1)
    assert simulated.reference.clock == "can"
    assert simulated.calibration.effects == ()
    np.testing.assert_array_equal(simulated.calibration.usable, foot.calibration.usable)


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A vacuum bag read by boards at 20, 50 and 37 ms."""
    config = configs.load(None)
    (left, *_) = config.insoles
    boards = tuple(replace(board, period_ms=ms) for board, ms in zip(left.boards, (20, 50, 37), strict=True))
    config = replace(config, insoles=(replace(left, boards=boards),))
    folder = tmp_path_factory.mktemp("trial") / "bag"
    return Trial("vacuum", config, [load_layout(left)], seed=5).write(folder, 20.0)


def test_boards_of_the_simulation_send_at_the_periods_of_the_recording(trial, tmp_path):
    recording = load(trial)
    (foot,) = recording.feet
    (simulated,) = load(simulate_recorded(recording, foot, foot.calibration, tmp_path / "out")).feet
    assert [board.period_ms for board in simulated.boards] == [20, 50, 37]
    for address, period_ms in ((5, 20), (6, 50), (7, 37)):
        row = int(np.flatnonzero(simulated.layout.identities[:, 0] == address)[0])
        apart_ns = median_interval_ns(simulated.read_ns[simulated.is_new[:, row], row])
        assert apart_ns == pytest.approx(period_ms * 1e6, rel=0.02)


def test_a_model_with_effects_is_simulated_with_them_but_for_those_of_its_own_trial(trial, tmp_path):
    recording = load(trial)
    (foot,) = recording.feet
    late = effect("delay", delay_s=1.0)
    rezeroed = effect("rezero", Where("board", ((6,),)), t_s=2.0, shift_count=30.0)
    model = replace(foot.calibration, effects=(late, rezeroed))
    static, dynamic = (
        load(simulate_recorded(recording, foot, calibration, tmp_path / name)).feet[0]
        for name, calibration in (("static", foot.calibration), ("dynamic", model))
    )
    t_s = static.t_ns[200:-100] * 1e-9
    early, late_by_1_s = activation_count(static, t_s - 1.0), activation_count(dynamic, t_s)
    usable = foot.calibration.usable
    assert np.abs((early - late_by_1_s)[:, usable].mean(axis=1)).max() < 1.0
    assert dynamic.calibration.effects == ()


def test_a_gap_of_the_reference_ends_the_simulation_and_the_longer_part_is_simulated(trial, tmp_path):
    recording = load(trial)
    (foot,) = recording.feet
    pressure = foot.reference["pressure_pa"].copy()
    time_s = foot.reference.time_s
    pressure[(time_s > time_s[0] + 5.0) & (time_s < time_s[0] + 8.0)] = np.nan
    reference = replace(foot.reference, columns={"pressure_pa": pressure})
    foot = replace(foot, reference=reference)
    (simulated,) = load(simulate_recorded(recording, foot, foot.calibration, tmp_path / "out")).feet
    assert np.ptp(simulated.reference.time_s) == pytest.approx(time_s[-1] - time_s[0] - 8.0, abs=0.2)


def test_a_walk_is_refused_because_a_shoe_does_not_determine_the_load_of_the_taxels(tmp_path):
    recording = load(EXAMPLES / "shoe")
    (foot,) = recording.feet
    with pytest.raises(SimulationError, match="three channels of a shoe do not determine the load of 280 taxels"):
        simulate_recorded(recording, foot, foot.calibration, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_reference_without_a_pressure_is_refused(tmp_path):
    shutil.copytree(EXAMPLES / "chamber", tmp_path / "chamber")
    recording = load(tmp_path / "chamber")
    (foot,) = recording.feet
    nothing = {"pressure_pa": np.full(len(foot.reference), np.nan)}
    foot = replace(foot, reference=replace(foot.reference, columns=nothing))
    with pytest.raises(SimulationError, match="found 0 rows of the reference"):
        simulate_recorded(recording, foot, foot.calibration, tmp_path / "out")
