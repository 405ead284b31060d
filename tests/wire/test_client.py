"""The client against a real daemon in another process, over real Zenoh."""

from __future__ import annotations

import asyncio
import itertools
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import zenoh
import zenoh.ext

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.errors import WireError
from insole_daemon.service.foot import load_feet
from insole_daemon.wire.messages import BY_KEY, Meta, Wrench
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_session
from tests.conftest import PATIENCE_S


def take(messages, n):
    return list(itertools.islice(messages, n))


def test_wrenches_of_one_foot_come_without_a_gap(daemon):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        wrenches = insole.wrenches("left")
        take(wrenches, 10)
        received = take(wrenches, 100)
        # Boards that get no CPU for a while leave no force; somebody walks.
        next(wrench for wrench in wrenches if wrench.f_z_n is not None and wrench.f_z_n > 300)
    assert {wrench.foot for wrench in received} == {"left"}
    assert [wrench.lost for wrench in received] == [0] * 100
    assert np.diff([wrench.seq for wrench in received]).tolist() == [1] * 99
    assert all(wrench.valid.shape == (28, 12) for wrench in received)


def test_async_twin_and_every_key(daemon):
    async def listen():
        newest = {}
        async with insole_daemon.connect(daemon.endpoint) as insole:
            async for message in insole.messages("insole/**"):
                newest[type(message)] = message
                if len(newest) >= 5:
                    break
            meta = await asyncio.to_thread(insole.meta, "right")
        return newest, meta

    with daemon.boards():
        newest, meta = asyncio.run(listen())
    assert {cls.SCHEMA for cls in newest} <= {cls.SCHEMA for cls in BY_KEY.values()}
    assert meta.foot == "right"


def test_late_joiner_gets_meta_and_calibration(daemon):
    time.sleep(0.3)
    with insole_daemon.connect(daemon.endpoint) as insole:
        meta, calibration = insole.meta("left"), insole.calibration("left")
        assert insole.feet() == [("test", "left"), ("test", "right")]
    assert meta.n_triangles == 28
    assert meta.layout_builtin
    assert meta.calibration_builtin
    assert calibration.coefficients_pa.shape == (28, 12, calibration.n_coefficients)
    assert calibration.builtin


def test_late_advanced_subscriber_gets_meta_from_the_cache(daemon):
    time.sleep(0.3)
    arrived, samples = threading.Event(), []

    def receive(sample):
        samples.append(sample)
        arrived.set()

    with open_session("client", connect=[daemon.endpoint]) as session:
        subscriber = zenoh.ext.declare_advanced_subscriber(
            session,
            "insole/test/left/meta",
            receive,
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
        )
        assert arrived.wait(5)
        subscriber.undeclare()
    assert Meta.decode(samples[0].payload.to_bytes(), str(samples[0].encoding)).foot == "left"


def test_wildcards_do_what_they_look_like(daemon):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        everywhere = take(insole.messages("insole/*/*/wrench"), 20)
        left = take(insole.messages("insole/*/left/**"), 200)
    assert {type(message).__name__ for message in everywhere} == {"Wrench"}
    assert {message.foot for message in everywhere} == {"left", "right"}
    assert {message.foot for message in left} == {"left"}
    assert {type(message).__name__ for message in left} >= {"Raw", "Pressure", "Wrench", "Health"}


def test_presence_ends_with_the_daemon(daemon):
    there, gone = threading.Event(), threading.Event()

    def tell(sample):
        (there if sample.kind == zenoh.SampleKind.PUT else gone).set()

    with open_session("client", connect=[daemon.endpoint]) as session:
        subscriber = session.liveliness().declare_subscriber("insole/test/left/alive", tell, history=True)
        assert there.wait(5)
        daemon.process.kill()
        assert gone.wait(5)
        subscriber.undeclare()


def test_client_reconnects_when_the_daemon_restarts(daemon):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        wrenches = insole.wrenches("left")
        before = take(wrenches, 20)[-1]
        assert daemon.end()[0] == 0
        daemon.start()
        after = next(wrench for wrench in wrenches if wrench.started_ns != before.started_ns)
    assert after.seq < 500
    assert after.lost == 0, "a restart is no loss"


def wrench(seq: int, started_ns: int = 1) -> Wrench:
    none = np.zeros(1, np.float32)
    mark = np.zeros((1, 12), np.uint8)
    return Wrench(
        "left", seq, started_ns, 0, 0, 1, *[0.0] * 8, 0.0, 0.0, mark, none, none.astype(np.uint8), False, "static", 0.0
    )


def test_gaps_in_the_sequence_are_counted_as_lost(endpoint):
    with (
        open_session("peer", [endpoint]) as session,
        FootPublisher(session, "gaps", "left") as publisher,
        insole_daemon.connect(endpoint) as insole,
    ):
        wrenches = insole.wrenches("left")
        time.sleep(0.2)
        for seq, started_ns in ((5, 1), (6, 1), (9, 1), (10, 1), (2, 2), (40, 3), (42, 3)):
            publisher.publish(wrench(seq, started_ns))
        assert [w.lost for w in take(wrenches, 7)] == [0, 0, 2, 0, 0, 0, 1]


