"""The audit on taxels with and without contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insole_daemon.diagnosis.audit import audit
from insole_daemon.recording.loading import load

from . import chamber
from .chamber import Array


def test_working_taxels_give_no_finding(tmp_path: Path) -> None:
    recording = load(chamber.write(tmp_path / "quiet", layout=chamber.WHOLE))
    assert audit(recording.feet[0], "quiet").findings == ()


def test_taxels_with_baselines_beyond_the_range_are_not_dead(tmp_path: Path) -> None:
    def wandered(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[t_s > 55] += 25.0

    recording = load(chamber.write(tmp_path / "railed", touch=wandered))
    found = audit(recording.feet[0], "railed")
    assert found.usable_taxels.sum() == len(chamber.SLOTS)


def test_noise_of_all_taxels_is_no_loose_contact(tmp_path: Path) -> None:
    def rough(t_s: chamber.Array, counts: chamber.Array) -> None:
        loaded = counts < 215
        counts[loaded] += np.random.default_rng(6).normal(0.0, 14.0, loaded.sum())

    recording = load(chamber.write(tmp_path / "rough", touch=rough))
    assert audit(recording.feet[0], "rough").usable_taxels.sum() == len(chamber.SLOTS)


def test_a_burst_of_noise_of_one_triangle_is_no_loose_contact(tmp_path: Path) -> None:
    def loud(t_s: chamber.Array, counts: chamber.Array) -> None:
        while_loud = (t_s > 20) & (t_s < 50)
        counts[np.ix_(while_loud, range(10))] += np.random.default_rng(3).normal(0.0, 16.0, (while_loud.sum(), 10))

    recording = load(chamber.write(tmp_path / "loud", touch=loud))
    found = audit(recording.feet[0], "loud")
    assert found.findings == ()
    assert found.usable_taxels.sum() == len(chamber.SLOTS)


def test_a_mostly_unconnected_insole_gives_one_finding(tmp_path: Path) -> None:
    def absent(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[:, 24:] = 240.0  # one number, as a host sends it for what is not connected
        counts[:, 24:26] += np.random.default_rng(7).normal(0.0, 1.0, (len(t_s), 2))  # lines that pick something up

    recording = load(chamber.write(tmp_path / "absent", touch=absent))
    found = audit(recording.feet[0], "absent")
    (told,) = found.findings
    identities = [tuple(identity) for identity in recording.feet[0].layout.identities.tolist()]
    assert (told.effect, told.where.ids, told.when_s) == ("open_triangle", tuple(identities[2:]), ())
    assert "all along" in told.sentence
    assert not found.usable_taxels[2:].any()
    assert found.usable_taxels[:2].sum() == 20


def test_a_taxel_beyond_its_range_for_a_while_is_used_at_other_times(tmp_path: Path) -> None:
    def too_sensitive(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[:, :3] -= 5.0 * (240.0 - counts[:, :3]) + 170.0  # at 0 beyond a quarter of the load

    recording = load(chamber.write(tmp_path / "beyond", touch=too_sensitive))
    found = audit(recording.feet[0], "beyond")
    assert found.findings == ()
    at_the_end = recording.feet[0].counts[:, 0, 0] == 0
    assert at_the_end.mean() > 0.3  # what a dead taxel is called from
    assert not found.usable_readings[at_the_end, 0, 0].any()
    assert found.usable_readings[~at_the_end, 0, 0].all()


def test_a_leap_with_the_load_is_no_loose_contact_and_one_without_is(tmp_path: Path) -> None:
    def snapping(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[:, :12] -= 60.0 * (np.interp(t_s, *chamber.load()) > 150e3)[:, None]
        counts[(t_s % 9.0) < 0.3, 12] -= 60.0

    recording = load(chamber.write(tmp_path / "snapping", touch=snapping))
    (found,) = audit(recording.feet[0], "snapping").findings
    identity = (*recording.feet[0].layout.identities[1].tolist(), 0)
    assert (found.effect, found.where.ids) == ("dead_taxels", (identity,))


def test_an_open_triangle_is_used_while_it_has_contact(tmp_path: Path) -> None:
    def opened(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[(t_s > 30) & (t_s < 37), 12:24] = -9.0

    recording = load(chamber.write(tmp_path / "open", touch=opened))
    audited = audit(recording.feet[0], "open")
    (finding,) = audited.findings
    assert finding.effect == "open_triangle"
    assert audited.usable_taxels.sum() == len(chamber.SLOTS)
    out = ~audited.usable_readings[:, 1, 0]
    assert 0.06 < out.mean() < 0.1


@pytest.mark.parametrize(("others", "kept"), [(30.0, True), (0.0, False)])
def test_a_blow_to_all_taxels_of_a_triangle_is_no_loose_contact(tmp_path: Path, others: float, kept: bool) -> None:
    def touch(t_s: Array, counts: Array) -> None:
        for row in range(400, 1600, 200):
            counts[row, 12:24] -= others
            counts[row, 15] -= 70.0 - others

    foot = load(chamber.write(tmp_path / "blows", touch=touch, seconds=40.0)).feet[0]
    assert audit(foot, "blows", steps=True).usable_taxels[1, 3] == kept
