"""A Zenoh session that needs neither multicast nor a router."""

from __future__ import annotations

import json
from collections.abc import Sequence

import zenoh

from ..errors import WireError


def open_session(mode: str, listen: Sequence[str] = (), connect: Sequence[str] = ()) -> zenoh.Session:
    """Open a session; raises WireError where an endpoint is taken or nobody answers.

    The session must be closed by whoever opens it: one left open keeps the process from ending.
    """
    config = zenoh.Config()
    for path, value in {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,  # opening would fail where /dev/shm is not ours to write
        "timestamping/enabled": True,  # the publisher's cache for late joiners needs it
        # A subscriber that stops reading may cost its own messages, never our time: nothing waits for room. The most
        # room there can be then lets a slow one catch up; with the default of 2, cycles were lost to an idle one.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/size/real_time": 16,
    }.items():
        config.insert_json5(path, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise WireError(_explain(mode, listen, connect, str(error))) from error


def _explain(mode: str, listen: Sequence[str], connect: Sequence[str], error: str) -> str:
    if "in use" in error:
        return (
            f"Zenoh cannot listen on {', '.join(listen)}: the address is already in use. Does another insole daemon "
            "run ('insole status')? Stop it, or give this one another endpoint under zenoh.listen in its config"
        )
    if mode == "client":
        return (
            f"nobody answers on {', '.join(connect)}. Start the daemon ('insole run', or 'insole demo' without "
            "hardware), or name the endpoint it listens on"
        )
    return f"Zenoh cannot open a {mode} session (listen {list(listen)}, connect {list(connect)}): {error}"
