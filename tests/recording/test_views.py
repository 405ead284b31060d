"""A recording as steps, DataFrame, Dataset and description."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.mechanics.gait.symmetry import symmetry
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import START_NS, Trial

CONFIG = Config()
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    trial = Trial("t5", CONFIG, LAYOUTS, seed=3)
    return trial, insole_daemon.load(trial.write(tmp_path_factory.mktemp("trial") / "walk"))


def test_steps_of_a_recording_match_the_simulated_person(walk):
    """Contact and toe-off are within 10 ms RMS despite boards, bus, digitiser, noise and a warming insole."""
    trial, recording = walk
    steady = recording.steps.steady
    assert len(steady) > 90
    errors_s = []
    for foot in ("left", "right"):
        foot_steps = steady.of(foot)
        t_s = np.arange(0, 60, 0.0005)
        changes = np.diff((trial.load.force_n(foot, t_s) > 0).astype(int))
        for name, change in (("contact_s", 1), ("toe_off_s", -1)):
            true_s = t_s[1:][changes == change]
            detected_s = foot_steps[name] + (recording.steps.start_ns - START_NS) * 1e-9
            errors_s += [float((time_s - true_s)[np.abs(time_s - true_s).argmin()]) for time_s in detected_s]
    assert np.sqrt(np.mean(np.square(errors_s))) < 0.010
    assert abs(np.mean(steady["peak_force_n"]) / (1.1 * trial.load.weight_n) - 1) < 0.03


def test_a_repr_fits_five_lines(walk):
    _, recording = walk
    for described in (recording, recording["left"], recording.steps):
        assert len(repr(described).splitlines()) <= 5
        assert max(map(len, repr(described).splitlines())) < 250


def test_a_dataframe_has_one_row_per_cycle(walk):
    _, recording = walk
    frame = recording.to_dataframe()
    assert len(frame) == sum(map(len, recording.feet))
    assert frame.index.is_monotonic_increasing
    left = recording["left"]
    foot_rows = frame[frame.foot == "left"]
    np.testing.assert_array_equal(foot_rows.t_ns, left.t_ns)
    np.testing.assert_array_equal(foot_rows.f_z_n, left.wrench.f_z_n)


def test_steps_as_a_dataframe_keep_labels_and_figures(walk):
    _, recording = walk
    frame = recording.steps.to_dataframe()
    assert frame.groupby("label").size()["steady"] == len(recording.steps.steady)
    np.testing.assert_array_equal(frame.stance_s, recording.steps["stance_s"])


def test_a_dataset_has_everything_by_cycle_triangle_and_taxel(walk):
    _, recording = walk
    left = recording["left"]
    dataset = recording.to_xarray()["left"]
    assert dataset.sizes == {"cycle": len(left), "triangle": len(left.layout), "taxel": 12}
    np.testing.assert_array_equal(dataset.pressure_pa, left.pressure_pa)
    assert dataset.f_z_n.attrs["units"] == "N"
    assert dataset.time.values[0] == left.t_ns[:1].astype("datetime64[ns]")[0]


def test_without_calibration_only_counts_are_described(walk):
    _, recording = walk
    blind = tuple(replace(foot, wrench=None, pressure_pa=None, calibration=None) for foot in recording.feet)
    raw = replace(recording, feet=blind)
    assert "no calibration" in repr(raw)
    assert len(raw.steps) == 0
    assert "no calibration" in " ".join(raw.steps.remarks)
    assert "no calibration" in repr(raw.steps)
    assert raw.steps.to_dataframe().columns.tolist() == recording.steps.to_dataframe().columns.tolist()
    assert np.isnan(symmetry(raw.steps, "peak_force_n").value)
    assert raw.steps.steady.curves["f_z_n"].shape == (0, 101)
    assert "valid_fraction" in raw.to_dataframe()
    assert "pressure_pa" not in raw.to_xarray()["left"]
    half = replace(recording, feet=(recording["left"], blind[1]))
    assert set(half.steps["foot"]) == {"left"}
    assert np.isnan(half.steps["double_support_s"]).all()
    assert "no symmetry" in " ".join(half.steps.remarks)
