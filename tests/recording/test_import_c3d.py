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
    for foot, plate in zip(walk.feet, plates.values(), strict=True):
        at_s = (foot.t_ns - start_ns) * 1e-9
        columns = plate.columns(heel_of(foot))
        for name, column in (("f_z_n", "fz_n"), ("m_x_nm", "mx_nm"), ("m_y_nm", "my_nm")):
            expected = np.interp(plate.time_s, at_s, getattr(foot.wrench, name))
            np.testing.assert_allclose(columns[column], expected, rtol=1e-5, atol=1e-3)


def test_moments_are_about_the_insole_origin(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    plate = read_force_plates(tmp_path / "x.c3d")[1]
    loaded = plate.f_z_n > 200
    centred_cop, shifted_cop = (cop_of(plate.columns(origin_m), loaded) for origin_m in ((0.0, 0.0), (0.1, 0.02)))
    np.testing.assert_allclose(centred_cop - shifted_cop, np.array([[0.1], [0.02]]) * np.ones(loaded.sum()), atol=1e-9)


def test_heading_rotates_moments_into_the_insole_frame(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    plate = read_force_plates(tmp_path / "x.c3d")[1]
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


WITH_EZC3D = pytest.mark.skipif(platform.machine() != "x86_64", reason="ezc3d has wheels for x86-64 alone")


@WITH_EZC3D
@pytest.mark.parametrize("z_mm", [-45.0, 45.0], ids=["above the transducer", "with the sign that some files have"])
def test_shear_and_transducer_depth_agree_with_ezc3d(tmp_path, z_mm):
    import ezc3d

    random = np.random.default_rng(4)
    forces = np.stack([random.uniform(-150, 150, 40), random.uniform(-80, 80, 40), random.uniform(300, 900, 40)])
    moments = np.stack([random.uniform(-9e4, 9e4, 40), random.uniform(-9e4, 9e4, 40), random.uniform(-2e4, 2e4, 40)])
    write_plates(
        tmp_path / "x.c3d", [(2, np.concatenate([forces, moments]), ["N", "N", "N", "Nmm", "Nmm", "Nmm"])],
        origins_mm=[(3.0, -2.0, z_mm)],
    )  # fmt: skip
    plate = read_force_plates(tmp_path / "x.c3d")[1]
    (theirs,) = ezc3d.c3d(str(tmp_path / "x.c3d"), extract_forceplat_data=True)["data"]["platform"]
    np.testing.assert_allclose(plate.f_z_n, -theirs["force"][2], rtol=1e-6)
    np.testing.assert_allclose(cop_of(plate.columns(), slice(None)), theirs["center_of_pressure"][:2] * 1e-3, atol=1e-6)


def write_plates(file, plates, origins_mm, matrices=(), used=None):
    """Write a C3D file with `plates`: (type, signals (channels, n), units). x is the laboratory's, z points down."""
    import ezc3d

    made = ezc3d.c3d()
    analog = np.concatenate([signals for _, signals, _ in plates])
    made["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    made["parameters"]["POINT"]["LABELS"]["value"] = ["M"]
    made["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    made["parameters"]["ANALOG"]["RATE"]["value"] = [1000.0]
    made["parameters"]["ANALOG"]["LABELS"]["value"] = [f"A{number}" for number in range(len(analog))]
    made["parameters"]["ANALOG"]["UNITS"]["value"] = [unit for _, _, units in plates for unit in units]
    made["data"]["points"] = np.zeros((4, 1, analog.shape[1] // 10))
    made["data"]["analogs"] = analog[None]
    parameters = made["parameters"]["FORCE_PLATFORM"]
    parameters["USED"]["value"] = [len(plates) if used is None else used]
    parameters["TYPE"]["value"] = [kind for kind, _, _ in plates]
    channels, begin = np.zeros((max(len(signals) for _, signals, _ in plates), len(plates))), 1
    for at, (_, signals, _) in enumerate(plates):
        channels[: len(signals), at] = np.arange(begin, begin + len(signals))
        begin += len(signals)
    parameters["CHANNEL"]["value"] = channels
    parameters["ORIGIN"]["value"] = np.array(origins_mm).T
    corners = np.array([[250, -250, 0], [-250, -250, 0], [-250, 250, 0], [250, 250, 0]]).T
    parameters["CORNERS"]["value"] = np.repeat(corners[..., None], len(plates), axis=2)
    if len(matrices):
        parameters["CAL_MATRIX"]["value"] = np.stack(matrices, axis=2)
    made.write(str(file))


N_READINGS = 40
A_MM, B_MM, DEPTH_MM = 120.0, 200.0, 54.0  # sensors of a plate of type 3 from its axes, and below its surface


@pytest.fixture
def known_load():
    """Return what a foot does to a plate, z down: force (3, n), and the place (2, n) in mm where it does so."""
    random = np.random.default_rng(8)
    force = np.stack([random.uniform(low, high, N_READINGS) for low, high in ((-150, 150), (-80, 80), (300, 900))])
    return force, random.uniform(-100, 100, (2, N_READINGS))


def moments_nmm(force, place_mm, origin_mm):
    """Moments about `origin_mm`, which is seen from the centre of the surface."""
    arm = np.vstack([place_mm, np.zeros(N_READINGS)]) - np.array(origin_mm)[:, None]
    return np.cross(arm.T, force.T).T


def signals_of_type_1(force, place_mm):
    return np.concatenate([force, place_mm, np.zeros((1, N_READINGS))]), ["N"] * 3 + ["mm"] * 2 + ["Nmm"]


def signals_of_type_3(force, place_mm):
    """Four sensors bear force and moments about the point between them; a twist of 30 N is free."""
    m_x, m_y, _ = moments_nmm(force, place_mm, (0, 0, DEPTH_MM))
    share = np.array([[1, 1, 1, 1], [B_MM, B_MM, -B_MM, -B_MM], [-A_MM, A_MM, A_MM, -A_MM], [1, -1, 1, -1]])
    vertical = np.linalg.solve(share, np.stack([force[2], m_x, m_y, np.full(N_READINGS, 30.0)]))
    shear = np.stack([0.3 * force[0], 0.7 * force[0], 0.6 * force[1], 0.4 * force[1]])
    return np.concatenate([shear, vertical]), ["N"] * 8


MATRIX = np.diag([250.0, 250.0, 1000.0, 9e4, 9e4, 5e4]) + np.random.default_rng(9).normal(size=(6, 6)) * 5.0


def signals_of_type_4(force, place_mm):
    load = np.concatenate([force, moments_nmm(force, place_mm, (2, -1, DEPTH_MM))])
    return np.linalg.solve(MATRIX, load), ["V"] * 6


@WITH_EZC3D
@pytest.mark.parametrize(
    ("kind", "signals_of", "origin_mm"),
    [
        (1, signals_of_type_1, (0, 0, -DEPTH_MM)),
        (3, signals_of_type_3, (A_MM, B_MM, -DEPTH_MM)),
        (3, signals_of_type_3, (A_MM, B_MM, DEPTH_MM)),
        (4, signals_of_type_4, (-2, 1, -DEPTH_MM)),
        (4, signals_of_type_4, (2, -1, DEPTH_MM)),
    ],
)
def test_a_known_load_is_read_from_every_type_of_plate(tmp_path, known_load, kind, signals_of, origin_mm):
    force, place_mm = known_load
    signals, units = signals_of(force, place_mm)
    before = (2, np.zeros((6, N_READINGS)), ["N"] * 3 + ["Nmm"] * 3)
    write_plates(tmp_path / "x.c3d", [before, (kind, signals, units)], [(0, 0, -40.0), origin_mm], [np.eye(6), MATRIX])
    plate = read_force_plates(tmp_path / "x.c3d")[2]
    np.testing.assert_allclose(plate.f_z_n, force[2], rtol=1e-5)
    expected = place_mm * np.array([[1e-3], [-1e-3]])  # z is up now, so y has turned
    np.testing.assert_allclose(cop_of(plate.columns(), slice(None)), expected, atol=1e-6)


@WITH_EZC3D
@pytest.mark.parametrize(("kind", "signals_of", "origin_mm"), [
    (1, signals_of_type_1, (0, 0, -DEPTH_MM)), (3, signals_of_type_3, (A_MM, B_MM, -DEPTH_MM)),
    (4, signals_of_type_4, (-2, 1, -DEPTH_MM)),
])  # fmt: skip
def test_every_type_of_plate_agrees_with_ezc3d(tmp_path, known_load, kind, signals_of, origin_mm):
    import ezc3d

    write_plates(tmp_path / "x.c3d", [(kind, *signals_of(*known_load))], [origin_mm], [MATRIX])
    plate = read_force_plates(tmp_path / "x.c3d")[1]
    (theirs,) = ezc3d.c3d(str(tmp_path / "x.c3d"), extract_forceplat_data=True)["data"]["platform"]
    np.testing.assert_allclose(plate.f_z_n, -theirs["force"][2], rtol=1e-5)
    np.testing.assert_allclose(cop_of(plate.columns(), slice(None)), theirs["center_of_pressure"][:2] * 1e-3, atol=1e-6)


@WITH_EZC3D
def test_plates_keep_their_number_beside_one_of_a_type_that_is_not_read(tmp_path, known_load):
    other = (5, np.zeros((8, N_READINGS)), ["N"] * 8)
    plate = (1, *signals_of_type_1(*known_load))
    write_plates(tmp_path / "x.c3d", [other, plate], [(0, 0, -40.0)] * 2)
    assert list(read_force_plates(tmp_path / "x.c3d")) == [2]
    write_plates(tmp_path / "x.c3d", [other], [(0, 0, -40.0)])
    with pytest.raises(FileError, match="expected a force plate of types 1 to 4, found types: 5"):
        read_force_plates(tmp_path / "x.c3d")


@WITH_EZC3D
def test_a_plate_that_is_described_but_not_used_is_left_out(tmp_path, known_load):
    plate = (1, *signals_of_type_1(*known_load))
    write_plates(tmp_path / "x.c3d", [plate, plate], [(0, 0, -40.0)] * 2, used=1)
    assert list(read_force_plates(tmp_path / "x.c3d")) == [1]


@WITH_EZC3D
@pytest.mark.parametrize(("kind", "n_signals", "message"), [
    (4, 6, "CAL_MATRIX: plate 1 is of type 4, found no matrix"),
    (3, 6, "CHANNEL: expected 8 of 6 analog channels for plate 1, which is of type 3"),
])  # fmt: skip
def test_parameters_that_do_not_fit_the_type_are_named(tmp_path, kind, n_signals, message):
    write_plates(tmp_path / "x.c3d", [(kind, np.zeros((n_signals, N_READINGS)), ["N"] * n_signals)], [(0, 0, -40.0)])
    with pytest.raises(FileError, match=message):
        read_force_plates(tmp_path / "x.c3d")


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
        (("--foot", "left", "--plate", 3), 2, "expected --plate 1, 2, of types 1 to 4, found --plate 3"),
    ],
)
def test_missing_columns_of_a_reference_are_reported(unknown_load, tmp_path, arguments, status, message):
    done = insole("reference", unknown_load, tmp_path / "x.c3d", *arguments)
    assert done.returncode == status
    assert message in " ".join(done.stderr.split())
