"""Text exports of other sensors give the same steps as the recording of that walk."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.errors import DocumentError, FileError
from insole_daemon.recording.import_text import steps_of_table
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial

MAPPING = """format: insole-table/1
foot: left
separator: ";"
decimal: ","
lines_before_names: 1
time: {column: "t [ms]", unit: ms}
force: {column: Fz, unit: kN}
cop_x: {column: X, unit: mm}
cop_y: {column: Y, unit: mm}
"""


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    layouts = [load_layout(insole) for insole in Config().insoles]
    folder = Trial("t5", Config(), layouts, seed=3).write(tmp_path_factory.mktemp("trial") / "w", 16.0)
    return insole_daemon.load(folder)


def write(tmp_path, walk, mapping=MAPPING):
    left = walk["left"]
    columns = [
        (left.t_ns - left.t_ns[0]) * 1e-6,
        left.wrench.f_z_n * 1e-3,
        left.wrench.cop_x_m * 1e3,
        left.wrench.cop_y_m * 1e3,
    ]
    lines = ["made by another program", "t [ms];Fz;X;Y"]
    lines += [
        ";".join("" if v != v else f"{v:.6f}".replace(".", ",") for v in row) for row in zip(*columns, strict=True)
    ]
    (tmp_path / "other.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "other.yaml").write_text(mapping)
    return tmp_path / "other.csv", tmp_path / "other.yaml"


def test_steps_of_a_text_export_equal_those_of_the_recording(walk, tmp_path):
    other, ours = steps_of_table(*write(tmp_path, walk)).steady, walk.steps.of("left").steady
    assert len(other) == len(ours) >= 8
    for name, within in (("stance_s", 0.02), ("peak_force_n", 0.03), ("impulse_n_s", 0.02), ("cop_path_m", 0.06)):
        assert np.mean(other[name]) == pytest.approx(np.mean(ours[name]), rel=within), name
    assert np.isnan(other["contact_area_m2"]).all(), "nobody measured pressure"


def test_force_alone_is_enough_for_steps(walk, tmp_path):
    mapping = "".join(line for line in MAPPING.splitlines(keepends=True) if not line.startswith("cop"))
    steps = steps_of_table(*write(tmp_path, walk, mapping))
    assert len(steps.steady) >= 8
    assert np.isnan(steps["cop_path_m"]).all()


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (("column: Fz", "column: F_z"), FileError, "expected the columns F_z, found"),
        (("unit: kN", "unit: lbf"), DocumentError, "kN"),
        (('decimal: ","', 'decimal: "."'), FileError, "line 3: .*expected a number"),
        (('column: "t [ms]"', "column: Fz"), FileError, "times that increase"),
    ],
)
def test_mismatches_with_the_mapping_file_are_reported(walk, tmp_path, change, error, words):
    with pytest.raises(error, match=words):
        steps_of_table(*write(tmp_path, walk, MAPPING.replace(*change)))
