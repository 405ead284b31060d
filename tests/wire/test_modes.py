"""Peer, router and client from config.yaml, each between processes: the daemon, a router and who subscribes."""

from __future__ import annotations

import contextlib
import itertools
import socket
import subprocess
import sys
import time

import pytest
import zenoh

import insole_daemon
from insole_daemon.config import load
from insole_daemon.errors import DocumentError, WireError
from insole_daemon.wire.session import open_session
from tests.conftest import PATIENCE_S, RunningDaemon
from tests.ports import free_port

ROUTER = """
import sys
from insole_daemon.wire.session import open_session
with open_session("router", [sys.argv[1]]):
    print("ready", flush=True)
    sys.stdin.read()
"""


@contextlib.contextmanager
def router(endpoint):
    """Somebody else's router, as a process."""
    with subprocess.Popen(
        [sys.executable, "-c", ROUTER, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


@contextlib.contextmanager
def daemon(tmp_path, zenoh):
    config_file = tmp_path / "config.yaml"
    config_file.write_text(f"format: insole-config/1\nrig: test\nzenoh: {zenoh}\n")
    running = RunningDaemon(config_file, "", free_port(socket.SOCK_DGRAM))
    running.start()
    try:
        with running.boards():
            yield
    finally:
        status, _ = running.end()
    assert status == 0


def test_an_oversized_payload_is_dropped_and_other_messages_arrive():
    endpoint, received = f"tcp/127.0.0.1:{free_port()}", []
    with open_session("peer", [endpoint]) as ours, open_session("client", connect=[endpoint]) as theirs:

        def put_until_there(payload):
            while payload not in received:  # whoever is not connected, or has no room, gets nothing
                theirs.put("insole/small", payload)
                time.sleep(0.05)

        with ours.declare_subscriber("insole/**", lambda sample: received.append(sample.payload.to_bytes()[:5])):
            put_until_there(b"first")
            theirs.put("insole/huge", bytes(20_000_000), congestion_control=zenoh.CongestionControl.BLOCK)
            put_until_there(b"last")
    assert set(received) == {b"first", b"last"}


def works(endpoint):
    """What a subscriber wants: feet, cycles without a gap, what is behind them, and requests."""
    with insole_daemon.connect(endpoint) as insole:
        until = time.monotonic() + PATIENCE_S
        while len(insole.feet()) < 2 and time.monotonic() < until:  # a peer or router finds its router by itself
            time.sleep(0.1)
        assert insole.feet() == [("test", "left"), ("test", "right")]
        assert sum(wrench.lost for wrench in itertools.islice(insole.wrenches("left"), 25)) == 0
        assert insole.meta("right").n_triangles == 28
        assert len(insole.request("left", "boards", do="list")["boards"]) == 3


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_subscribers_connect_to_the_daemon(tmp_path, endpoint, mode):
    with daemon(tmp_path, f"{{mode: {mode}, listen: [{endpoint}]}}"):
        works(endpoint)


def test_a_daemon_in_mode_router_forwards_messages_between_clients(tmp_path, endpoint):
    with daemon(tmp_path, f"{{mode: router, listen: [{endpoint}]}}"):
        seen = []
        with open_session("client", connect=[endpoint]) as one, open_session("client", connect=[endpoint]) as other:
            one.declare_subscriber("lab/temperature", lambda sample: seen.append(sample.payload.to_string()))
            until = time.monotonic() + PATIENCE_S
            while not seen and time.monotonic() < until:
                other.put("lab/temperature", "21")
                time.sleep(0.05)
        assert seen


@pytest.mark.parametrize("mode", ["peer", "router", "client"])
def test_subscribers_connect_to_a_router(tmp_path, endpoint, mode):
    own = f"tcp/127.0.0.1:{free_port()}"
    with router(endpoint), daemon(tmp_path, f"{{mode: {mode}, listen: [{own}], connect: [{endpoint}]}}"):
        works(endpoint)
        if mode == "router":
            works(own)
        if mode == "client":
            with pytest.raises(WireError), insole_daemon.connect(own):
                pass


@pytest.mark.parametrize("mode", ["peer", "router", "client"])
def test_a_router_that_starts_later_or_restarts_is_connected(tmp_path, endpoint, mode):
    own = f"tcp/127.0.0.1:{free_port()}"
    with contextlib.ExitStack() as first:
        if mode == "client":
            first.enter_context(router(endpoint))
        with daemon(tmp_path, f"{{mode: {mode}, listen: [{own}], connect: [{endpoint}]}}"):
            first.close()
            with router(endpoint):
                works(endpoint)


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_clients_of_a_killed_router_reconnect_within_a_second_of_its_return(tmp_path, endpoint, mode):
    """Daemon, router and subscriber stay the same processes but the router; one of three attempts has to be in time."""
    own = f"tcp/127.0.0.1:{free_port()}"
    took_s = []
    with contextlib.ExitStack() as routers:
        process = routers.enter_context(router(endpoint))
        zenoh = f"{{mode: {mode}, listen: [{own}], connect: [{endpoint}]}}"
        with daemon(tmp_path, zenoh), insole_daemon.connect(endpoint) as insole:
            wrenches = insole.wrenches("left")
            list(itertools.islice(wrenches, 50))
            for _ in range(3):
                process.kill()  # SIGKILL: nobody is told
                process.wait()
                parted_ns = time.time_ns()
                time.sleep(1)  # of attempts in vain
                process = routers.enter_context(router(endpoint))
                back_ns = time.time_ns()
                first = next(wrench for wrench in wrenches if wrench.t_published_ns > parted_ns + 500_000_000)
                following = list(itertools.islice(wrenches, 50))
                assert first.lost > 0, "what was published meanwhile went nowhere, and that is told"
                assert sum(wrench.lost for wrench in following) == 0
                took_s.append((first.t_published_ns - back_ns) * 1e-9)
                if took_s[-1] < 1:
                    break
    assert min(took_s) < 1, took_s


def test_mode_client_needs_the_endpoint_of_a_router(tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("format: insole-config/1\nzenoh: {mode: client}\n")
    with pytest.raises(DocumentError, match=r"zenoh\.connect: a daemon in mode client needs the endpoint"):
        load(config)
