"""Open Zenoh sessions that need neither multicast nor a router."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Sequence
from pathlib import Path

import zenoh

from ..config import DEFAULT_PORT, Zenoh
from ..documents import YAML_BYTES
from ..errors import WireError
from ..files import read_at_most, unreadable
from .messages import MOST_BYTES
from .scheduling import batch_threads

_OURS = {"mode": "mode", "listen/endpoints": "listen", "connect/endpoints": "connect"}  # Zenoh's key → config.yaml's
_HANDSHAKE_MS = 1500
_HANDSHAKE_S = _HANDSHAKE_MS * 1e-3
_PATIENCE_S = 8.0  # for a daemon that has too little CPU to answer
_FIXED = {
    "scouting/multicast/enabled": False,
    "scouting/delay": 0,
    "transport/shared_memory/enabled": False,  # opening would fail without write access to /dev/shm
    "timestamping/enabled": True,  # the publisher's cache for late joiners needs it
    # A subscriber that stops reading loses its own messages, and the publisher never waits for room. The largest
    # queue lets a slow subscriber catch up; with the default of 2, an idle one lost cycles.
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
    "transport/link/tx/queue/size/real_time": 16,
    # After a cut cable TCP waits longer and longer before it retries. A side that was silent for two seconds is
    # therefore taken as lost and connected to again at constant intervals. An attempt is given up after TCP's second
    # try, because the third would follow two seconds later.
    "transport/link/tx/lease": 2000,
    "transport/unicast/open_timeout": _HANDSHAKE_MS,
    "transport/link/rx/max_message_size": 2 * MOST_BYTES,  # instead of 1 GB: larger messages are dropped on arrival
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 400, "period_increase_factor": 2},
}
_TLS_FILES = (
    "root_ca_certificate",
    "listen_private_key",
    "listen_certificate",
    "connect_private_key",
    "connect_certificate",
)


def full_endpoint(text: str) -> str:
    """Return `text` as an endpoint of Zenoh, with tcp/ and the default port added if it has none.

    Raises WireError if it is neither protocol/address nor host:port nor host.
    """
    if re.fullmatch(r"[a-z][a-z0-9_-]*/\S+", text):
        return text
    host = re.fullmatch(r"([\w.-]+|\[[0-9a-fA-F:.]+\])(:\d{1,5})?", text)
    if host is None:
        error = WireError(f"expected an endpoint such as tcp/127.0.0.1:{DEFAULT_PORT}, found {text!r}")
        error.exit_status = 2
        raise error
    return f"tcp/{host[1]}{host[2] or f':{DEFAULT_PORT}'}"


def open_session(
    mode: str,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    config_file: Path | None = None,
    rules: bool = True,
    if_taken: str = ", or give this one another endpoint under zenoh.listen in its config",
) -> zenoh.Session:
    """Open a session; raises WireError if an endpoint is in use or nobody answers.

    `config_file`: Zenoh's own configuration (JSON5) for everything else, such as certificates and access rules. Without
    `rules`, the access rules of the file are left out, because they are written for the daemon. `if_taken`: a remedy
    for an endpoint in use, besides stopping the program that uses it. The caller must close the session; an open
    session keeps the process from ending.
    """
    config = zenoh.Config() if config_file is None else load_config(config_file)
    ours = {"mode": mode, "listen/endpoints": list(listen), "connect/endpoints": list(connect)}
    began_s = time.monotonic()
    try:
        for path, value in (ours | _FIXED).items():
            config.insert_json5(path, json.dumps(value))
        if not rules:
            config.insert_json5("access_control/enabled", "false")
        return _open(config, mode)
    except zenoh.ZError as error:
        waited_s = time.monotonic() - began_s
        raise WireError(_explain(mode, listen, connect, _words(error), if_taken, waited_s)) from error


def _open(config: zenoh.Config, mode: str) -> zenoh.Session:
    """Open a session; a client tries again while the other side accepts connections and has no time to answer."""
    give_up_s = time.monotonic() + _PATIENCE_S
    while True:
        began_s = time.monotonic()
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            ended_s = time.monotonic()
            if mode != "client" or ended_s - began_s < _HANDSHAKE_S or ended_s > give_up_s:
                raise


def open_daemon_session(settings: Zenoh) -> zenoh.Session:
    """Open the session of a daemon, as `open_session` does; its threads do not preempt the main loop."""
    with batch_threads():
        return open_session(settings.mode, settings.listen, settings.connect, settings.config_file)


def load_config(path: Path) -> zenoh.Config:
    """Read the Zenoh configuration `path`; file names in it are relative to its folder. WireError if it is refused.

    It may not contain what config.yaml or the daemon sets, which would silently have no effect.
    """
    try:
        config = zenoh.Config.from_json5(read_at_most(path, YAML_BYTES).decode())
    except OSError as error:
        raise _refused(path, unreadable(error)) from error
    except UnicodeDecodeError as error:
        what = f"expected a configuration of Zenoh (JSON5), found bytes that are no text from byte {error.start} on"
        raise _refused(path, what) from error
    except zenoh.ZError as error:
        raise _refused(path, f"expected a configuration of Zenoh (JSON5), found: {_words(error)}") from error
    default = zenoh.Config()
    for theirs, ours in _OURS.items():
        if config.get_json(theirs) != default.get_json(theirs):
            raise _refused(path, f"{theirs} may not stand there: say it in config.yaml, under zenoh.{ours}")
    for name, value in _FIXED.items():
        if json.loads(config.get_json(name)) not in (json.loads(default.get_json(name)), value):
            raise _refused(path, f"{name} may not stand there: it is always {json.dumps(value)} here")
    for name, file in tls_files(path, config).items():
        if not os.access(file, os.R_OK):
            why = f"the file {file} is not there, or may not be read by this user"
            raise _refused(path, f"transport.link.tls.{name}: {why}")
        config.insert_json5(f"transport/link/tls/{name}", json.dumps(str(file)))
    return config


def tls_files(path: Path, config: zenoh.Config) -> dict[str, Path]:
    """Return the TLS files that `config`, read from `path`, names, by key."""
    tls = json.loads(config.get_json("transport/link/tls"))
    return {name: path.absolute().parent / tls[name] for name in _TLS_FILES if tls[name] is not None}


def _refused(path: Path, why: str) -> WireError:
    """Return the error for a Zenoh configuration that is refused."""
    error = WireError(f"{path}: {why}")
    error.exit_status = 4  # a file is refused, which does not heal by itself
    return error


def _words(error: Exception) -> str:
    """Return the text of Zenoh's error without the line of its source."""
    return re.sub(r" at /\S+\.rs:\d+\.?$", "", str(error).strip())


def _explain(
    mode: str, listen: Sequence[str], connect: Sequence[str], error: str, if_taken: str, waited_s: float
) -> str:
    if "in use" in error:
        return (
            f"Zenoh cannot listen on {', '.join(listen)}: the address is already in use. Does another insole daemon "
            f"or demo run ('insole status')? Stop it{if_taken}"
        )
    if mode == "client":
        certificate = (
            "; or the other side refuses this program's certificate, or this program that of the other side"
            if any(endpoint.startswith(("tls/", "quic/")) for endpoint in connect)
            else ""
        )
        if waited_s > _PATIENCE_S:
            return (
                f"{', '.join(connect)} gave no answer for {waited_s:.0f} s, and did not refuse either. Look at that "
                "host: does its daemon run with too little CPU, or stopped, does another program have the port, or a "
                f"firewall stand between{certificate}?"
            )
        return (
            f"nobody answers on {', '.join(connect)}. Start the daemon ('insole run', or 'insole demo' without "
            f"hardware) or the router that is meant, or name the endpoint it listens on{certificate}"
        )
    return f"Zenoh cannot open a {mode} session (listen {list(listen)}, connect {list(connect)}): {error}"
