"""The ROS 2 node against a real daemon. There is no ROS here: what it publishes with is a stand-in, and says so."""

from __future__ import annotations

import importlib.util
import json
import math
import signal
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from processes import EXAMPLES, STAND_IN, path_with, python, run_to_end

import insole_daemon
from insole_daemon.errors import WireError
from insole_daemon.skin.geometry import PRESSURE_TAXELS

ROS2 = STAND_IN / "ros2"


def test_both_feet_are_published(daemon):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        sent, sent_pressures = insole.wrenches(), insole.pressures()
        with python(EXAMPLES / "ros2_node.py", daemon.endpoint, PYTHONPATH=path_with(ROS2)) as lines:
            published = [json.loads(line) for line in lines.take(500)]
            lines.process.send_signal(signal.SIGTERM)
            assert lines.process.wait() == 0, "SIGTERM ends the node with status 0"
        insole.close()
        by_stamp = {(wrench.foot, wrench.t_ns): wrench for wrench in sent}
        pressures = {(pressure.foot, pressure.t_ns): pressure for pressure in sent_pressures}

    assert all(line["stand_in"] for line in published)
    assert {(line["topic"], line["type"]) for line in published} == {
        (f"insole/{foot}/{what}", kind)
        for foot in ("left", "right")
        for what, kind in (("wrench", "WrenchStamped"), ("cop", "PointStamped"), ("pressure", "PointCloud2"))
    }
    for line in published:
        foot, message = line["topic"].split("/")[1], line["message"]
        assert message["header"]["frame_id"] == f"insole_{foot}"
        stamp = message["header"]["stamp"]
        if line["type"] == "PointCloud2":
            values = np.frombuffer(bytes(message["data"]), "<f4").reshape(message["width"], 4)
            pressure = pressures[foot, stamp["sec"] * 10**9 + stamp["nanosec"]]
            known = pressure.valid.astype(bool)[:, PRESSURE_TAXELS].ravel()
            assert known.any()
            np.testing.assert_array_equal(values[known, 3], pressure.pressure_pa[:, PRESSURE_TAXELS].ravel()[known])
            assert np.isnan(values[~known, 3]).all()
            continue
        wrench = by_stamp[foot, stamp["sec"] * 10**9 + stamp["nanosec"]]
        if line["type"] == "PointStamped":
            assert message["point"] == {"x": wrench.cop_x_m, "y": wrench.cop_y_m, "z": 0}
            continue
        force, torque = message["wrench"]["force"], message["wrench"]["torque"]
        assert (force["z"], torque["x"], torque["y"]) == (wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm)
        assert all(math.isnan(value) for value in (force["x"], force["y"], torque["z"]))


def test_without_an_answering_daemon_it_ends_with_one_message(endpoint):
    status, (_, message) = run_to_end("ros2_node.py", endpoint, PYTHONPATH=path_with(ROS2))
    assert status == 1
    assert message.startswith(f"ros2_node: nobody answers on {endpoint}. Start the daemon")


@pytest.fixture
def node(monkeypatch):
    """The node of the example in this process, and the list of (topic, message) it publishes to a stand-in."""
    monkeypatch.syspath_prepend(ROS2)
    published = []

    def create_publisher(kind, topic, qos_profile):
        def publish(message):
            assert type(message) is kind
            published.append((topic, message))

        return SimpleNamespace(publish=publish)

    logger = SimpleNamespace(
        warning=lambda text: published.append(("warning", text)), error=lambda text: published.append(("error", text))
    )
    spec = importlib.util.spec_from_file_location("ros2_node", EXAMPLES / "ros2_node.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    stand_in = SimpleNamespace(create_publisher=create_publisher, get_logger=lambda: logger)
    yield module.InsoleNode(stand_in), published
    for name in [name for name in sys.modules if name.partition(".")[0] in ("rclpy", "geometry_msgs", "sensor_msgs")]:
        del sys.modules[name]


def wrench(**fields):
    usual = {"f_z_n": 1, "m_x_nm": 2, "m_y_nm": 3, "cop_x_m": 0, "cop_y_m": 0}
    return SimpleNamespace(**{"foot": "left", "t_ns": 1_700_000_000_999_999_999, "lost": 0} | usual | fields)


def test_an_unknown_force_is_nan_and_never_0(node):
    node, published = node
    node.publish_wrench(wrench(f_z_n=None, m_x_nm=None, m_y_nm=None, cop_x_m=None, cop_y_m=None))
    ((topic, message),) = published
    assert topic == "insole/left/wrench"
    assert all(math.isnan(value) for part in message.wrench.as_dict().values() for value in part.values())
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 999_999_999)


def test_a_whole_number_is_made_the_float_that_ros_wants(node):
    node, published = node
    node.publish_wrench(wrench())
    assert [topic for topic, _ in published] == ["insole/left/wrench", "insole/left/cop"]
    assert published[0][1].wrench.force.z == 1


def test_a_connection_that_breaks_is_logged_as_one_message(node):
    node, published = node

    def cycles():
        yield (wrench(cop_x_m=None),)
        raise WireError("no daemon has the left foot")

    node.relay(cycles(), node.publish_wrench)
    assert [topic for topic, _ in published] == ["insole/left/wrench", "error"]
    assert published[1] == ("error", "no daemon has the left foot")


def test_lost_cycles_are_reported(node):
    node, published = node
    node.publish_wrench(wrench(lost=3))
    assert published[0] == ("warning", "3 cycles of the left foot did not arrive")


def test_pressure_is_a_point_cloud_in_the_frame_of_the_foot_and_nan_where_it_is_not_valid(node):
    node, published = node
    xy_m = np.arange(48, dtype=np.float32).reshape(2, 12, 2) / 100
    pressure_pa = np.arange(24, dtype=np.float32).reshape(2, 12) * 1000
    valid = np.ones((2, 12), np.uint8)
    valid[1, 3] = 0
    node.publish_pressure(
        SimpleNamespace(foot="right", t_ns=5_000_000_007, n_triangles=2, pressure_pa=pressure_pa, valid=valid), xy_m
    )
    ((topic, cloud),) = published
    assert (topic, cloud.header.frame_id) == ("insole/right/pressure", "insole_right")
    assert (cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (5, 7)
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 20, 16, 320)
    offsets = {field.name: field.offset for field in cloud.fields}
    assert offsets == {"x": 0, "y": 4, "z": 8, "pressure_pa": 12}
    points = np.frombuffer(cloud.data, "<f4").reshape(20, 4)
    np.testing.assert_array_equal(points[:, :2], xy_m[:, PRESSURE_TAXELS].reshape(-1, 2))
    assert (points[:, 2] == 0).all()
    unknown = 10 + int(np.count_nonzero(PRESSURE_TAXELS[:3]))  # thermal pads are left out
    assert np.flatnonzero(np.isnan(points[:, 3])).tolist() == [unknown]
    assert points[1, 3] == 1000
    assert not cloud.is_dense
