"""Reading the recordings of a verb, with progress on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .progress import show_work

if TYPE_CHECKING:
    from ..recording.loading import Recording


def load_recordings(folders: Sequence[Path], calibration_files: Sequence[Path] = ()) -> list[Recording]:
    """Return the recordings in `folders` and print their warnings; RecordingError lists all problems of one.

    `calibration_files`, one a foot, replace those of the recordings.
    """
    from ..recording.loading import load

    loaded = []
    for folder in folders:
        with show_work(f"reading {folder}") as work:
            loaded.append(load(folder, work.done, calibration_files))
    for warning in (warning for recording in loaded for warning in recording.warnings):
        print(f"insole: {warning}", file=sys.stderr)
    return loaded
