"""What a browser that comes later is told."""

from __future__ import annotations

import asyncio
import json

from insole_daemon.view.beside import Others
from insole_daemon.view.hub import Hub
from insole_daemon.view.viewer import Viewer
from insole_daemon.wire.client import Client
from insole_daemon.wire.messages import Event, Health


def told(hub):
    viewer = Viewer()
    hub.join(viewer)
    found = []
    while (words := viewer.take()) is not None:
        found.append(json.loads(words))
        viewer.answered()
    return found


def test_who_comes_later_hears_the_last_state_and_events_but_not_every_step():
    async def run():
        hub = Hub(Client(), "test", Others("simulation", {}))
        hub._take(Event("left", 1, "board_silent", "board 5 is silent", [5]))
        for number in range(200):
            hub._take(
                Event("left", number, "toe_off", "the left foot leaves the ground", [], figures={"stance_s": 0.7})
            )
        for uptime_s in (1.0, 2.0):
            hub._take(Health("left", 1, uptime_s, "ok", {}, 50.0, {}, [], [], {}, {}, {}))
        hub.stand("recording", {"running": False, "text": ""})
        return told(hub)

    found = asyncio.run(run())
    assert [(each["kind"], each.get("what")) for each in found] == [
        ("health", None), ("recording", None), ("event", "board_silent"),
    ]  # fmt: skip
    assert found[0]["uptime_s"] == 2.0


def test_steps_reach_those_who_look():
    async def run():
        hub, viewer = Hub(Client(), "test", Others("simulation", {})), Viewer()
        hub.join(viewer)
        hub._take(Event("right", 3, "toe_off", "text", [], figures={"stance_s": 0.7}))
        hub.leave(viewer)
        hub._take(Event("right", 4, "toe_off", "text", [], figures={"stance_s": 0.8}))
        return json.loads(viewer.take()), viewer.take()

    step, nothing = asyncio.run(run())
    assert (step["what"], step["figures"]) == ("toe_off", {"stance_s": 0.7})
    assert nothing is None
