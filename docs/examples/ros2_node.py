"""Wrench and CoP of both feet as ROS 2 topics, where a ROS 2 environment is sourced: ros2_node.py [ENDPOINT]."""

import contextlib
import itertools
import math
import sys
import threading

import rclpy
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException

import insole_daemon

FEET = ("left", "right")
NOT_MEASURED = math.nan  # shear, and the moment about z; RViz hides a wrench with NaN in it: for that, make it 0.0


class InsoleNode:
    """Publishes what comes from the daemon with the publishers of `node`; axes and units are ROS's already."""

    def __init__(self, node):
        # 10 and not best effort: subscribers that ask for reliable delivery, as most do, would not match.
        self.wrench = {foot: node.create_publisher(WrenchStamped, f"insole/{foot}/wrench", 10) for foot in FEET}
        self.cop = {foot: node.create_publisher(PointStamped, f"insole/{foot}/cop", 10) for foot in FEET}
        self.log = node.get_logger()

    def relay(self, wrenches):
        """Publish until the connection is closed; should it break, the node ends too."""
        try:
            for wrench in itertools.takewhile(lambda _: rclpy.ok(), wrenches):
                self.publish(wrench)
        finally:
            rclpy.try_shutdown()

    def publish(self, wrench):
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


def stamped(message, wrench):
    """`message` with the time of its newest reading, in the frame of its foot."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(wrench.t_ns, 1_000_000_000)
    message.header.frame_id = f"insole_{wrench.foot}"
    return message


if __name__ == "__main__":
    rclpy.init()
    ros = rclpy.create_node("insole")
    with insole_daemon.connect(*sys.argv[1:]) as insole:
        threading.Thread(target=InsoleNode(ros).relay, args=[insole.wrenches()]).start()
        with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
            rclpy.spin(ros)
