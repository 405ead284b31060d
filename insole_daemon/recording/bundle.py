"""Collect a recording's files under plain names in one flat folder, for export into a single container file."""

from __future__ import annotations

import gzip
import io
from pathlib import Path
from typing import Any

import numpy as np

from ..documents import Reading
from . import counts as counts_file
from .document import FILE, dump
from .loading import Recording
from .writer import log_name


def bundle_files(recording: Recording) -> dict[str, bytes]:
    """Return the content of every file by name; the log is compressed, and the copy loads to the same arrays."""
    folder = recording.folder
    document: dict[str, Any] = Reading(folder / FILE).document
    document.pop("format")
    files: dict[str, bytes] = {}
    if recording.log is not None:
        name, content = log_name(recording.log), recording.log.read_bytes()
        if name == "can.log":
            name, content = "can.log.gz", gzip.compress(content, 6, mtime=0)
        document["can"], files[name] = name, content
    else:
        files["counts.npz"] = _counts_npz(folder / document["counts"], recording)
        document["counts"] = "counts.npz"
    for entry in document["insoles"]:
        sources = {key: folder / entry[key] for key in ("layout", "calibration", "zero") if entry.get(key) is not None}
        if entry["foot"] in recording.calibration_files:
            sources["calibration"] = recording.calibration_files[entry["foot"]]
        for key, source in sources.items():
            entry[key] = f"{entry['foot']}-{key}.{'yaml' if key == 'layout' else 'json'}"
            files[entry[key]] = source.read_bytes()
    for entry in document.get("reference", ()):
        name = f"{entry['foot']}-reference.csv"
        files[name] = (folder / entry["file"]).read_bytes()
        entry["file"] = name
    return {FILE: dump(document).encode(), **files}


def _counts_npz(path: Path, recording: Recording) -> bytes:
    if path.is_file():
        return path.read_bytes()
    tables = counts_file.read(path, {foot.foot: len(foot.layout) for foot in recording.feet})
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **counts_file.arrays(tables))  # type: ignore[arg-type]
    return buffer.getvalue()
