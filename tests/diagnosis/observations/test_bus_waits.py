"""What is known of the times of readings whose frames waited for the bus."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon import config as configs
from insole_daemon.diagnosis.observations.bus_waits import bus_waits
from insole_daemon.diagnosis.observations.readings import read_triangles
from insole_daemon.recording.loading import load
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.trial import Trial

FRAME_S = 0.00013
PERIOD_S = 0.02


def sent(*bursts: tuple[str, float, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps and senders (n,) of frames in bursts without a pause: (sender, beginning, number of frames)."""
    stamps = [begin_s + FRAME_S * np.arange(n) for _, begin_s, n in bursts]
    return np.concatenate(stamps), np.concatenate([[sender] * n for sender, _, n in bursts])


def waits(t_s: np.ndarray, senders: np.ndarray, interface: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    own = senders == "own"
    first = own & (np.diff(np.where(own, t_s, -1.0), prepend=-1.0) > 0) & np.isin(np.round(t_s % PERIOD_S, 6), FIRST)
    return bus_waits(t_s, np.zeros(len(t_s), np.uint8) if interface is None else interface, own, first)


FIRST = np.round([0.002, 0.002 + 10 * FRAME_S], 6)  # when the bursts of the tests begin, within a period


def periodic(*bursts: tuple[str, float, int], periods: int = 5) -> tuple[np.ndarray, np.ndarray]:
    return sent(*((who, k * PERIOD_S + begin_s, n) for k in range(periods) for who, begin_s, n in bursts))


def test_frames_on_a_free_bus_did_not_wait():
    since_first_s, before_s = waits(*periodic(("own", 0.002, 8), ("other", 0.01, 8)))
    assert not since_first_s.any()
    assert not before_s.any()


def test_a_first_frame_behind_others_may_have_waited_since_they_began():
    t_s, senders = periodic(("other", 0.002, 10), ("own", FIRST[1], 8))
    since_first_s, before_s = waits(t_s, senders)
    assert not since_first_s.any()
    assert before_s[senders == "own"] == pytest.approx(10 * FRAME_S, abs=1e-6)
    assert not before_s[senders == "other"].any()


def test_what_others_sent_between_the_frames_of_a_board_delayed_the_later_ones():
    t_s, senders = periodic(
        ("own", 0.002, 4), ("other", 0.002 + 4 * FRAME_S, 20), ("own", 0.002 + 24 * FRAME_S, 4)
    )  # fmt: skip
    since_first_s, before_s = waits(t_s, senders)
    expected_s = np.tile([0.0] * 4 + [20 * FRAME_S] * 4, 5)
    assert since_first_s[senders == "own"] == pytest.approx(expected_s, abs=1e-6)
    assert not before_s.any()


def test_another_bus_keeps_nobody_waiting():
    t_s, senders = periodic(("other", 0.002, 10), ("own", FIRST[1], 8))
    since_first_s, before_s = waits(t_s, senders, (senders == "own").astype(np.uint8))
    assert not since_first_s.any()
    assert not before_s.any()


def test_later_frames_of_a_transmission_without_its_first_get_no_wait_of_an_earlier_one():
    t_s, senders = periodic(("own", 0.002, 8), ("other", 0.01, 40))
    kept = np.ones(len(t_s), bool)
    kept[np.flatnonzero(senders == "own")[16]] = False
    since_first_s, _ = waits(t_s[kept], senders[kept])
    assert not since_first_s.any()


@pytest.mark.parametrize(("seed", "interrupted"), [(31, 9), (37, 10)])
def test_what_other_boards_send_in_between_makes_no_triangle_late(tmp_path, seed, interrupted):
    """Other boards keep this one waiting in the middle of every transmission, for 5 and for 9 ms."""
    config = configs.load(None)
    layouts = [load_layout(insole) for insole in config.insoles]
    Trial("t6", config, layouts, conditions=Conditions(), seed=seed).write(tmp_path / "walk", 6.0)
    recording = load(tmp_path / "walk")
    right = next(foot for foot in recording.feet if foot.foot == "right")
    rows = np.flatnonzero(right.layout.identities[:, 0] == interrupted)
    log = np.loadtxt((tmp_path / "walk" / "can.log").read_text().replace("(", "").replace(")", "").splitlines(), str)
    sent_s = log[np.array([int(line.split("#")[0], 16) >> 4 & 15 for line in log[:, 2]]) == interrupted, 0].astype(
        float
    )
    frames = 2 * len(rows)
    assert np.ptp(sent_s[: len(sent_s) // frames * frames].reshape(-1, frames)[100]) > frames * FRAME_S + 0.004
    readings = [read_triangles(recording, right)[row] for row in rows]
    assert np.ptp([each.t_s[100] for each in readings]) < frames * 1.1 * FRAME_S
