"""What a browser that comes later is told."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.physics.effect import effect
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_setup import load_setups
from insole_daemon.skin.cycles import Cycles
from insole_daemon.view.hub import Hub
from insole_daemon.view.other_sources import OtherSources
from insole_daemon.view.packets import HEAD
from insole_daemon.view.viewer import Viewer
from insole_daemon.wire.client import Client
from insole_daemon.wire.messages import Event, Health


def messages_of(hub):
    viewer = Viewer()
    hub.join(viewer)
    messages = []
    while (words := viewer.take()) is not None:
        messages.append(json.loads(words))
        viewer.answered()
    return messages


def test_a_later_viewer_gets_the_last_state_and_events_but_not_every_step():
    async def run():
        hub = Hub(Client(), "test", OtherSources("simulation", {}))
        hub._take(Event("left", 1, "board_silent", "board 5 is silent", [5]))
        for number in range(200):
            hub._take(
                Event("left", number, "toe_off", "the left foot leaves the ground", [], figures={"stance_s": 0.7})
            )
        for uptime_s in (1.0, 2.0):
            hub._take(Health("left", 1, uptime_s, "ok", {}, 50.0, {}, {}, [], [], {}, {}, {}))
        hub.publish_latched("recording", {"running": False, "text": ""})
        return messages_of(hub)

    messages = asyncio.run(run())
    assert [(message["kind"], message.get("what")) for message in messages] == [
        ("health", None), ("recording", None), ("event", "board_silent"),
    ]  # fmt: skip
    assert messages[0]["uptime_s"] == 2.0


def test_the_model_that_is_not_in_use_is_drawn_beside_the_one_that_is():
    setup = load_setups(Config())[0]
    effects = (effect("viscoelasticity", a=0.5, tau_s=0.5),)
    foot = Foot(replace(setup, calibration=replace(setup.calibration, effects=effects)))
    counts = np.full((2, foot.n_triangles, 12), 235, np.uint8)
    counts[1] = 200
    wide, flags, t_ns = np.zeros((2, foot.n_triangles), np.int64), np.zeros(2, bool), np.array([1, 2]) * 20_000_000
    arrivals = wide + np.array([[2], [4]])
    cycles = Cycles(t_ns, t_ns, counts, wide.astype(np.uint16), wide, wide, arrivals, wide > 0, flags, flags)

    async def run():
        hub, viewer = Hub(Client(), "test", OtherSources("simulation", {})), Viewer()
        hub._describe(foot.meta())
        hub.join(viewer)
        while viewer.take() is not None:
            viewer.answered()
        forces = []
        for at, model in enumerate(("dynamic", "static")):
            foot.switch(model)
            messages = foot.messages(cycles, at)
            for message in messages.published():
                hub._take(message)
            forces.append((messages[2].f_z_n, messages.models.static_f_z_n, messages.models.dynamic_f_z_n))
            head = HEAD.unpack(viewer.take()[: HEAD.size])
            viewer.answered()
            forces[-1] += (head[6], head[16])
        return forces

    (used, static, dynamic, shown, beside), later = asyncio.run(run())
    assert (used, shown, beside) == (dynamic, pytest.approx(dynamic), pytest.approx(static))
    used, static, dynamic, shown, beside = later
    assert dynamic > 1.5 * static
    assert (used, shown, beside) == (static, pytest.approx(static), pytest.approx(dynamic))


def test_steps_reach_subscribers():
    async def run():
        hub, viewer = Hub(Client(), "test", OtherSources("simulation", {})), Viewer()
        hub.join(viewer)
        hub._take(Event("right", 3, "toe_off", "text", [], figures={"stance_s": 0.7}))
        hub.leave(viewer)
        hub._take(Event("right", 4, "toe_off", "text", [], figures={"stance_s": 0.8}))
        return json.loads(viewer.take()), viewer.take()

    step, nothing = asyncio.run(run())
    assert (step["what"], step["figures"]) == ("toe_off", {"stance_s": 0.7})
    assert nothing is None
