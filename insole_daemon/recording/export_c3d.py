"""A recording as C3D, for motion capture: each insole as a force plate, its CoP as a point, contacts as events.

| group          | content |
|----------------|---------|
| ANALOG         | Fx Fy Fz Mx My Mz of each foot, N and N·mm: what the foot does to the insole |
| FORCE_PLATFORM | type 2, one plate a foot; x forward, y to the wearer's right, z down; the origin is the insole's |
| POINT          | the CoP of each foot in the insole's frame, mm; invalid where there is none |
| EVENT          | Foot Strike and Foot Off of every stance, with side and label; the 256th and later in LABELS2 … |
| INSOLE         | START_NS as text: epoch time of the first frame; RATE_HZ |

Shear and the moment about z are not measured: their channels are 0. Frames are uniform in time, as C3D wants them; the
cycles are interpolated linearly. The plate stands still in the insole's frame, since nobody measured where the foot is.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InsoleError
from ..files import unfinished
from .lab import need
from .loading import FootRecording, Recording

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
_MOST_FRAMES = 65_535  # that the header can count
_MOST_OF_PARAMETER = 255  # elements along an axis: their number is one byte
_MOST_BLOCKS = 255  # of parameters, all together
_MM = 1e3


def export_c3d(recording: Recording, out: Path) -> None:
    """Write `out`, all or nothing; InsoleError where no foot has a calibration."""
    c3d = need("c3d", "c3d", "exporting C3D")
    feet = [foot for foot in recording.feet if foot.wrench is not None and len(foot) > 1]
    if not feet:
        raise InsoleError(f"{recording.folder}: no foot has a calibration: C3D holds forces, and there are only counts")
    rate_hz, t_ns = _grid(feet)
    if len(t_ns) > _MOST_FRAMES:
        raise InsoleError(
            f"{recording.folder}: {len(t_ns)} frames, C3D holds at most {_MOST_FRAMES}: export it as MCAP or Parquet"
        )
    analog = np.concatenate([_plate(foot, t_ns) for foot in feet], axis=0)
    points = np.stack([_cop(foot, t_ns) for foot in feet], axis=1)
    writer = c3d.Writer(point_rate=rate_hz, analog_rate=rate_hz, point_units="mm")
    writer.set_point_labels([f"{foot.foot[0].upper()}COP" for foot in feet])
    writer.set_analog_labels([f"{foot.foot[0].upper()}_{axis}" for foot in feet for axis in AXES])
    writer.set_analog_scales(np.ones(len(analog)))
    writer.set_analog_offsets(np.zeros(len(analog), np.int16))
    for row in range(len(t_ns)):
        writer.add_frames([(points[row], analog[:, row : row + 1])])
    _force_platforms(writer, feet)
    _events(writer, recording, int(t_ns[0]))
    own = writer.add_group(_free_group(writer), "INSOLE", "of insole-daemon")
    _text(own, "START_NS", [str(int(t_ns[0]))])
    _array(own, "RATE_HZ", np.array([rate_hz], np.float32))
    if writer.parameter_blocks() > _MOST_BLOCKS:
        raise InsoleError(
            f"{recording.folder}: C3D has no room for {len(recording.steps)} steps: export it as MCAP or Parquet"
        )
    with unfinished(out) as beside, open(beside, "wb") as file:
        writer.write(file)


def _grid(feet: list[FootRecording]) -> tuple[float, NDArray[np.int64]]:
    """Frames a second, a whole number, and the moments that all feet cover."""
    intervals = np.concatenate([np.diff(foot.t_ns) for foot in feet])
    rate_hz = float(round(1e9 / float(np.median(intervals[intervals > 0]))))
    first, last = max(int(foot.t_ns.min()) for foot in feet), min(int(foot.t_ns.max()) for foot in feet)
    return rate_hz, first + (np.arange(max(1, int((last - first) * 1e-9 * rate_hz) + 1)) * 1e9 / rate_hz).astype(
        np.int64
    )


def _at(foot: FootRecording, t_ns: NDArray[np.int64], column: NDArray[np.float64]) -> NDArray[np.float64]:
    order = np.argsort(foot.t_ns, kind="stable")
    since = (foot.t_ns[order] - t_ns[0]).astype(np.float64)
    return np.asarray(np.interp((t_ns - t_ns[0]).astype(np.float64), since, column[order]))


def _plate(foot: FootRecording, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """(6, n) in the frame of the plate, whose y and z point the other way than the insole's."""
    wrench = foot.wrench
    assert wrench is not None
    f_z, m_x, m_y = (np.nan_to_num(_at(foot, t_ns, column)) for column in (wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm))
    none = np.zeros_like(f_z)
    return np.stack([none, none, f_z, -m_x * _MM, m_y * _MM, none])


