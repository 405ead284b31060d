"""Force plates of C3D files, as a reference."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.errors import FileError
from insole_daemon.recording import reference as references
from insole_daemon.recording.export_c3d import export_c3d
from insole_daemon.recording.import_c3d import read_force_plates, write_reference
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    layouts = [load_layout(insole) for insole in Config().insoles]
    return insole_daemon.load(Trial("t5", Config(), layouts, seed=3).write(tmp_path_factory.mktemp("trial") / "w", 8.0))


def test_what_was_exported_comes_back_as_a_reference(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    plates = read_force_plates(tmp_path / "x.c3d")
    assert len(plates) == 2
    start_ns = max(int(foot.t_ns[0]) for foot in walk.feet)
    for foot, plate in zip(walk.feet, plates, strict=True):
        at_s = (foot.t_ns - start_ns) * 1e-9
        for name in ("f_z_n", "m_x_nm", "m_y_nm"):
            expected = np.interp(plate.time_s, at_s, getattr(foot.wrench, name))
            np.testing.assert_allclose(getattr(plate, name), expected, rtol=1e-5, atol=1e-3)
    write_reference(plates[0], tmp_path / "reference.csv")
    again, _ = references.read(tmp_path / "reference.csv", "shoe", "left", "own")
    np.testing.assert_allclose(again["fz_n"], plates[0].f_z_n, rtol=1e-6, atol=1e-6)


def test_moments_are_about_the_insoles_origin(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    (plate, _) = read_force_plates(tmp_path / "x.c3d")
    moved = plate.columns((0.1, 0.02))
    loaded = plate.f_z_n > 200
    here = np.stack([-plate.m_y_nm, plate.m_x_nm])[:, loaded] / plate.f_z_n[loaded]
    there = np.stack([-moved["my_nm"], moved["mx_nm"]])[:, loaded] / moved["fz_n"][loaded]
    np.testing.assert_allclose(here - there, np.array([[0.1], [0.02]]) * np.ones(loaded.sum()), atol=1e-9)


@pytest.mark.parametrize("content", [b"", b"no C3D at all, but long enough to be read as one" * 40])
def test_what_is_no_c3d_is_refused(tmp_path, content):
    (tmp_path / "x.c3d").write_bytes(content)
    with pytest.raises(FileError, match="expected a C3D file"):
        read_force_plates(tmp_path / "x.c3d")
    with pytest.raises(FileError, match="cannot be read"):
        read_force_plates(tmp_path / "none.c3d")
