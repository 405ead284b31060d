"""Export a recording as C3D for motion capture: insoles as force plates, CoPs as points, contacts as events.

| group          | content |
|----------------|---------|
| ANALOG         | Fx Fy Fz Mx My Mz of each foot, N and N·mm: the foot's action on the insole |
|                | then peak and mean pressure in kPa: L_peak, L_mean of the left sole, L_heel_peak … of its regions |
| FORCE_PLATFORM | type 2, one plate per foot; x forward, y to the wearer's right, z down; the insole's origin |
| POINT          | the CoP of each foot in the insole's frame, mm; invalid where there is none |
| EVENT          | Foot Strike and Foot Off of every stance, with side and label; from the 256th on in LABELS2 … |
| INSOLE         | START_NS as text: epoch time of the first frame; RATE_HZ |

Shear and the moment about z are not measured; their channels are 0. Loads of cycles without a valid taxel are 0, too.
A pressure of every taxel is in the other formats: C3D stores at most 255 labels in a parameter, an insole has more.
 C3D needs frames at a uniform rate, so the cycles
are interpolated linearly. The plate stands still in the insole's frame, because the foot's position is not measured.
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
from .views import pressures_by_region

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
_MAX_FRAMES = 65_535  # the header's counter has 16 bits
_MAX_ELEMENTS = 255  # elements along an axis; the format stores their number in one byte
_MAX_BLOCKS = 255  # of parameters in total; the format stores the number in one byte
_MM = 1e3
_KPA = 1e-3


def export_c3d(recording: Recording, out: Path) -> None:
    """Write `out`, all or nothing; InsoleError if no foot has a calibration or C3D cannot hold the recording."""
    c3d = need("c3d", "c3d", "exporting C3D")
    feet = [foot for foot in recording.feet if foot.wrench is not None and len(foot) > 1]
    if not feet:
        raise InsoleError(f"{recording.folder}: no foot has a calibration: C3D holds forces, and there are only counts")
    rate_hz, t_ns = _common_times(feet)
    if len(t_ns) > _MAX_FRAMES:
        raise InsoleError(
            f"{recording.folder}: {len(t_ns)} frames, C3D holds at most {_MAX_FRAMES}: export it as MCAP or Parquet"
        )
    plates = np.concatenate([_plate_channels(foot, t_ns) for foot in feet], axis=0)
    pressures = {name: channel for foot in feet for name, channel in _pressure_channels(foot, t_ns).items()}
    analog = np.concatenate([plates, np.stack(list(pressures.values()))], axis=0)
    points = np.stack([_cop_points(foot, t_ns) for foot in feet], axis=1)
    writer = c3d.Writer(point_rate=rate_hz, analog_rate=rate_hz, point_units="mm")
    writer.set_point_labels([f"{foot.foot[0].upper()}COP" for foot in feet])
    plate_labels = [f"{foot.foot[0].upper()}_{axis}" for foot in feet for axis in AXES]
    writer.set_analog_labels([*plate_labels, *pressures])
    _add_text(
        writer.analog_group, "UNITS", [*("N", "N", "N", "Nmm", "Nmm", "Nmm") * len(feet), *["kPa"] * len(pressures)]
    )
    writer.set_analog_scales(np.ones(len(analog)))
    writer.set_analog_offsets(np.zeros(len(analog), np.int16))
    for row in range(len(t_ns)):
        writer.add_frames([(points[row], analog[:, row : row + 1])])
    _add_force_platforms(writer, feet)
    _add_events(writer, recording, int(t_ns[0]))
    insole_group = writer.add_group(_free_group_number(writer), "INSOLE", "of insole-daemon")
    _add_text(insole_group, "START_NS", [str(int(t_ns[0]))])
    _add_array(insole_group, "RATE_HZ", np.array([rate_hz], np.float32))
    if writer.parameter_blocks() > _MAX_BLOCKS:
        raise InsoleError(
            f"{recording.folder}: C3D has no room for {len(recording.steps)} steps: export it as MCAP or Parquet"
        )
    with unfinished(out) as temporary, open(temporary, "wb") as file:
        writer.write(file)


def _common_times(feet: list[FootRecording]) -> tuple[float, NDArray[np.int64]]:
    """Return the frame rate, a whole number of Hz, and the times in ns that all feet cover."""
    intervals = np.concatenate([np.diff(foot.t_ns) for foot in feet])
    rate_hz = float(round(1e9 / float(np.median(intervals[intervals > 0]))))
    first, last = max(int(foot.t_ns.min()) for foot in feet), min(int(foot.t_ns.max()) for foot in feet)
    return rate_hz, first + (np.arange(max(1, int((last - first) * 1e-9 * rate_hz) + 1)) * 1e9 / rate_hz).astype(
        np.int64
    )


def _interpolate(foot: FootRecording, t_ns: NDArray[np.int64], column: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `column` (n_cycles,) interpolated linearly to `t_ns` (n,)."""
    order = np.argsort(foot.t_ns, kind="stable")
    own_t_ns = (foot.t_ns[order] - t_ns[0]).astype(np.float64)
    return np.asarray(np.interp((t_ns - t_ns[0]).astype(np.float64), own_t_ns, column[order]))