def test_a_foot_is_seen_once_it_can_be_asked(endpoint):
    (left,) = load_feet(Config(insoles=Config().insoles[:1]))
    with (
        open_session("peer", [endpoint]) as session,
        FootPublisher(session, "asked", "left") as publisher,
        insole_daemon.connect(endpoint) as insole,
    ):
        assert insole.feet() == []
        publisher.publish_latched("meta", left.meta())
        publisher.announce()
        until = time.monotonic() + PATIENCE_S
        while not insole.feet() and time.monotonic() < until:
            pass
        assert insole.meta("left").rig == left.config.rig


def test_a_missing_daemon_is_reported_with_a_remedy():
    with pytest.raises(WireError, match="nobody answers on tcp/127.0.0.1:9.*insole run"):
        insole_daemon.connect("tcp/127.0.0.1:9").open()


def test_a_daemon_that_cannot_answer_for_seconds_is_waited_for(daemon):
    daemon.process.send_signal(signal.SIGSTOP)
    resume = threading.Timer(3.5, daemon.process.send_signal, [signal.SIGCONT])
    resume.start()
    try:
        with insole_daemon.connect(daemon.endpoint) as insole:
            assert insole.feet() == [("test", "left"), ("test", "right")]
    finally:
        resume.join()


def test_a_port_that_never_answers_is_distinguished_from_a_closed_one():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        endpoint = f"tcp/127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(WireError, match=f"{endpoint} gave no answer for .*too little CPU"):
            insole_daemon.connect(endpoint).open()


def test_a_missing_foot_is_reported(daemon):
    with insole_daemon.connect(daemon.endpoint, rig="other") as insole:
        with pytest.raises(WireError, match="insole/other/left/meta"):
            insole.meta("left")


def test_use_before_opening_is_refused_with_a_message():
    with pytest.raises(WireError, match="with insole_daemon.connect"):
        insole_daemon.connect().wrenches("left")


SLEEPER = """
import sys, time, zenoh
from insole_daemon.wire.session import open_session
with open_session("client", connect=[sys.argv[1]]) as session:
    subscriber = session.declare_subscriber("insole/**", lambda sample: time.sleep(60))
    print("ready", flush=True)
    time.sleep(60)
"""


def test_a_subscriber_that_stops_reading_costs_nobody_else_a_cycle(daemon):
    stuck = subprocess.Popen([sys.executable, "-c", SLEEPER, daemon.endpoint], stdout=subprocess.PIPE, text=True)
    try:
        assert stuck.stdout.readline() == "ready\n"
        with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
            wrenches = insole.wrenches("left")
            take(wrenches, 10)
            received = take(wrenches, 750)  # 15 s: every buffer to the stuck one is full after 11
        assert sum(w.lost for w in received) == 0
        # Who waits for the stuck one waits for seconds, until its link is given up; a busy host is late for less.
        assert np.diff([w.t_published_ns for w in received]).max() < 2e9
    finally:
        stuck.kill()
        stuck.wait()
        stuck.stdout.close()


@pytest.fixture
def mixed(endpoint):
    """What puts a kind of a newer daemon, rubbish, another version, and a wrench, and a client that listens to it."""

    def put(seq):
        for what, payload, encoding in (
            ("novel", b"\x00", "application/msgpack;insole.novel/1"),
            ("wrench", b"rubbish", f"application/msgpack;{Wrench.SCHEMA}"),
            ("wrench", wrench(seq).encode(), "application/msgpack;insole.wrench/99"),
        ):
            # as urgent as the wrench that follows, or that comes first
            session.put(f"insole/mixed/left/{what}", payload, encoding=encoding, priority=zenoh.Priority.REAL_TIME)
        publisher.publish(wrench(seq))

    with (
        open_session("peer", [endpoint]) as session,
        FootPublisher(session, "mixed", "left") as publisher,
        insole_daemon.connect(endpoint) as insole,
    ):
        yield insole, put


def test_a_subscription_to_all_keys_ignores_foreign_messages(mixed, caplog):
    insole, put = mixed
    messages = insole.messages("insole/**")
    time.sleep(0.2)
    put(1)
    put(2)
    assert [(type(m), m.seq) for m in take(messages, 2)] == [(Wrench, 1), (Wrench, 2)]
    assert messages.refused == 4
    assert [record.message for record in caplog.records if "insole/mixed/left/wrench: passed over" in record.message]
    assert len(caplog.records) == 1, "once a key; a kind that is not known is not worth a word"


def test_async_twin_passes_over_the_same(mixed):
    insole, put = mixed
    messages = insole.messages("insole/mixed/*/*")
    time.sleep(0.2)
    put(1)
    assert asyncio.run(asyncio.wait_for(anext(messages), 5)).seq == 1
    assert messages.refused == 2


def test_a_subscription_to_one_message_reports_another_version_of_it(mixed):
    insole, put = mixed
    wrenches = insole.wrenches("left")
    time.sleep(0.2)
    put(1)
    with pytest.raises(WireError, match="expected a msgpack map"):
        next(wrenches)
    with pytest.raises(WireError, match="insole.wrench/99"):
        next(wrenches)
    with pytest.raises(WireError, match="expected a key ending in one of raw, .*install the same insole-daemon"):
        insole.messages("insole/mixed/left/novel")
