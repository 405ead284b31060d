"""Force plates of C3D files become references."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import insole_daemon
from insole_daemon.calibration.validation import validate
from insole_daemon.config import Config
from insole_daemon.errors import FileError
from insole_daemon.recording.export_c3d import export_c3d
from insole_daemon.recording.import_c3d import ForcePlate, read_force_plates
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial

INSOLE = Path(sys.executable).with_name("insole")


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    layouts = [load_layout(insole) for insole in Config().insoles]
    return insole_daemon.load(Trial("t5", Config(), layouts, seed=3).write(tmp_path_factory.mktemp("trial") / "w", 8.0))


def heel_of(foot):
    """Return the origin of an exported insole relative to its plate's centre: x forward, y to the left."""
    low, high = foot.layout.xy_m.min(axis=(0, 1)), foot.layout.xy_m.max(axis=(0, 1))
    return tuple((-(low + high) / 2).tolist())


def test_an_exported_force_plate_imports_as_the_same_reference(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    plates = read_force_plates(tmp_path / "x.c3d")
    assert len(plates) == 2
    start_ns = max(int(foot.t_ns[0]) for foot in walk.feet)
    for foot, plate in zip(walk.feet, plates, strict=True):
        at_s = (foot.t_ns - start_ns) * 1e-9
        columns = plate.columns(heel_of(foot))
        for name, column in (("f_z_n", "fz_n"), ("m_x_nm", "mx_nm"), ("m_y_nm", "my_nm")):
            expected = np.interp(plate.time_s, at_s, getattr(foot.wrench, name))
            np.testing.assert_allclose(columns[column], expected, rtol=1e-5, atol=1e-3)


def test_moments_are_about_the_insole_origin(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    (plate, _) = read_force_plates(tmp_path / "x.c3d")
    loaded = plate.f_z_n > 200
    centred_cop, shifted_cop = (cop_of(plate.columns(origin_m), loaded) for origin_m in ((0.0, 0.0), (0.1, 0.02)))
    np.testing.assert_allclose(centred_cop - shifted_cop, np.array([[0.1], [0.02]]) * np.ones(loaded.sum()), atol=1e-9)


def test_heading_rotates_moments_into_the_insole_frame(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    (plate, _) = read_force_plates(tmp_path / "x.c3d")
    loaded = plate.f_z_n > 200
    x_m, y_m = cop_of(plate.columns(), loaded)
    turned = cop_of(plate.columns(heading_deg=90.0), loaded)
    np.testing.assert_allclose(turned, [y_m, -x_m], atol=1e-9)


def test_times_without_plate_contact_have_no_reference():
    time_s = np.arange(0, 10, 0.01)
    force = np.where((time_s >= 4) & (time_s < 4.6), 700.0, 3.0)
    columns = ForcePlate(time_s, force, 0 * force, 0 * force).contact_columns((0.0, 0.0), 0.0)
    assert columns["time_s"][0] == pytest.approx(3.7)
    assert columns["time_s"][-1] == pytest.approx(4.89)
    assert np.count_nonzero(columns["fz_n"] > 20) == 60


def cop_of(columns, rows):
    return np.stack([-columns["my_nm"][rows], columns["mx_nm"][rows]]) / columns["fz_n"][rows]


@pytest.mark.skipif(platform.machine() != "x86_64", reason="ezc3d has wheels for x86-64 alone; it needs one")
@pytest.mark.parametrize("z_mm", [-45.0, 45.0], ids=["above the transducer", "with the sign that some files have"])
def test_shear_and_transducer_depth_agree_with_ezc3d(tmp_path, z_mm):
    import ezc3d

    random = np.random.default_rng(4)
    forces = np.stack([random.uniform(-150, 150, 40), random.uniform(-80, 80, 40), random.uniform(300, 900, 40)])
    moments = np.stack([random.uniform(-9e4, 9e4, 40), random.uniform(-9e4, 9e4, 40), random.uniform(-2e4, 2e4, 40)])
    made = ezc3d.c3d()
    made["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    made["parameters"]["POINT"]["LABELS"]["value"] = ["M"]
    made["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    made["parameters"]["ANALOG"]["RATE"]["value"] = [1000.0]
    made["parameters"]["ANALOG"]["LABELS"]["value"] = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    made["parameters"]["ANALOG"]["UNITS"]["value"] = ["N", "N", "N", "Nmm", "Nmm", "Nmm"]
    made["data"]["points"] = np.zeros((4, 1, 4))
    made["data"]["analogs"] = np.concatenate([forces, moments])[None]
    plates = made["parameters"]["FORCE_PLATFORM"]
    plates["USED"]["value"], plates["TYPE"]["value"] = [1], [2]
    plates["CHANNEL"]["value"] = np.arange(1, 7)[:, None]
    plates["ORIGIN"]["value"] = np.array([[3.0], [-2.0], [z_mm]])
    # a plate whose x is the laboratory's, and whose z points down
    plates["CORNERS"]["value"] = np.array([[250, -250, 0], [-250, -250, 0], [-250, 250, 0], [250, 250, 0]]).T[..., None]
    made.write(str(tmp_path / "x.c3d"))
    (plate,) = read_force_plates(tmp_path / "x.c3d")
    (theirs,) = ezc3d.c3d(str(tmp_path / "x.c3d"), extract_forceplat_data=True)["data"]["platform"]
    np.testing.assert_allclose(plate.f_z_n, -theirs["force"][2], rtol=1e-6)
    np.testing.assert_allclose(cop_of(plate.columns(), slice(None)), theirs["center_of_pressure"][:2] * 1e-3, atol=1e-6)


@pytest.mark.parametrize("content", [b"", b"no C3D at all, but long enough to be read as one" * 40])
def test_a_file_that_is_not_c3d_is_refused(tmp_path, content):
    (tmp_path / "x.c3d").write_bytes(content)
    with pytest.raises(FileError, match="expected a C3D file"):
        read_force_plates(tmp_path / "x.c3d")
    with pytest.raises(FileError, match="cannot be read"):
        read_force_plates(tmp_path / "none.c3d")


@pytest.fixture
def unknown_load(walk, tmp_path):
    """Return the recording without its reference, with its own forces as plates of a C3D file."""
    export_c3d(walk, tmp_path / "x.c3d")
    folder = shutil.copytree(walk.folder, tmp_path / "walk")
    document = yaml.safe_load((folder / "recording.yaml").read_text())
    del document["reference"]
    document["extensions"] = {"note": "kept"}
    (folder / "recording.yaml").write_text(yaml.safe_dump(document | {"kind": "free"}))
    return folder


def insole(*arguments):
    return subprocess.run([INSOLE, *map(str, arguments)], capture_output=True, text=True, check=False)


def test_a_plate_added_by_the_command_is_used_by_validate(walk, unknown_load, tmp_path):
    x_mm, y_mm = (1e3 * metres for metres in heel_of(walk["left"]))
    done = insole("reference", unknown_load, tmp_path / "x.c3d", "--foot", "left", "--plate", 1,
                  "--origin-mm", x_mm, y_mm)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    loaded = insole_daemon.load(unknown_load)
    assert loaded.kind == "shoe"
    assert loaded["right"].reference is None
    assert "kept" in (unknown_load / "recording.yaml").read_text()
    force = loaded["left"].reference["fz_n"]
    assert force.max() == pytest.approx(walk["left"].wrench.f_z_n.max(), rel=0.03)
    (result,), _ = validate([loaded], loaded["left"].calibration)
    assert result.outcome.f_z.rmse < 0.05 * force.max()
    assert result.outcome.cop_x.rmse < 0.003
    again = insole("reference", unknown_load, tmp_path / "x.c3d", "--foot", "left", "--plate", 1)
    assert again.returncode == 4
    assert "has a reference already: give --force" in again.stderr


def test_another_sensors_text_becomes_the_reference(walk, unknown_load, tmp_path):
    left = walk["left"]
    columns = ((left.t_ns - left.t_ns[0]) * 1e-9, left.wrench.f_z_n, left.wrench.cop_x_m, left.wrench.cop_y_m)
    rows = [",".join("" if value != value else f"{value:.6f}" for value in row) for row in zip(*columns, strict=True)]
    (tmp_path / "other.csv").write_text("\n".join(["t,F,X,Y", *rows]) + "\n")
    mapping = "format: insole-table/1\nfoot: left\ntime: {column: t, unit: s}\nforce: {column: F, unit: N}\n"
    (tmp_path / "force.yaml").write_text(mapping)
    refused = insole("reference", unknown_load, tmp_path / "other.csv", "--mapping", tmp_path / "force.yaml")
    assert refused.returncode == 4
    assert "name cop_x and cop_y" in refused.stderr
    both = mapping + "cop_x: {column: X, unit: m}\ncop_y: {column: Y, unit: m}\n"
    (tmp_path / "cop.yaml").write_text(both)
    done = insole("reference", unknown_load, tmp_path / "other.csv", "--mapping", tmp_path / "cop.yaml")
    assert done.returncode == 0, done.stderr
    (result,), _ = validate([insole_daemon.load(unknown_load)], left.calibration)
    assert result.outcome.f_z.accuracy > 90


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ((), 2, "expected --foot"),
        (("--foot", "left"), 2, "has 2 plates: choose one of --plate 1"),
        (("--foot", "left", "--plate", 3), 2, "has 2 plates, found --plate 3"),
    ],
)
def test_missing_columns_of_a_reference_are_reported(unknown_load, tmp_path, arguments, status, message):
    done = insole("reference", unknown_load, tmp_path / "x.c3d", *arguments)
    assert done.returncode == status
    assert message in " ".join(done.stderr.split())
