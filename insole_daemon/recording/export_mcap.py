"""Export a recording as one MCAP file, to view in Foxglove and PlotJuggler and to replay.

| topic                  | schema                   | content |
|------------------------|--------------------------|---------|
| /insole/left/wrench    | insole.wrench            | every cycle, if there is a calibration |
| /insole/left/health    | insole.recorded_health   | once a second |
| /insole/left/event     | insole.event             | a board begins to send, or falls silent |
| /insole/left/reference | insole.reference.left    | every reading that has a time |
| /insole/left/step      | insole.step              | every stance, at its toe-off: label and figures |
| /insole/left/pressure  | foxglove.PointCloud      | every cycle: position and pressure_pa of the pressure taxels |
| /insole/log            | foxglove.Log             | every stance in words |
| /tf                    | foxglove.FrameTransforms | once: where the feet are drawn (not measured) |

Messages are JSON with a JSON schema (encoding `jsonschema`, as Foxglove requires); Foxglove's own schemas are protobuf.
Unknown values are left out, since readers of these files do not accept null for a number. The recording's files are
attached byte for byte, except that the log is compressed, so `insole import` restores the recording.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..files import unfinished
from ..mechanics.gait.steps import Steps
from .bundle import bundle_files
from .derived_messages import derive_events, derive_health
from .foxglove import encode_foot_frames, encode_log, encode_pressure, register_channel
from .instrument import RECEIVED
from .lab import need
from .loading import FootRecording, Recording

METADATA = "insole-recording"
_MEDIA = {".yaml": "application/yaml", ".json": "application/json", ".csv": "text/csv", ".gz": "application/gzip"}
_NUMBER, _TEXT, _WHOLE = {"type": "number"}, {"type": "string"}, {"type": "integer"}
_WRENCH = ("f_z_n", "m_x_nm", "m_y_nm", "cop_x_m", "cop_y_m", "f_z_std_n", "m_x_std_nm", "m_y_std_nm",
           "contact_area_m2", "valid_fraction")  # fmt: skip
_PROPERTIES: Mapping[str, dict[str, Any]] = {
    "wrench": dict.fromkeys(_WRENCH, _NUMBER) | {"repeated": {"type": "boolean"}},
    "health": {
        "state": _TEXT,
        "publish_rate_hz": _NUMBER,
        "late": _WHOLE,
        "repeated": _WHOLE,
        "valid_fraction": _NUMBER,
        "boards": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {"address": _WHOLE, "state": _TEXT, "change_rate_hz": _NUMBER, "missing": _WHOLE},
            },
        },
    },
    "event": {"kind": _TEXT, "text": _TEXT, "boards": {"type": "array", "items": _WHOLE}},
}
_SCHEMAS = {
    "wrench": "insole.wrench",
    "health": "insole.recorded_health",
    "event": "insole.event",
    "step": "insole.step",
}

_MESSAGES_PER_REPORT = 1000  # messages between two calls of `progress`
_PREPARED, _WRITTEN = 0.2, 0.6  # fractions of the time at which messages are prepared and written; the log follows

Messages = Iterator[tuple[int, dict[str, Any]]]


def export_mcap(recording: Recording, out: Path, progress: Callable[[float], None] = lambda share: None) -> None:
    """Write `out`, all or nothing; InsoleError if the package mcap is not installed, OSError if writing fails.

    `progress` is called with the fraction written.
    """
    writer_module = need("mcap.writer", "mcap", "exporting MCAP")
    with unfinished(out) as temporary, open(temporary, "wb") as file:
        writer = writer_module.Writer(file)
        writer.start(profile="", library="insole-daemon")
        start_ns = min((int(foot.t_ns[0]) for foot in recording.feet if len(foot)), default=0)
        written: list[tuple[int, int, bytes]] = []
        for foot in recording.feet:
            for what, messages in _json_channels(foot, recording.steps):
                channel = _register_channel(writer, foot, what, recording.steps)
                written += [(t_ns, channel, _encode_json(message)) for t_ns, message in messages]
        streams: list[Iterator[tuple[int, int, bytes]]] = [iter(sorted(written, key=lambda entry: entry[0]))]
        if any(foot.wrench is not None for foot in recording.feet):
            streams += _foxglove_streams(writer, recording, start_ns)
        span_ns = max((int(foot.t_ns[-1]) for foot in recording.feet if len(foot)), default=1) - start_ns
        for sequence, (t_ns, channel, data) in enumerate(heapq.merge(*streams, key=lambda entry: entry[0])):
            if sequence % _MESSAGES_PER_REPORT == 0:
                progress(_PREPARED + (_WRITTEN - _PREPARED) * min(1.0, (t_ns - start_ns) / max(span_ns, 1)))
            writer.add_message(channel, log_time=t_ns, publish_time=t_ns, data=data, sequence=sequence)
        for name, content in bundle_files(recording).items():
            media = _MEDIA.get(Path(name).suffix, "application/octet-stream")
            writer.add_attachment(start_ns, start_ns, name, media, content)
        writer.add_metadata(METADATA, _metadata(recording))
        writer.finish()


def _foxglove_streams(writer: Any, recording: Recording, start_ns: int) -> list[Iterator[tuple[int, int, bytes]]]:
    """Return pressure, log and frames in Foxglove's schemas as (t_ns, channel, data), each stream in order of time."""
    known = [foot for foot in recording.feet if foot.wrench is not None]
    streams = [
        _tag_with_channel(
            register_channel(writer, "FrameTransforms", "/tf"), iter([(start_ns, encode_foot_frames(start_ns))])
        )
    ]
    streams.append(_tag_with_channel(register_channel(writer, "Log", "/insole/log"), encode_log(recording.steps)))
    for foot in known:
        channel = register_channel(writer, "PointCloud", f"/insole/{foot.foot}/pressure")
        streams.append(_tag_with_channel(channel, encode_pressure(foot)))
    return streams


