"""The ROS 2 node against a real daemon. There is no ROS here: what it publishes with is a stand-in, and says so."""

from __future__ import annotations

import importlib.util
import json
import math
import signal
import sys
from types import SimpleNamespace

import pytest
from processes import EXAMPLES, STAND_IN, path_with, python

import insole_daemon

ROS2 = STAND_IN / "ros2"


def test_both_feet_are_published(daemon):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        sent = insole.wrenches()
        with python(EXAMPLES / "ros2_node.py", daemon.endpoint, PYTHONPATH=path_with(ROS2)) as lines:
            published = [json.loads(line) for line in lines.take(500)]
            lines.process.send_signal(signal.SIGTERM)
            assert lines.process.wait(10) == 0, "a node that is told to end does"
        insole.close()
        by_stamp = {(wrench.foot, wrench.t_ns): wrench for wrench in sent}

    assert all(line["stand_in"] for line in published)
    assert {(line["topic"], line["type"]) for line in published} == {
        (f"insole/{foot}/{what}", kind)
        for foot in ("left", "right")
        for what, kind in (("wrench", "WrenchStamped"), ("cop", "PointStamped"))
    }
    for line in published:
        foot, message = line["topic"].split("/")[1], line["message"]
        assert message["header"]["frame_id"] == f"insole_{foot}"
        stamp = message["header"]["stamp"]
        wrench = by_stamp[foot, stamp["sec"] * 10**9 + stamp["nanosec"]]
        if line["type"] == "PointStamped":
            assert message["point"] == {"x": wrench.cop_x_m, "y": wrench.cop_y_m, "z": 0}
            continue
        force, torque = message["wrench"]["force"], message["wrench"]["torque"]
        assert (force["z"], torque["x"], torque["y"]) == (wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm)
        assert all(math.isnan(value) for value in (force["x"], force["y"], torque["z"]))


def test_it_ends_with_an_error_shown_where_nobody_answers(endpoint):
    with python(EXAMPLES / "ros2_node.py", endpoint, PYTHONPATH=path_with(ROS2)) as lines:
        assert lines.process.wait(20) == 1


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

    logger = SimpleNamespace(warning=lambda text: published.append(("warning", text)))
    spec = importlib.util.spec_from_file_location("ros2_node", EXAMPLES / "ros2_node.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    stand_in = SimpleNamespace(create_publisher=create_publisher, get_logger=lambda: logger)
    yield module.InsoleNode(stand_in), published
    for name in [name for name in sys.modules if name.partition(".")[0] in ("rclpy", "geometry_msgs")]:
        del sys.modules[name]


def wrench(**fields):
    usual = {"f_z_n": 1, "m_x_nm": 2, "m_y_nm": 3, "cop_x_m": 0, "cop_y_m": 0}
    return SimpleNamespace(**{"foot": "left", "t_ns": 1_700_000_000_999_999_999, "lost": 0} | usual | fields)


def test_an_unknown_force_is_nan_and_never_0(node):
    node, published = node
    node.publish(wrench(f_z_n=None, m_x_nm=None, m_y_nm=None, cop_x_m=None, cop_y_m=None))
    ((topic, message),) = published
    assert topic == "insole/left/wrench"
    assert all(math.isnan(value) for part in message.wrench.as_dict().values() for value in part.values())
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 999_999_999)


def test_a_whole_number_is_made_the_float_that_ros_wants(node):
    node, published = node
    node.publish(wrench())
    assert [topic for topic, _ in published] == ["insole/left/wrench", "insole/left/cop"]
    assert published[0][1].wrench.force.z == 1


def test_lost_cycles_are_said(node):
    node, published = node
    node.publish(wrench(lost=3))
    assert published[0] == ("warning", "3 cycles of the left foot did not arrive")
