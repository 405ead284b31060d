"""Optional dependencies: the extra that brings a package, and the command that installs it here."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import re
import shlex
import sys
from pathlib import Path

DISTRIBUTION = "insole-daemon"
_DEBIAN = Path("/usr/lib/insole-daemon")  # the folder of packaging/deb
_FOR_USERS = ("lab", "study", "view", "lsl")  # the other extras are for developers


def extra_of(module: str) -> str | None:
    """Return the extra that installs `module`, or None if no extra does."""
    package = module.partition(".")[0]
    try:
        requirements = importlib.metadata.requires(DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        return None
    for requirement in requirements:
        name = re.match(r"[\w.-]+", requirement)
        extra = re.search(r"extra == ['\"](\w+)['\"]", requirement)
        if not (name and extra and extra[1] in _FOR_USERS):
            continue
        distribution = name[0].replace("-", "_").lower()
        if distribution == package or distribution.startswith(f"{package}_"):  # mcap-protobuf-support: mcap_protobuf
            return extra[1]
    return None


def install_command(extra: str) -> str:
    """Return the shell command that installs `extra` into the running environment."""
    checkout = _checkout_of(Path(sys.prefix))
    if checkout is not None:
        return f"python3 {shlex.quote(str(checkout / 'bootstrap.py'))} install {extra}"
    requirement = f"'{DISTRIBUTION}[{extra}]'"
    if Path(__file__).is_relative_to(_DEBIAN):  # which pip may not change
        return f"sudo apt install pipx && pipx install {requirement}"
    if "pipx" in Path(sys.prefix).parts:
        return f"pipx install --force {requirement}"
    python = shlex.quote(sys.executable)
    if importlib.util.find_spec("pip") is None:
        return f"uv pip install --python {python} {requirement}"
    return f"{python} -m pip install {requirement}"


def _checkout_of(prefix: Path) -> Path | None:
    """Return the checkout whose bootstrap.py made the environment `prefix`, or None if another program made it."""
    try:
        state = json.loads((prefix / "bootstrap.json").read_text())
        return Path(state["checkout"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
