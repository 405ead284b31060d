"""A stand-in, not ROS 2: what is published is written to standard output, one line of JSON a message.

It has what docs/examples/ros2_node.py uses, and is as strict about types as the generated messages of ROS 2 are.
"""

import json
import signal
import sys
import threading

from .executors import ExternalShutdownException

_ended = threading.Event()
_writing = threading.Lock()


class Publisher:
    def __init__(self, kind, topic):
        self.kind, self.topic = kind, topic

    def publish(self, message):
        assert type(message) is self.kind
        line = {"topic": self.topic, "type": self.kind.__name__, "message": message.as_dict(), "stand_in": True}
        with _writing:  # two threads publish
            sys.stdout.write(json.dumps(line) + "\n")
            sys.stdout.flush()


class Logger:
    def warning(self, text):
        print(f"a stand-in for ROS 2: warning: {text}", file=sys.stderr, flush=True)

    def error(self, text):
        print(f"a stand-in for ROS 2: error: {text}", file=sys.stderr, flush=True)


class Node:
    def __init__(self, name):
        self.name = name

    def create_publisher(self, kind, topic, qos_profile):
        assert isinstance(qos_profile, int)
        return Publisher(kind, topic)

    def get_logger(self):
        return Logger()


def init():
    print("a stand-in for ROS 2: nothing here reaches a ROS graph", file=sys.stderr, flush=True)
    signal.signal(signal.SIGTERM, lambda *_: try_shutdown())  # as rclpy does; it leaves SIGINT a KeyboardInterrupt


def create_node(name):
    return Node(name)


def spin_once(node, *, timeout_sec):
    if _ended.wait(timeout_sec):
        raise ExternalShutdownException


def ok():
    return not _ended.is_set()


def try_shutdown():
    _ended.set()