def _cop(foot: FootRecording, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, 5): x, y, z in mm, residual (−1: no such point) and cameras."""
    wrench = foot.wrench
    assert wrench is not None
    found = np.zeros((len(t_ns), 5))
    for axis, column in enumerate((wrench.cop_x_m, wrench.cop_y_m)):
        found[:, axis] = _at(foot, t_ns, column) * _MM
    unknown = ~np.isfinite(found).all(axis=1)
    found[unknown] = (0, 0, 0, -1, 0)
    return found


def _force_platforms(writer: Any, feet: list[FootRecording]) -> None:
    group = writer.add_group(_free_group(writer), "FORCE_PLATFORM", "one plate a foot")
    n = len(feet)
    _array(group, "USED", np.int16(n))
    _array(group, "TYPE", np.full(n, 2, np.int16))
    _array(group, "ZERO", np.zeros(2, np.int16))
    corners = []
    for foot in feet:
        # Corner k lies in quadrant k of the plate's own axes: x forward, y to the right.
        low, high = foot.layout.xy_m.min(axis=(0, 1)) * _MM, foot.layout.xy_m.max(axis=(0, 1)) * _MM
        quadrants = [(high[0], low[1]), (low[0], low[1]), (low[0], high[1]), (high[0], high[1])]
        corners.append([(x, y, 0.0) for x, y in quadrants])
    _array(group, "CORNERS", np.array(corners, np.float32))
    # From where the moments are about to the centre of the plate, in the plate's axes.
    origins = [(np.mean(np.array(each)[:, 0]), -np.mean(np.array(each)[:, 1]), 0.0) for each in corners]
    _array(group, "ORIGIN", np.array(origins, np.float32))
    channels = np.arange(1, 6 * n + 1, dtype=np.int16).reshape(n, 6)
    _array(group, "CHANNEL", channels)
    units = ["N", "N", "N", "Nmm", "Nmm", "Nmm"] * n
    _text(writer.analog_group, "UNITS", units)


def _events(writer: Any, recording: Recording, start_ns: int) -> None:
    steps = recording.steps
    offset_s = (steps.start_ns - start_ns) * 1e-9
    found = []
    for column, word in (("contact_s", "Foot Strike"), ("toe_off_s", "Foot Off")):
        for at_s, foot, label in zip(steps[column], steps["foot"], steps["label"], strict=True):
            if np.isfinite(at_s):
                found.append((float(at_s) + offset_s, word, str(foot).capitalize(), str(label)))
    if not found:
        return
    found.sort()
    group = writer.add_group(_free_group(writer), "EVENT", "contacts and toe-offs")
    _array(group, "USED", np.int16(len(found)))
    for start in range(0, len(found), _MOST_OF_PARAMETER):
        number = str(1 + start // _MOST_OF_PARAMETER) if start else ""
        at_s, words, sides, labels = zip(*found[start : start + _MOST_OF_PARAMETER], strict=True)
        _text(group, f"LABELS{number}", words)
        _text(group, f"CONTEXTS{number}", sides)
        _text(group, f"DESCRIPTIONS{number}", labels)
        _array(group, f"TIMES{number}", np.stack(np.divmod(at_s, 60.0), axis=1).astype(np.float32))


def _text(group: Any, name: str, words: Sequence[str]) -> None:
    longest = max(map(len, words))
    group.add_str(name, "", "".join(word.ljust(longest) for word in words), longest, len(words))


def _array(group: Any, name: str, values: Any) -> None:
    """Numbers, whose last axis is C3D's first."""
    array = np.ascontiguousarray(values)
    group.add_param(name, bytes_per_element=array.itemsize, bytes=array.tobytes(), dimensions=[*np.shape(values)[::-1]])


def _free_group(writer: Any) -> int:
    number: int = writer.numeric_key_next
    return number
