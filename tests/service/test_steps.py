"""Steps of a simulated walk as events of a running daemon, in the words of the protocol."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import numpy as np

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.service.foot import PublishedLoad, load_feet
from insole_daemon.service.steps import StepEvents
from insole_daemon.wire.messages import Event

PROTOCOL = Path(__file__).parents[2] / "protocol"
STEPS = ("initial_contact", "toe_off")
FEET = ("left", "right")


def is_whole(event: Event) -> bool:
    """Whether all of its figures are known: none of the first, nor of those after a gap."""
    return None not in event.figures.values()


def test_a_subscriber_hears_every_step_once(daemon):
    with insole_daemon.connect(daemon.endpoint) as insole:
        events, steps = insole.events(), []
        with daemon.boards():
            for event in events:
                if event.kind in STEPS:
                    steps.append(event)
                if all(sum(is_whole(each) for each in steps if each.foot == foot) >= 3 for foot in FEET):
                    break
    keys = (PROTOCOL / "keys.md").read_text()
    for kind in STEPS:
        assert f"`{kind}`" in keys
    for foot in FEET:
        own = [event for event in steps if event.foot == foot]
        assert all(first.kind != second.kind for first, second in itertools.pairwise(own)), "they alternate"
        for event in filter(is_whole, own):
            assert all(f"`{name}`" in keys for name in event.figures)
            assert f"the {foot} foot" in event.text
            json.dumps(event.figures, allow_nan=False)
    cadence = [event.figures["cadence_per_min"] for event in steps if event.kind == "initial_contact"][-1]
    assert abs(cadence - 110) < 15


def load(foot, number, f_z_n, repeated=False):
    shape = (foot.n_triangles, 12)
    return PublishedLoad(
        number * 20_000_000, f_z_n, np.full(shape, 1e4, np.float32), np.ones(shape, np.uint8), repeated
    )


def test_repeats_and_unknown_forces_tell_nothing():
    (foot, _), results = load_feet(Config()), []
    steps = StepEvents([foot])
    for number, f_z_n in enumerate([0.0, math.inf, math.nan, 0.0, 0.0, 300.0, 500.0]):
        results.append(steps.take(foot, number * 20_000_000, load(foot, number, f_z_n, repeated=False)))
        results.append(steps.take(foot, number * 20_000_000, load(foot, number, 700.0, repeated=True)))
    (event,) = filter(None, results)
    assert (event.kind, event.foot) == ("initial_contact", "left")
    assert 4 * 20_000_000 < event.t_ns < 5 * 20_000_000
    assert Event.decode(event.encode()).figures == event.figures
