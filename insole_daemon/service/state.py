"""Where the daemon keeps what it must find again after a restart."""

from __future__ import annotations

import os
from pathlib import Path


def state_folder() -> Path:
    """systemd's StateDirectory= where there is one, else the user's own (XDG Base Directory Specification)."""
    given = os.environ.get("STATE_DIRECTORY")
    if given:
        return Path(given.split(":")[0])  # systemd lists several like that
    home = os.environ.get("XDG_STATE_HOME", "")
    if not os.path.isabs(home):  # as the specification says
        home = os.path.expanduser("~/.local/state")
    return Path(home) / "insole"


def zero_path(rig: str, foot: str) -> Path:
    """The file that `insole zero` stores and the next start reads."""
    return state_folder() / f"{rig}-{foot}-zero.json"
