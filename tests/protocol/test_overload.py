"""The daemon's loop on a golden log, on a host where publishing takes longer than a cycle lasts."""

from __future__ import annotations

from pipeline import at_once, live

from insole_daemon.service import backlog
from insole_daemon.wire.messages import Health


def test_three_times_too_slow_it_publishes_what_is_new_and_counts_the_rest(monkeypatch):
    monkeypatch.setattr(backlog, "PATIENCE_NS", 0)  # the log is short
    monkeypatch.setattr(backlog, "OLD_NS", 40_000_000)
    everything = at_once("walk")
    published = live("walk", monkeypatch, health_every_ns=20_000_000, cycle_costs_ns=30_000_000)
    healths = [message for message in published.others if isinstance(message, Health)]
    for all_of_foot, of_foot in zip(everything.cycles, published.cycles, strict=True):
        ages_ms = [(raw.t_published_ns - raw.t_ns) * 1e-6 for raw, _, _ in of_foot]
        assert max(ages_ms) <= 100
        assert 4 <= len(of_foot) < 0.6 * len(all_of_foot)
        assert [raw.seq for raw, _, _ in of_foot] == list(range(len(of_foot)))
        counters = [health for health in healths if health.foot == of_foot[0][0].foot][-1].cycles
        assert counters["skipped"] >= 4
        assert (
            counters["published"] + counters["skipped"]
            <= len(all_of_foot)
            <= counters["published"] + counters["skipped"] + 8
        )


def test_no_cycle_is_skipped_while_the_loop_keeps_up(monkeypatch):
    monkeypatch.setattr(backlog, "PATIENCE_NS", 0)
    everything, published = at_once("walk"), live("walk", monkeypatch, cycle_costs_ns=5_000_000)
    assert [len(of_foot) for of_foot in published.cycles] == [len(of_foot) for of_foot in everything.cycles]
