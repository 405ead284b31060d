"""Keys on Zenoh: `insole/<rig>/<foot>/<what>`, and the liveliness token `insole/<rig>/<foot>/alive`."""

from __future__ import annotations

ROOT = "insole"


def key(rig: str, foot: str, what: str) -> str:
    """Return the key of one message; `*` for rig, foot or what makes it a key expression."""
    return f"{ROOT}/{rig}/{foot}/{what}"
