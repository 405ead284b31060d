"""Checks of Zenoh: the daemon's endpoints, the endpoints it connects to, and who else can reach it."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator

from ...config import DEFAULT_ENDPOINT, Config, Zenoh
from ...errors import WireError
from ...wire.client import Client
from ...wire.exposure import ENCRYPTED, REMEDY, exposures, split
from ...wire.session import load_config, tls_files
from .finding import CheckResult, ok, problem, warning

_STREAMS = ("tcp", "tls", "ws")
_KNOCK_S = 2.0
_ANY_HOST = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # address listened on → address by which this host reaches it


def check_daemon(settings: Config) -> tuple[str | None, list[CheckResult]]:
    """Return the endpoint on which the configured daemon answers, None if it does not run, and the results."""
    zenoh, reached, results = settings.zenoh, None, []
    unanswered = []
    for endpoint in zenoh.connect if zenoh.mode == "client" else zenoh.listen:
        here = _from_here(endpoint)
        feet = _feet(here, zenoh)
        rigs = sorted({rig for rig, _ in feet or ()})
        if feet is None:
            unanswered.append(endpoint)
        elif settings.rig in rigs:
            reached = reached or here
            names = " and ".join(foot for rig, foot in feet if rig == settings.rig)
            results.append(ok(endpoint, f"the daemon answers: rig {settings.rig}, {names}"))
        elif zenoh.mode != "client":
            who = f"the daemon of rig {', '.join(rigs)}" if rigs else "a Zenoh node that is no insole daemon"
            results.append(
                problem(endpoint, f"{who} listens there already", "config.yaml: zenoh: {listen: [another endpoint]}")
            )
    if zenoh.mode != "client":
        results += [_port(endpoint, reached) for endpoint in unanswered]
    return reached, results


def check_connects(settings: Config) -> Iterator[CheckResult]:
    """Check that the endpoints answer to which the daemon connects."""
    if settings.zenoh.mode == "peer" and settings.zenoh.connect and settings.zenoh.listen:
        # seen with Zenoh 1.10.2: one liveliness query in sixty stays without answer, which a router's never does
        yield warning(
            "zenoh.mode",
            "a peer with somebody under connect is not always found by who connects to it directly",
            "config.yaml: zenoh: {mode: router}",
        )
    for endpoint in settings.zenoh.connect:
        if _feet(endpoint, settings.zenoh) is not None:
            yield ok(endpoint, "answers")
        elif settings.zenoh.mode == "client":
            yield problem(
                endpoint,
                "does not answer, and a client does not start without",
                "start the router there, or correct zenoh.connect in config.yaml",
            )
        else:
            yield warning(
                endpoint, "does not answer; the daemon connects once it does", "config.yaml: zenoh: {connect: […]}"
            )


def check_exposure(settings: Config) -> Iterator[CheckResult]:
    """Check who else can reach the daemon, and whether its certificates can be used."""
    file = settings.zenoh.config_file
    try:
        if file is not None:
            config = load_config(file)
            yield ok("certificates", f"{file} and the files it names can be read")
            for name, path in tls_files(file, config).items():
                if name.endswith("private_key") and os.stat(path).st_mode & 0o077:
                    yield warning("certificates", f"other users may read the private key {path}", f"chmod 600 {path}")
        for exposure in exposures(settings.zenoh):
            yield warning("exposure", exposure, REMEDY)
    except WireError as error:
        yield problem("certificates", str(error), REMEDY)


def _from_here(endpoint: str) -> str:
    """Return the endpoint by which this host reaches a listener on `endpoint`."""
    _, host, _ = split(endpoint)
    return endpoint.replace(host, _ANY_HOST[host], 1) if host in _ANY_HOST else endpoint


def _feet(endpoint: str, zenoh: Zenoh) -> list[tuple[str, str]] | None:
    """Return (rig, foot) of all feet behind `endpoint`; None if no Zenoh node accepts the connection."""
    protocol, host, port = split(endpoint)
    if protocol in _STREAMS:  # Zenoh would wait for 10 s if a firewall drops the packets
        try:
            socket.create_connection((host, int(port)), _KNOCK_S).close()
        except (OSError, ValueError):
            return None
    try:
        with Client(endpoint, config_file=zenoh.config_file) as insole:
            return insole.feet()
    except WireError:
        return None


def _port(endpoint: str, reached: str | None) -> CheckResult:
    """Check that a daemon could listen on `endpoint`, on which nobody answers."""
    protocol, host, port = split(endpoint)
    if not port.isdigit():
        return warning(endpoint, f"cannot be looked at: {protocol} has no port")
    kind = socket.SOCK_STREAM if protocol in _STREAMS else socket.SOCK_DGRAM
    try:
        family, _, _, _, address = socket.getaddrinfo(host, int(port), type=kind)[0]
        with socket.socket(family, kind) as sock:
            if kind == socket.SOCK_STREAM:  # as Zenoh does: connections of a daemon that has just ended do not matter
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(address)
    except OSError as error:
        if error.errno == errno.EADDRINUSE and reached is not None:
            return ok(endpoint, f"in use, as it seems by the daemon that answers on {reached}")
        if error.errno == errno.EADDRINUSE and protocol in ENCRYPTED:
            return warning(
                endpoint,
                "in use; who listens asks for a certificate that the doctor does not have",
                f"config.yaml: zenoh: {{listen: [{DEFAULT_ENDPOINT}, {endpoint}]}}   # for the commands on this host",
            )
        if error.errno == errno.EADDRINUSE:
            return problem(
                endpoint,
                "in use, and whoever listens there does not let us in",
                f"sudo ss -lnp 'sport = :{port}'   # names the program; end it, or change zenoh.listen",
            )
        return problem(
            endpoint, f"cannot be listened on: {error.strerror}", "config.yaml: zenoh: {listen: [another endpoint]}"
        )
    return ok(endpoint, "free")
