"""Real-time acquisition for a sensorised insole.

import insole_daemon

with insole_daemon.connect() as insole:
    for wrench in insole.wrenches():
        print(wrench.foot, wrench.f_z_n, wrench.cop_x_m)

trial = insole_daemon.load("walk-3")
print(trial["left"].t_ns, trial["left"].counts, trial["left"].pressure_pa)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .config import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from .recording.loading import Recording
    from .wire.client import Client

__all__ = ["__version__", "connect", "load"]

__version__ = "0.1.0"


def connect(endpoint: str = DEFAULT_ENDPOINT, rig: str = "*", config_file: str | PathLike[str] | None = None) -> Client:
    """Return a client of the daemons behind `endpoint`, for `with` and `async with`.

    Entering it raises WireError if nobody answers. `config_file` is a Zenoh configuration (JSON5) with the certificate
    of this program.
    """
    from pathlib import Path

    from .wire.client import Client  # Zenoh is loaded by whoever connects, not by every `insole --help`

    return Client(endpoint, rig, Path(config_file) if config_file is not None else None)


def load(folder: str | PathLike[str], calibrations: Sequence[str | PathLike[str]] = ()) -> Recording:
    """Return the recording in `folder` as numpy arrays; RecordingError lists all problems of its files.

    `calibrations` are files, one a foot, that replace those of the recording.
    """
    from .recording.loading import load as load_recording

    return load_recording(folder, calibration_files=calibrations)
