"""Moments that two clocks have seen: markers in a recording, and in a text file of another system.

The file has one moment a line, in seconds on its own clock, in the first of its columns (comma, semicolon, tab or
space). A first line that is no number is a header.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from ..errors import DocumentError, FileError, Problem
from ..files import unreadable
from .document import FILE


def read_markers(path: Path) -> NDArray[np.float64]:
    """Return the moments in `path` in seconds, increasing; DocumentError names the first line that is none."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise DocumentError(str(path), [Problem(None, "", unreadable(error))]) from error
    except UnicodeDecodeError as error:
        what = f"expected text (UTF-8), found other bytes from byte {error.start} on"
        raise DocumentError(str(path), [Problem(None, "", what)]) from error
    moments_s: list[float] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        cell = re.split(r"[,;\s]", line.strip(), maxsplit=1)[0]
        moment_s = _number(cell)
        if moment_s is None and number > 1:
            raise DocumentError(str(path), [Problem(number, "", f"expected a moment in seconds, found {cell!r}")])
        if moment_s is not None:
            moments_s.append(moment_s)
    return np.sort(np.array(moments_s, np.float64))


def recorded_markers(folder: Path) -> NDArray[np.float64]:
    """Return the markers in the recording.yaml of `folder`, in seconds of CLOCK_REALTIME; FileError: it has none."""
    document = yaml.safe_load((folder / FILE).read_text(encoding="utf-8"))
    markers = (document.get("extensions") or {}).get("markers") or []
    if not markers:
        raise FileError(
            f"{folder}: expected markers in {FILE}, found none: name a file with their moments, --own-markers FILE"
        )
    return np.sort(np.array([marker["t_ns"] for marker in markers], np.float64) * 1e-9)


def _number(cell: str) -> float | None:
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
