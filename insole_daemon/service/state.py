"""The folder of the daemon's files that must survive a restart."""

from __future__ import annotations

import os
from pathlib import Path


def state_folder() -> Path:
    """Return systemd's StateDirectory= if set, else the user's state folder (XDG Base Directory Specification)."""
    given = os.environ.get("STATE_DIRECTORY")
    if given:
        return Path(given.split(":")[0])  # systemd lists several like that
    home = os.environ.get("XDG_STATE_HOME", "")
    if not os.path.isabs(home):  # as the specification says
        home = os.path.expanduser("~/.local/state")
    return Path(home) / "insole"


def zero_path(rig: str, foot: str) -> Path:
    """Return the file that `insole zero` writes and every start and reload reads."""
    return state_folder() / f"{rig}-{foot}-zero.json"