def _plate_channels(foot: FootRecording, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return (6, n) channels in the plate's axes, whose y and z point opposite to the insole's."""
    wrench = foot.wrench
    assert wrench is not None
    f_z, m_x, m_y = (
        np.nan_to_num(_interpolate(foot, t_ns, column)) for column in (wrench.f_z_n, wrench.m_x_nm, wrench.m_y_nm)
    )
    zeros = np.zeros_like(f_z)
    return np.stack([zeros, zeros, f_z, -m_x * _MM, m_y * _MM, zeros])


def _pressure_channels(foot: FootRecording, t_ns: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
    """Return the pressures of the sole and its regions in kPa, (n,) each, by label."""
    side = foot.foot[0].upper()
    return {
        "_".join(filter(None, (side, *key))): np.nan_to_num(_interpolate(foot, t_ns, pressure_pa)) * _KPA
        for key, pressure_pa in pressures_by_region(foot).items()
    }


def _cop_points(foot: FootRecording, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return (n, 5): x, y, z in mm, residual (−1: invalid point) and camera mask."""
    wrench = foot.wrench
    assert wrench is not None
    points = np.zeros((len(t_ns), 5))
    for axis, column in enumerate((wrench.cop_x_m, wrench.cop_y_m)):
        points[:, axis] = _interpolate(foot, t_ns, column) * _MM
    unknown = ~np.isfinite(points).all(axis=1)
    points[unknown] = (0, 0, 0, -1, 0)
    return points


def _add_force_platforms(writer: Any, feet: list[FootRecording]) -> None:
    """Add the group FORCE_PLATFORM with one plate per foot."""
    group = writer.add_group(_free_group_number(writer), "FORCE_PLATFORM", "one plate a foot")
    n = len(feet)
    _add_array(group, "USED", np.int16(n))
    _add_array(group, "TYPE", np.full(n, 2, np.int16))
    _add_array(group, "ZERO", np.zeros(2, np.int16))
    corners = []
    for foot in feet:
        # Corner k lies in quadrant k of the plate's own axes: x forward, y to the right.
        low, high = foot.layout.xy_m.min(axis=(0, 1)) * _MM, foot.layout.xy_m.max(axis=(0, 1)) * _MM
        quadrants = [(high[0], low[1]), (low[0], low[1]), (low[0], high[1]), (high[0], high[1])]
        corners.append([(x, y, 0.0) for x, y in quadrants])
    _add_array(group, "CORNERS", np.array(corners, np.float32))
    # C3D's ORIGIN points from the moments' reference point to the plate's centre, in the plate's axes.
    origins = [(np.mean(np.array(corner)[:, 0]), -np.mean(np.array(corner)[:, 1]), 0.0) for corner in corners]
    _add_array(group, "ORIGIN", np.array(origins, np.float32))
    channels = np.arange(1, 6 * n + 1, dtype=np.int16).reshape(n, 6)
    _add_array(group, "CHANNEL", channels)


def _add_events(writer: Any, recording: Recording, start_ns: int) -> None:
    """Add the group EVENT with contacts and toe-offs, relative to `start_ns`."""
    steps = recording.steps
    offset_s = (steps.start_ns - start_ns) * 1e-9
    events = []
    for column, word in (("contact_s", "Foot Strike"), ("toe_off_s", "Foot Off")):
        for at_s, foot, label in zip(steps[column], steps["foot"], steps["label"], strict=True):
            if np.isfinite(at_s):
                events.append((float(at_s) + offset_s, word, str(foot).capitalize(), str(label)))
    if not events:
        return
    events.sort()
    group = writer.add_group(_free_group_number(writer), "EVENT", "contacts and toe-offs")
    _add_array(group, "USED", np.int16(len(events)))
    for start in range(0, len(events), _MAX_ELEMENTS):
        number = str(1 + start // _MAX_ELEMENTS) if start else ""
        at_s, words, sides, labels = zip(*events[start : start + _MAX_ELEMENTS], strict=True)
        _add_text(group, f"LABELS{number}", words)
        _add_text(group, f"CONTEXTS{number}", sides)
        _add_text(group, f"DESCRIPTIONS{number}", labels)
        _add_array(group, f"TIMES{number}", np.stack(np.divmod(at_s, 60.0), axis=1).astype(np.float32))


def _add_text(group: Any, name: str, words: Sequence[str]) -> None:
    longest = max(map(len, words))
    group.add_str(name, "", "".join(word.ljust(longest) for word in words), longest, len(words))


def _add_array(group: Any, name: str, values: Any) -> None:
    """Add an array of numbers; C3D stores the last axis first."""
    array = np.ascontiguousarray(values)
    group.add_param(name, bytes_per_element=array.itemsize, bytes=array.tobytes(), dimensions=[*np.shape(values)[::-1]])


def _free_group_number(writer: Any) -> int:
    number: int = writer.numeric_key_next
    return number
