"""The published phenomenon, in short; benchmarks/physics/paper_phenomenon.py has the whole table."""

import pytest

from benchmarks.physics.paper_phenomenon import experiment

CALIBRATION_S = {"vacuum": 65.0, "t1": 15.0, "t2": 15.0, "t3": 40.0}  # one cycle of three, and parts of the tasks


@pytest.fixture(scope="module")
def errors():
    return {physics: experiment(physics, ["t1", "t4"], 20.0, CALIBRATION_S) for physics in (False, True)}


def test_with_effects_standing_stays_accurate_and_walking_does_not(errors):
    noise, physics = errors[False], errors[True]
    assert physics["t1"].f_z_n < 1.5 * noise["t1"].f_z_n
    assert physics["t4"].f_z_n > 3 * noise["t4"].rows_f_z_n > 3 * noise["t4"].f_z_n
    assert physics["t4"].f_z_n > 5 * physics["t1"].f_z_n, "several-fold, as in the published table"
    assert 50 < physics["t4"].f_z_n < 200, "the order of the paper's 93 N"


def test_without_effects_walking_has_errors_of_noise_and_rounding_only(errors):
    noise = errors[False]
    assert noise["t1"].f_z_n < 15
    assert noise["t4"].f_z_n < 25
