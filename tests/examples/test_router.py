"""The router of docs/many-wearers.md, and its configuration for Zenoh's own, with several wearers behind them."""

from __future__ import annotations

import contextlib
import re
import time

import pytest
import zenoh
from processes import EXAMPLES, ROOT, python, run_to_end

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.service.foot import load_feet
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_session
from tests.conftest import PATIENCE_S


@contextlib.contextmanager
def example(endpoint):
    with python(EXAMPLES / "router.py", endpoint) as lines:
        assert lines.take(1) == ["routing\n"]
        yield


@contextlib.contextmanager
def documented(endpoint):
    (text,) = re.findall(r"```json5\n(.*?)```", (ROOT / "docs" / "many-wearers.md").read_text(), re.DOTALL)
    assert text.count("tcp/0.0.0.0:7447") == 1
    with zenoh.open(zenoh.Config.from_json5(text.replace("tcp/0.0.0.0:7447", endpoint))):
        yield


@pytest.mark.parametrize("router", [example, documented])
def test_every_wearer_is_received_and_distinguished(router, endpoint):
    left, right = load_feet(Config())
    with router(endpoint), contextlib.ExitStack() as opened:
        insole = opened.enter_context(insole_daemon.connect(endpoint))
        for rig in ("rig-01", "rig-02"):
            session = opened.enter_context(open_session("client", connect=[endpoint]))
            for foot in (left, right):
                publisher = opened.enter_context(FootPublisher(session, rig, foot.name))
                publisher.publish_latched("meta", foot.meta())
                publisher.announce()
        until = time.monotonic() + PATIENCE_S
        while len(insole.feet()) < 4 and time.monotonic() < until:
            time.sleep(0.1)
        assert insole.feet() == [(rig, foot) for rig in ("rig-01", "rig-02") for foot in ("left", "right")]
        assert insole.meta("right", "rig-02").foot == "right"


def test_a_router_on_a_port_that_is_taken_ends_with_one_message(endpoint):
    with example(endpoint):
        status, (message,) = run_to_end("router.py", endpoint)
    assert status == 1
    assert message.startswith("router: ")
    assert endpoint in message
