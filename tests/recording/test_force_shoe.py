"""Two six-axis sensors are combined into one wrench, compared with explicit mechanics; and instruments send
readings.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from insole_daemon.errors import DocumentError, InsoleError
from insole_daemon.recording.force_shoe import COLUMNS, ShoeSensors, load
from insole_daemon.recording.instrument import Instrument

SHOE = """format: insole-shoe/1
foot: left
front: {x_mm: 190, y_mm: -5, z_mm: -20, roll_deg: 180, yaw_deg: 30, reports: foot_on_ground}
rear: {x_mm: 35, y_mm: 4, z_mm: -25, reports: ground_on_foot}
"""


@pytest.fixture
def shoe(tmp_path) -> ShoeSensors:
    path = tmp_path / "shoe.yaml"
    path.write_text(SHOE)
    return load(path)


def readings(shoe: ShoeSensors, at_m: np.ndarray, force_n: np.ndarray, share: float) -> dict[str, np.ndarray]:
    """Return the readings of both sensors for a ground force at a point, of which the front sensor bears a fraction."""
    columns = {}
    for name, part in (("front", share), ("rear", 1 - share)):
        sensor = getattr(shoe, name)
        origin = np.array([sensor.x_mm, sensor.y_mm, sensor.z_mm]) / 1000
        force = part * force_n
        moment = np.cross(at_m - origin, force)
        sign = 1 if sensor.reports == "ground_on_foot" else -1
        sensor_axes = np.concatenate([sensor.rotation().T @ force, sensor.rotation().T @ moment]) * sign
        for axis, value in zip(("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"), sensor_axes, strict=True):
            columns[f"{name}_{axis}"] = np.array([value])
    return columns


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_a_point_force_gives_moments_about_the_insole_origin(shoe, share):
    at_m, force_n = np.array([0.12, -0.02, 0.0]), np.array([30.0, -10.0, 700.0])
    wrench = shoe.wrench(readings(shoe, at_m, force_n, share))
    assert wrench["fz_n"][0] == pytest.approx(700)
    assert wrench["mx_nm"][0] == pytest.approx(-0.02 * 700), "m_x = y f_z"
    assert wrench["my_nm"][0] == pytest.approx(-0.12 * 700), "m_y = -x f_z"


def test_a_rotation_is_roll_then_pitch_then_yaw(shoe):
    turned = shoe.front.rotation() @ [1, 0, 0]
    np.testing.assert_allclose(turned, [np.cos(np.pi / 6), np.sin(np.pi / 6), 0], atol=1e-12)
    np.testing.assert_allclose(shoe.front.rotation() @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    assert np.linalg.det(shoe.front.rotation()) == pytest.approx(1)


def test_all_problems_of_a_shoe_file_are_reported(tmp_path):
    path = tmp_path / "shoe.yaml"
    path.write_text(SHOE.replace("x_mm: 190", "x_m: 0.19").replace("ground_on_foot", "up").replace("foot: left\n", ""))
    with pytest.raises(DocumentError) as caught:
        load(path)
    message = str(caught.value)
    assert 'x_m: unknown key: did you mean "x_mm"? The unit is part of the name' in message
    assert "reports: expected one of ground_on_foot, foot_on_ground" in message
    assert "foot: missing key" in message


def test_two_sensors_are_combined_into_one_wrench_and_kept_as_columns(shoe):
    instrument = Instrument("left", "shoe", shoe)
    assert instrument.take_line("time_s," + ",".join(COLUMNS), 9.0) == ""
    sensor_readings = readings(shoe, np.array([0.1, 0.01, 0]), np.array([0, 0, 500.0]), 0.5)
    row = instrument.take_line("1.5," + ",".join(str(sensor_readings[name][0]) for name in COLUMNS), 9.25)
    names, cells = instrument.header.strip().split(","), row.strip().split(",")
    values = dict(zip(names, map(float, cells), strict=True))
    assert instrument.clock == "own"
    assert names[:4] == ["time_s", "fz_n", "mx_nm", "my_nm"]
    assert (values["time_s"], values["received_s"]) == (1.5, 9.25)
    assert (values["fz_n"], values["mx_nm"], values["my_nm"]) == pytest.approx((500, 5, -50))
    assert values["front_fx_n"] == pytest.approx(sensor_readings["front_fx_n"][0], abs=1e-6)


def test_a_bad_line_is_counted_and_the_recording_continues():
    instrument = Instrument("right", "bench")
    instrument.take_line("reference,note", 1.0)
    assert instrument.clock == "can"
    assert instrument.take_line("1,2,3", 2.0) == ""
    assert instrument.take_line("one,2", 2.0) == ""
    assert instrument.take_line("inf,2", 2.0) == ""
    assert instrument.take_line("", 2.0) == ""
    assert instrument.take_line("1,", 2.0) == "2.000000,1,\n"
    assert (instrument.readings, instrument.refused) == (1, 3)


def test_json_messages_of_an_instrument_become_rows():
    instrument = Instrument("left", "chamber")
    assert instrument.take_json(b"[1]", 1.0) == ""
    assert instrument.take_json(json.dumps({"pressure_pa": 5, "time_s": 3}).encode(), 1.0) == "3.000000,5,1.000000\n"
    assert instrument.take_json(json.dumps({"pressure_pa": None, "time_s": 4}).encode(), 1.5) == "4.000000,,1.500000\n"
    assert instrument.take_json(json.dumps({"pressure_pa": 5}).encode(), 1.0) == ""
    assert instrument.refused == 2


def test_an_instrument_of_another_kind_or_foot_is_refused(shoe):
    with pytest.raises(InsoleError, match="missing: fz_n, mx_nm, my_nm"):
        Instrument("left", "shoe").take_line("time_s,pressure_pa", 0.0)
    with pytest.raises(InsoleError, match="missing: front_fx_n"):
        Instrument("left", "shoe", shoe).take_line("time_s,fz_n,mx_nm,my_nm", 0.0)
    with pytest.raises(InsoleError, match="expected the shoe of the right foot, found that of the left foot"):
        Instrument("right", "shoe", shoe)
