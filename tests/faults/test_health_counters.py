"""`health.asked` counts the requests, reloads and commands that the daemon did and refused."""

from __future__ import annotations

import signal

import pytest

import insole_daemon
from insole_daemon.errors import WireError


def test_requests_are_counted(daemon):
    text = daemon.config_file.read_text()
    with insole_daemon.connect(daemon.endpoint) as insole:
        healths, events = insole.healths("left"), insole.events("left")
        assert set(next(iter(healths)).asked.values()) == {0}
        insole.request("left", "boards", do="list")
        with pytest.raises(WireError):
            insole.request("left", "boards", do="fly")
        insole.request("right", "boards", do="list")
        for content, kind in ((text, "reloaded"), (text + "nonsense: 1\n", "reload_refused"), (text, "reloaded")):
            daemon.config_file.write_text(content)
            daemon.process.send_signal(signal.SIGHUP)
            assert next(event.kind for event in events if "reload" in event.kind) == kind
        health = next(health for health in healths if health.asked["reloads_done"] == 2)
    assert health.asked == {
        "requests_done": 1,
        "requests_refused": 1,
        "reloads_done": 2,
        "reloads_refused": 1,
        "commands_sent": 0,
        "commands_refused": 0,
    }
