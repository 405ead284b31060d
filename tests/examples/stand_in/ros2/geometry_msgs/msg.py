"""Stand-ins for the messages that are used, with the fields and the type checks of those that ROS 2 generates."""


class Message:
    """Fields have the types of their defaults, and there are no others; that goes for numbers, too: 1 is no float."""

    def __init_subclass__(cls, **fields):
        cls.defaults = getattr(cls, "defaults", {}) | fields

    def __init__(self):
        for name, default in self.defaults.items():
            super().__setattr__(name, default() if isinstance(default, type) else default)

    def __setattr__(self, name, value):
        assert type(value) is type(getattr(self, name)), f"{name}: {value!r}"
        if name == "sec":
            assert -(2**31) <= value < 2**31
        if name == "nanosec":
            assert 0 <= value < 2**32
        super().__setattr__(name, value)

    def as_dict(self):
        values = {name: getattr(self, name) for name in self.defaults}
        return {name: plain(value) for name, value in values.items()}


def plain(value):
    """`value` as JSON has it: bytes as numbers."""
    if isinstance(value, list | bytes):
        return [plain(item) for item in value]
    return value.as_dict() if isinstance(value, Message) else value


class Time(Message, sec=0, nanosec=0):
    pass


class Header(Message, stamp=Time, frame_id=""):
    pass


class Vector3(Message, x=0.0, y=0.0, z=0.0):
    pass


class Point(Message, x=0.0, y=0.0, z=0.0):
    pass


class Wrench(Message, force=Vector3, torque=Vector3):
    pass


class WrenchStamped(Message, header=Header, wrench=Wrench):
    pass


class PointStamped(Message, header=Header, point=Point):
    pass
