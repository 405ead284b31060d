"""Wrench, CoP and pressure of both feet as ROS 2 topics; needs a sourced ROS 2: ros2_node.py [ENDPOINT]."""

import contextlib
import functools
import itertools
import math
import sys
import threading

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import PointCloud2, PointField

import insole_daemon
from insole_daemon.errors import InsoleError
from insole_daemon.skin.geometry import PRESSURE_TAXELS

FEET = ("left", "right")
NOT_MEASURED = math.nan  # shear, and the moment about z; RViz hides a wrench with NaN in it: for that, make it 0.0
POINT_FIELDS = ("x", "y", "z", "pressure_pa")  # float32 each


class InsoleNode:
    """Publishes what comes from the daemon with the publishers of `node`; axes and units are ROS's already."""

    def __init__(self, node):
        # 10 and not best effort: subscribers that ask for reliable delivery, as most do, would not match.
        self.wrench = {foot: node.create_publisher(WrenchStamped, f"insole/{foot}/wrench", 10) for foot in FEET}
        self.cop = {foot: node.create_publisher(PointStamped, f"insole/{foot}/cop", 10) for foot in FEET}
        self.pressure = {foot: node.create_publisher(PointCloud2, f"insole/{foot}/pressure", 10) for foot in FEET}
        self.log = node.get_logger()

    def relay(self, cycles, publish):
        """Publish each of `cycles`, a tuple, until the connection is closed; should it break, the node ends too."""
        try:
            for cycle in itertools.takewhile(lambda _: rclpy.ok(), cycles):
                publish(*cycle)
        except InsoleError as error:
            self.log.error(str(error))
        finally:
            rclpy.try_shutdown()

    def publish_wrench(self, wrench):
        """Every cycle, and a repeat with the stamp of what it repeats. A force that is not known is NaN, not 0."""
        if wrench.lost:
            self.log.warning(f"{wrench.lost} cycles of the {wrench.foot} foot did not arrive")
        loads = (math.nan if load is None else float(load) for load in (wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm))
        message = stamped(WrenchStamped(), wrench)
        force, torque = message.wrench.force, message.wrench.torque
        force.z, torque.x, torque.y = loads
        force.x = force.y = torque.z = NOT_MEASURED
        self.wrench[wrench.foot].publish(message)
        if wrench.cop_x_m is not None:  # without contact there is no such point
            message = stamped(PointStamped(), wrench)
            message.point.x, message.point.y = float(wrench.cop_x_m), float(wrench.cop_y_m)
            self.cop[wrench.foot].publish(message)

    def publish_pressure(self, pressure, xy_m):
        """A point a pressure taxel, which lies at `xy_m` (n_triangles, 12, 2). A pressure that is not valid is NaN."""
        points = np.zeros((pressure.n_triangles * int(PRESSURE_TAXELS.sum()), len(POINT_FIELDS)), "<f4")
        points[:, :2] = xy_m[:, PRESSURE_TAXELS].reshape(-1, 2)
        points[:, 3] = np.where(pressure.valid, pressure.pressure_pa, np.nan)[:, PRESSURE_TAXELS].ravel()
        message = stamped(PointCloud2(), pressure)
        message.height, message.width = 1, len(points)
        for at, name in enumerate(POINT_FIELDS):
            field = PointField()
            field.name, field.offset, field.datatype, field.count = name, 4 * at, PointField.FLOAT32, 1
            message.fields.append(field)
        message.point_step, message.row_step = points.strides[0], points.nbytes
        message.is_bigendian, message.is_dense = False, bool(np.isfinite(points).all())
        message.data = points.tobytes()
        self.pressure[pressure.foot].publish(message)


def stamped(message, cycle):
    """`message` with the time of the newest reading of `cycle`, in the frame of its foot."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(cycle.t_ns, 1_000_000_000)
    message.header.frame_id = f"insole_{cycle.foot}"
    return message


def place_pressures(insole):
    """Each pressure message with the places of its taxels; a daemon that was restarted may have another layout."""
    meta = functools.cache(lambda foot, started_ns: insole.meta(foot))
    return ((pressure, meta(pressure.foot, pressure.started_ns).xy_m) for pressure in insole.pressures())


def main(*endpoint):
    """Publish until Ctrl-C, SIGTERM or a shutdown of ROS."""
    rclpy.init()
    ros = rclpy.create_node("insole")
    with insole_daemon.connect(*endpoint) as insole:
        node = InsoleNode(ros)
        threading.Thread(target=node.relay, args=[zip(insole.wrenches(), strict=True), node.publish_wrench]).start()
        threading.Thread(target=node.relay, args=[place_pressures(insole), node.publish_pressure]).start()
        with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
            while rclpy.ok():  # and not spin(): a shutdown by another thread does not always wake it
                rclpy.spin_once(ros, timeout_sec=0.5)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except InsoleError as error:
        sys.exit(f"ros2_node: {error}")
