"""Part of the stand-in for ROS 2."""


class ExternalShutdownException(Exception):  # noqa: N818 - the name is rclpy's
    pass