def _tag_with_channel(channel: int, messages: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, int, bytes]]:
    return ((t_ns, channel, data) for t_ns, data in messages)


def _step_messages(foot: FootRecording, steps: Steps) -> Messages:
    steps_of_foot = steps.of(foot.foot)
    columns = {name: column.tolist() for name, column in steps_of_foot.columns.items() if name != "foot"}
    for row, t_ns in enumerate(steps_of_foot.known_ns.tolist()):
        yield t_ns, {name: column[row] for name, column in columns.items()}


def _json_channels(foot: FootRecording, steps: Steps) -> list[tuple[str, Messages]]:
    channels: list[tuple[str, Messages]] = [("health", derive_health(foot)), ("event", derive_events(foot))]
    if foot.wrench is not None:
        channels.append(("wrench", _wrench_messages(foot)))
        channels.append(("step", _step_messages(foot, steps)))
    if foot.reference is not None and foot.reference.time_s is not None:
        channels.append(("reference", _reference_messages(foot)))
    return channels


def _step_properties(steps: Steps) -> dict[str, Any]:
    types: dict[str, Any] = {"label": _TEXT, "number": _WHOLE}
    return {name: types.get(name, _NUMBER) for name in steps.columns if name != "foot"}


def _register_channel(writer: Any, foot: FootRecording, what: str, steps: Steps) -> int:
    """Register the channel of one foot and kind of message with its JSON schema, and return its number."""
    if what == "reference":
        assert foot.reference is not None
        properties: dict[str, Any] = dict.fromkeys(foot.reference.columns, _NUMBER)
        name = f"insole.reference.{foot.foot}"
    else:
        properties, name = dict(_PROPERTIES.get(what) or _step_properties(steps)), _SCHEMAS[what]
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": name, "type": "object",
              "properties": properties}  # fmt: skip
    schema_id = writer.register_schema(name=name, encoding="jsonschema", data=json.dumps(schema).encode())
    channel: int = writer.register_channel(
        topic=f"/insole/{foot.foot}/{what}", message_encoding="json", schema_id=schema_id
    )
    return channel


def _wrench_messages(foot: FootRecording) -> Messages:
    assert foot.wrench is not None
    columns = {name: getattr(foot.wrench, name).tolist() for name in _WRENCH}
    for row, (t_ns, repeated) in enumerate(zip(foot.t_ns.tolist(), foot.repeated.tolist(), strict=True)):
        yield t_ns, {name: column[row] for name, column in columns.items()} | {"repeated": repeated}


def _reference_messages(foot: FootRecording) -> Messages:
    """Yield the reference on the clock of the frames.

    Uses its own times if they are on that clock, else the times of arrival, else times as if it had begun with the
    first cycle.
    """
    reference = foot.reference
    assert reference is not None
    assert reference.time_s is not None
    time_s = reference.time_s
    if reference.clock == "own":
        if RECEIVED in reference.columns:
            time_s = reference[RECEIVED]
        elif len(time_s) and len(foot):
            time_s = time_s - time_s[0] + foot.t_ns[0] * 1e-9
    t_ns = (np.round(time_s * 1e6).astype(np.int64) * 1000).tolist()
    columns = {name: column.tolist() for name, column in reference.columns.items()}
    for row, moment_ns in enumerate(t_ns):
        yield moment_ns, {name: column[row] for name, column in columns.items()}


def _metadata(recording: Recording) -> dict[str, str]:
    """Return the recording's kind and origin, and how the times of each reference are to be understood."""
    entries = {"kind": recording.kind, "can_origin": recording.can_origin, "invented": "; ".join(recording.invented)}
    for foot in recording.feet:
        reference = foot.reference
        if reference is None:
            continue
        key = f"{foot.foot}_reference_clock"
        if reference.time_s is None:
            entries[key] = "unknown: no times, so no channel; the readings are in the attachment"
        elif reference.clock == "can":
            entries[key] = "that of the frames"
        elif RECEIVED in reference.columns:
            entries[key] = f"its own; messages lie where they arrived ({RECEIVED})"
        else:
            entries[key] = "its own; messages lie as if it had begun with the first cycle, the true offset is not known"
    return entries


def _encode_json(message: Mapping[str, Any]) -> bytes:
    known = {name: value for name, value in message.items() if not (isinstance(value, float) and math.isnan(value))}
    return json.dumps(known, ensure_ascii=False, separators=(",", ":")).encode()
