"""The daemon stopped, killed, and with files that change under its hands: what a subscriber in another process sees."""

from __future__ import annotations

import itertools
import json
import signal
import time

import numpy as np

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from tests.conftest import PATIENCE_S


def test_stopped_and_continued_it_publishes_or_counts_what_has_waited(daemon):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        raws, healths = insole.raws("left"), insole.healths("left")
        time.sleep(1)
        before = next(iter(healths))
        stopped_ns = time.time_ns()
        daemon.process.send_signal(signal.SIGSTOP)
        time.sleep(1)
        daemon.process.send_signal(signal.SIGCONT)
        continued_ns = time.time_ns()
        seen = list(itertools.takewhile(lambda raw: raw.t_ns < continued_ns + 1_000_000_000, raws))
        after = next(h for h in healths if h.t_ns > continued_ns + 1_000_000_000)
    assert sum(raw.lost for raw in seen) == 0
    meanwhile = [raw for raw in seen if stopped_ns < raw.t_ns < continued_ns and not raw.repeated]
    left_out = after.cycles["skipped"] - before.cycles["skipped"]
    assert len(meanwhile) + left_out > 40, "what had waited in the kernel came, or is counted"
    assert after.bus["overflows"] == 0
    assert after.bus["clock_steps"] == 0


def test_after_a_restart_of_the_daemon_subscribers_continue(daemon):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        wrenches = insole.wrenches("left")
        before = list(itertools.islice(wrenches, 30))[-1]
        daemon.process.kill()
        assert daemon.process.wait() == -signal.SIGKILL
        daemon.process.stdout.close()
        daemon.start()
        after = next(wrench for wrench in wrenches if wrench.started_ns != before.started_ns)
        following = list(itertools.islice(wrenches, 50))
    assert after.lost == 0, "a restart is no loss"
    assert after.seq < 500
    assert sum(wrench.lost for wrench in following) == 0


def calibration(pa_per_count: float) -> str:
    """Of the left foot, the same line for every taxel."""
    taxels = [
        {"board": t.board, "triangle": t.triangle, "taxel": taxel, "baseline_count": 240.0,
         "coefficients_pa": [0.0, pa_per_count]}
        for t in load_layout(Config().insoles[0]).triangles
        for taxel in np.flatnonzero(PRESSURE_TAXELS).tolist()
    ]  # fmt: skip
    document = {"format": "insole-calibration/1", "foot": "left", "taxels": taxels, "effects": [], "provenance": {}}
    return json.dumps(document)


def test_a_calibration_replaced_while_it_is_read_is_taken_whole_or_not_at_all(daemon):
    file = daemon.config_file.with_name("left.json")
    boards = ", ".join(f"{{address: {address}, interface: can0}}" for address in (5, 6, 7))
    with daemon.config_file.open("a") as config:
        config.write(f"insoles: [{{foot: left, calibration: left.json, boards: [{boards}]}}]\n")
    texts = calibration(7000.0), calibration(9000.0)
    file.write_text(texts[0])
    daemon.end()
    daemon.start()
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        raws = insole.raws("left")

        def in_use() -> set[float]:
            return set(insole.calibration("left").coefficients_pa[:, PRESSURE_TAXELS, 1].ravel().tolist())

        seen = set()
        for text in itertools.islice(itertools.cycle(texts), 21):
            file.write_text(text[: len(text) // 2])  # as an editor that does not rename
            daemon.process.send_signal(signal.SIGHUP)
            time.sleep(0.01)
            file.write_text(text)
            daemon.process.send_signal(signal.SIGHUP)
            time.sleep(0.04)
            now = in_use()
            assert len(now) == 1, "one curve, not half of another"
            seen |= now
        file.write_text(texts[1])
        daemon.process.send_signal(signal.SIGHUP)
        until = time.monotonic() + PATIENCE_S
        while in_use() != {9000.0} and time.monotonic() < until:
            time.sleep(0.1)
        if in_use() != {9000.0}:  # where is it instead?
            daemon.process.send_signal(signal.SIGUSR1)
            time.sleep(1)
        assert in_use() == {9000.0}, "the last one, once it is whole"
        cycles = list(itertools.islice(raws, 100))
    assert seen <= {7000.0, 9000.0}
    assert sum(raw.lost for raw in cycles) == 0
