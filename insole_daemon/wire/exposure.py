"""Find endpoints of a session that are unencrypted or open to everybody.

Zenoh without TLS has neither secrecy nor identity: whoever reaches the port can read everything, publish in the
daemon's name and have the boards configured. On a closed network that may be intended, so it is a warning, not an
error.
"""

from __future__ import annotations

import ipaddress
import json

from ..config import Zenoh
from .session import load_config

ENCRYPTED = ("tls", "quic")
_LOCAL = ("unixsock-stream",)
REMEDY = "docs/beyond-loopback.md has a worked example with certificates"


def split(endpoint: str) -> tuple[str, str, str]:
    """Return protocol, host and port of an endpoint; the port is empty if the protocol has none."""
    protocol, _, rest = endpoint.partition("/")
    address = rest.partition("?")[0].partition("#")[0]
    if protocol in _LOCAL:
        return protocol, address, ""
    host, _, port = address.rpartition(":")
    return protocol, host.strip("[]"), port


def is_loopback(endpoint: str) -> bool:
    """Return whether only processes of this host can be at the other end."""
    protocol, host, _ = split(endpoint)
    if protocol in _LOCAL or host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name, which may mean any host
        return False


def exposures(zenoh: Zenoh) -> list[str]:
    """Return a warning for each exposure of a daemon with this configuration; raises WireError for a refused file."""
    warnings = []
    listens = () if zenoh.mode == "client" else zenoh.listen  # a client listens nowhere
    for endpoint in listens:
        if not is_loopback(endpoint) and split(endpoint)[0] not in ENCRYPTED:
            warnings.append(
                f"zenoh.listen: {endpoint} is open to the network without encryption: whoever reaches it can read "
                "everything, publish false values and command the boards"
            )
    for endpoint in zenoh.connect:
        if not is_loopback(endpoint) and split(endpoint)[0] not in ENCRYPTED:
            warnings.append(
                f"zenoh.connect: everything is sent to {endpoint} without encryption, and whoever is connected there "
                "can read it, publish false values and command the boards"
            )
    open_tls = [e for e in listens if not is_loopback(e) and split(e)[0] in ENCRYPTED]
    if open_tls:
        config = load_config(zenoh.config_file) if zenoh.config_file is not None else None
        tls = json.loads(config.get_json("transport/link/tls")) if config is not None else {}
        rules = json.loads(config.get_json("access_control")) if config is not None else {}
        if not tls.get("enable_mtls"):
            warnings.append(
                f"zenoh.listen: {', '.join(open_tls)} asks nobody for a certificate: set enable_mtls: true under "
                "transport.link.tls in the file that zenoh.config_file names"
            )
        elif not rules.get("enabled"):
            warnings.append(
                f"zenoh.listen: {', '.join(open_tls)}: whoever has a certificate may do everything, also command the "
                "boards: set access_control in the file that zenoh.config_file names"
            )
    return warnings
