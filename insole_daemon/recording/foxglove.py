"""Encode pressure, steps and frames as messages of Foxglove's published schemas (package foxglove-schemas-protobuf).

The file contains the published descriptors, so any program that knows `foxglove.PointCloud` can draw the pressure.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..mechanics.gait.steps import Steps
from ..skin.geometry import PRESSURE_TAXELS
from .lab import need
from .loading import FootRecording

LAYOUT = Path(__file__).with_name("foxglove-layout.json")  # panels for pressure, force, steps and log
ROOM = "insoles"  # root frame of both feet
APART_M = 0.12  # drawn distance between the feet; their real positions are not measured
_FLOAT32 = 7  # foxglove.PackedElementField.NumericType


def register_channel(writer: Any, schema: str, topic: str) -> int:
    """Register a channel for messages of foxglove.`schema`, and return its number."""
    build_descriptors = need(
        "mcap_protobuf.schema", "mcap-protobuf-support", "exporting MCAP"
    ).build_file_descriptor_set
    descriptors = build_descriptors(_message_class(schema)).SerializeToString()
    number = writer.register_schema(name=f"foxglove.{schema}", encoding="protobuf", data=descriptors)
    channel: int = writer.register_channel(topic=topic, message_encoding="protobuf", schema_id=number)
    return channel


def encode_pressure(foot: FootRecording) -> Iterator[tuple[int, bytes]]:
    """Yield (t_ns, foxglove.PointCloud) for every cycle, with the pressure taxels in the foot's frame."""
    assert foot.pressure_pa is not None
    cloud_type, field_type = _message_class("PointCloud"), _message_class("PackedElementField")
    xy_m = foot.layout.xy_m[:, PRESSURE_TAXELS].reshape(-1, 2)
    points = np.zeros((len(xy_m), 4), "<f4")
    points[:, :2] = xy_m
    fields = [
        field_type(name=name, offset=4 * index, type=_FLOAT32)
        for index, name in enumerate(("x", "y", "z", "pressure_pa"))
    ]
    pressure = np.where(foot.valid, foot.pressure_pa, np.nan)[:, :, PRESSURE_TAXELS].reshape(len(foot), -1)
    for t_ns, pressure_pa in zip(foot.t_ns.tolist(), pressure, strict=True):
        points[:, 3] = pressure_pa
        cloud = cloud_type(frame_id=_frame_id(foot.foot), point_stride=16, fields=fields, data=points.tobytes())
        cloud.timestamp.FromNanoseconds(t_ns)
        cloud.pose.orientation.w = 1.0
        yield t_ns, cloud.SerializeToString()


def encode_foot_frames(t_ns: int) -> bytes:
    """Return foxglove.FrameTransforms that place both feet side by side, toes up."""
    frames = _message_class("FrameTransforms")()
    for foot, side in (("left", 1.0), ("right", -1.0)):
        transform = frames.transforms.add(parent_frame_id=ROOM, child_frame_id=_frame_id(foot))
        transform.timestamp.FromNanoseconds(t_ns)
        transform.translation.y = side * APART_M / 2
        transform.rotation.w = 1.0
    data: bytes = frames.SerializeToString()
    return data


def encode_log(steps: Steps) -> Iterator[tuple[int, bytes]]:
    """Yield (t_ns, foxglove.Log) for every stance in order of time; a step that is not steady is a warning."""
    log_type = _message_class("Log")
    for row in np.argsort(steps.known_ns, kind="stable").tolist():
        foot, label = str(steps["foot"][row]), str(steps["label"][row])
        log = log_type(name=f"{foot} foot", level=log_type.INFO if label == "steady" else log_type.WARNING)
        log.message = (
            f"{label} step {int(steps['number'][row])}: stance {steps['stance_s'][row]:.3f} s, "
            f"peak {steps['peak_force_n'][row]:.0f} N"
        )
        t_ns = int(steps.known_ns[row])
        log.timestamp.FromNanoseconds(t_ns)
        yield t_ns, log.SerializeToString()


def _message_class(schema: str) -> Any:
    """Return the class of foxglove.`schema`."""
    module = f"foxglove_schemas_protobuf.{schema}_pb2"
    return getattr(need(module, "foxglove-schemas-protobuf", "exporting MCAP"), schema)


def _frame_id(foot: str) -> str:
    return f"insole_{foot}"
