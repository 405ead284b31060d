"""Fewer cycles on a slow link, never older ones; and what is said of the same moment by others."""

from __future__ import annotations

import asyncio
import math

import numpy as np
import pytest

from insole_daemon.view import viewer as viewers
from insole_daemon.view.other_sources import OtherSources, Series, parse_reference, triple
from insole_daemon.view.viewer import Viewer, Window


class Link:
    """A link that carries `rate_hz` messages a second, and a viewer at its other end, on a clock of their own."""

    def __init__(self, monkeypatch, rate_hz, trip_s=0.005):
        self.now_s, self._rate_hz, self._trip_s = 0.0, rate_hz, trip_s
        self.shown, self._under_way, self._free_s = [], [], 0.0
        monkeypatch.setattr(viewers, "monotonic", lambda: self.now_s)
        self.viewer = Viewer()

    def run(self, seconds):
        """50 Hz of both feet; each cycle is the time at which it was made."""
        for step in range(round(seconds * 200)):
            self.now_s = step / 200
            while self._under_way and self._under_way[0][0] <= self.now_s:
                _, message = self._under_way.pop(0)
                self.shown.append((self.now_s, float(message)))
                self.viewer.answered()
            if step % 4 == 0:
                for foot in (0, 1):
                    self.viewer.queue_cycle(foot, str(self.now_s).encode())
            while (message := self.viewer.take()) is not None:
                self._free_s = max(self._free_s, self.now_s) + 1 / self._rate_hz
                self._under_way.append((self._free_s + self._trip_s, message))


def test_a_fast_link_gets_every_cycle(monkeypatch):
    link = Link(monkeypatch, rate_hz=1000)
    link.run(10)
    assert len(link.shown) >= 2 * 50 * 10 - 6
    assert max(shown - made for shown, made in link.shown) < 0.05


def test_a_link_with_high_latency_and_bandwidth_gets_every_cycle(monkeypatch):
    link = Link(monkeypatch, rate_hz=1000, trip_s=0.2)
    link.run(10)
    late = [made for shown, made in link.shown if shown > 3]
    assert len(late) >= 2 * 50 * 6.8


@pytest.mark.parametrize("rate_hz", [10.0, 25.0])
def test_a_slow_link_gets_fewer_cycles_and_never_older_ones(monkeypatch, rate_hz):
    link = Link(monkeypatch, rate_hz)
    link.run(20)
    late = [(shown, made) for shown, made in link.shown if shown > 5]
    assert 0.7 * rate_hz * 15 < len(late) <= rate_hz * 15 + 2, "what it carries, it gets"
    ages = np.array([shown - made for shown, made in late])
    assert np.median(ages) < 0.45
    assert ages.max() < 0.8
    assert [made for _, made in late] == sorted(made for _, made in late)
    assert ages[-30:].mean() < ages[:30].mean() + 0.1, "no queue builds up"


def test_texts_are_kept_and_sent_before_cycles():
    async def run():
        viewer = Viewer()
        for _ in range(viewers._FIRST - 1):
            viewer.queue_text("before")
            await viewer.next()
        viewer.queue_cycle(0, b"old")
        viewer.queue_cycle(1, b"right")
        viewer.queue_cycle(0, b"new")
        viewer.queue_text("one")
        viewer.queue_text("two")
        sent = []
        for _ in range(4):
            sent.append(await viewer.next())
            viewer.answered()
        return sent

    assert asyncio.run(run()) == ["one", "two", b"right", b"new"]


def test_cycles_that_come_together_are_all_sent_where_there_is_room():
    viewer = Viewer()
    for packet in (b"1", b"2", b"3"):
        viewer.queue_cycle(0, packet)
    assert [viewer.take() for _ in range(4)] == [b"1", b"2", b"3", None]


def test_acknowledgements_without_a_message_do_not_grow_the_window():
    window = Window()
    for _ in range(1000):
        window.answered(1.0)
    sent = 0
    while window.room >= 1:
        window.sent(2.0)
        sent += 1
    assert sent <= viewers._FIRST


def test_a_value_between_two_moments_and_none_far_from_any():
    series = Series()
    assert series.at(0) is None
    series.add(100_000_000, np.array([0.0, 10.0]))
    series.add(120_000_000, np.array([2.0, 20.0]))
    assert series.at(105_000_000).tolist() == [0.5, 12.5]
    assert series.at(120_000_000).tolist() == [2.0, 20.0]
    assert series.at(150_000_000).tolist() == [2.0, 20.0]
    assert series.at(90_000_000).tolist() == [0.0, 10.0]
    assert series.at(200_000_000) is None
    assert series.at(20_000_000) is None
    series.add(50_000_000, np.array([7.0, 7.0]))
    assert series.at(50_000_000).tolist() == [7.0, 7.0], "their clock was set"


def test_a_reading_of_a_reference():
    assert parse_reference(b'{"fz_n": 1, "mx_nm": 2.5, "my_nm": null, "more": 4}').tolist()[:2] == [1, 2.5]
    for bad in (b"", b"[]", b'{"fz_n": 1}', b'{"fz_n": "x", "mx_nm": 1, "my_nm": 1}', b"\xff"):
        assert parse_reference(bad) is None
    assert all(math.isnan(each) for each in triple(None))


def test_a_simulation_of_another_layout_gives_no_residual():
    others = OtherSources("simulation", {})
    others._pressure["left"].add(10, np.zeros((3, 12)))
    assert others.at("left", 10, (28, 12)).pressure_pa is None
    assert others.at("left", 10, (3, 12)).pressure_pa is not None
