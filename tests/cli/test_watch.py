"""`insole watch` among publishers of other versions, and of nothing of ours."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import zenoh

from insole_daemon.wire.messages import Event, Health
from insole_daemon.wire.session import open_session

INSOLE = Path(sys.executable).with_name("insole")
ODD = Health("left", 1, 1.0, "ok", {}, 50.0, {}, {}, [], [], {"frames": b"\xff"}, {}, {})


@pytest.mark.parametrize("key", ["insole/**", "insole/*/left/event"])
def test_watch_continues_after_an_unknown_message(endpoint, key):
    def put(what, payload, schema):
        encoding = zenoh.Encoding("application/msgpack").with_schema(schema)
        session.put(f"insole/x/left/{what}", payload, encoding=encoding)

    stop = threading.Event()

    def publish():
        while not stop.wait(0.05):
            put("novel", b"\x00", "insole.novel/1")
            put("event", b"rubbish", Event.SCHEMA)
            put("event", b"\x80", "insole.event/3")
            put("health", ODD.encode(), Health.SCHEMA)
            put("event", Event("left", 1, "kind", "text", []).encode(), Event.SCHEMA)

    with open_session("peer", [endpoint]) as session:
        thread = threading.Thread(target=publish)
        thread.start()
        try:
            done = subprocess.run(
                [INSOLE, "watch", key, "--connect", endpoint, "--json", "--count", "6"],
                capture_output=True,
                text=True,
            )
        finally:
            stop.set()
            thread.join()
    assert done.returncode == 0, done.stderr
    schemas = [json.loads(line)["schema"] for line in done.stdout.splitlines()]
    assert len(schemas) == 6
    assert Event.SCHEMA in schemas
    *warnings, counted, _next = done.stderr.splitlines()
    keys = [line.partition(": passed over")[0] for line in warnings]
    assert "insole/x/left/event" in keys
    assert len(keys) == len(set(keys)), "once, not once a payload"
    assert "payloads did not match their key" in counted


def test_an_unknown_kind_in_a_key_is_reported(endpoint):
    with open_session("peer", [endpoint]):
        done = subprocess.run(
            [INSOLE, "watch", "insole/*/left/novel", "--connect", endpoint], capture_output=True, text=True
        )
    assert done.returncode == 3
    assert "expected a key ending in one of raw, pressure, wrench" in done.stderr
