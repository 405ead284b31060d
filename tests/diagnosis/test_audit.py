"""The audit on readings in which nothing is wrong, and in which something is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insole_daemon.diagnosis.audit import audit
from insole_daemon.recording.loading import load

from . import chamber


def test_noise_alone_is_no_burst(tmp_path: Path) -> None:
    # All triangles and a minute and a half: what chance does in half a second of one of so many taxels.
    recording = load(chamber.write(tmp_path / "quiet", layout=chamber.WHOLE))
    assert audit(recording.feet[0], "quiet").findings == ()


def test_a_burst_is_told_with_its_place_and_time(tmp_path: Path) -> None:
    def loud(t_s: chamber.Array, counts: chamber.Array) -> None:
        rows, rng = (t_s > 40) & (t_s < 43), np.random.default_rng(5)
        counts[rows, 12:24] += rng.normal(0.0, 5.0, (rows.sum(), 12))

    recording = load(chamber.write(tmp_path / "loud", touch=loud))
    (found,) = audit(recording.feet[0], "loud").findings
    identity = tuple(recording.feet[0].layout.identities[1].tolist())
    assert (found.effect, found.where.ids) == ("noise_burst", (identity,))
    ((began, ended),) = found.when_s
    assert began == np.clip(began, 37.5, 40.5)
    assert ended == np.clip(ended, 42.5, 45.5)


def test_rest_counts_beyond_the_range_make_no_taxel_dead(tmp_path: Path) -> None:
    def wandered(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[t_s > 55] += 25.0

    recording = load(chamber.write(tmp_path / "railed", touch=wandered))
    found = audit(recording.feet[0], "railed")
    assert found.kept.sum() == len(chamber.SLOTS)
    assert 0.5 < found.cycles.mean() < 0.95


def test_noise_that_makes_all_leap_is_no_loose_contact(tmp_path: Path) -> None:
    def rough(t_s: chamber.Array, counts: chamber.Array) -> None:
        loaded = counts < 215
        counts[loaded] += np.random.default_rng(6).normal(0.0, 14.0, loaded.sum())

    recording = load(chamber.write(tmp_path / "rough", touch=rough))
    assert audit(recording.feet[0], "rough").kept.sum() == len(chamber.SLOTS)


def test_an_insole_most_of_which_is_not_there_is_one_finding(tmp_path: Path) -> None:
    def absent(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[:, 24:] = 240.0  # one number, as a host sends it for what is not connected
        counts[:, 24:26] += np.random.default_rng(7).normal(0.0, 1.0, (len(t_s), 2))  # lines that pick something up

    recording = load(chamber.write(tmp_path / "absent", touch=absent))
    found = audit(recording.feet[0], "absent")
    (told,) = found.findings
    identities = [tuple(identity) for identity in recording.feet[0].layout.identities.tolist()]
    assert (told.effect, told.where.ids, told.when_s) == ("open_triangle", tuple(identities[2:]), ())
    assert "all along" in told.sentence
    assert not found.kept[2:].any()
    assert found.kept[:2].sum() == 20


def test_what_is_beyond_the_range_for_a_while_is_not_dead_and_is_believed_elsewhere(tmp_path: Path) -> None:
    def too_sensitive(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[:, :3] -= 5.0 * (240.0 - counts[:, :3]) + 170.0  # at 0 beyond a quarter of the load

    recording = load(chamber.write(tmp_path / "beyond", touch=too_sensitive))
    found = audit(recording.feet[0], "beyond")
    assert found.findings == ()
    at_the_end = recording.feet[0].counts[:, 0, 0] == 0
    assert at_the_end.mean() > 0.3  # what a dead taxel is called from
    assert not found.believed[at_the_end, 0, 0].any()
    assert found.believed[~at_the_end, 0, 0].all()
    assert found.cycles.all()


def test_what_snaps_with_the_load_is_no_loose_contact_and_what_leaps_without_is(tmp_path: Path) -> None:
    def snapping(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[:, :12] -= 60.0 * (np.interp(t_s, *chamber.load()) > 150e3)[:, None]
        counts[(t_s % 9.0) < 0.3, 12] -= 60.0

    recording = load(chamber.write(tmp_path / "snapping", touch=snapping))
    (found,) = audit(recording.feet[0], "snapping").findings
    identity = (*recording.feet[0].layout.identities[1].tolist(), 0)
    assert (found.effect, found.where.ids) == ("dead_taxels", (identity,))


def test_repeats_are_told_one_by_one_and_cost_no_cycle(tmp_path: Path) -> None:
    again = np.random.default_rng(4).random(4500) < 0.3
    again[0] = False

    folder = chamber.write(tmp_path / "again")
    whole = np.load(folder / "counts.npz")
    arrays = {name: whole[name].copy() for name in whole.files}
    (name,) = [each for each in arrays if each.endswith("counts")]
    n = len(arrays[name])
    again = again[:n]
    last = np.maximum.accumulate(np.where(again, 0, np.arange(n)))
    arrays[name][:, :2] = arrays[name][last, :2]
    np.savez(folder / "counts.npz", **arrays)
    recording = load(folder)
    found = audit(recording.feet[0], "again")
    (finding,) = found.findings
    identities = tuple(tuple(each) for each in recording.feet[0].layout.identities[:2, :1].tolist())
    assert (finding.effect, finding.where.ids) == ("frame_loss", identities[:1])
    told = ~found.believed[:, 0, 0]
    assert np.mean(told == again) > 0.99
    assert found.cycles.all()


def test_an_open_triangle_is_believed_while_it_has_contact(tmp_path: Path) -> None:
    def opened(t_s: chamber.Array, counts: chamber.Array) -> None:
        counts[(t_s > 30) & (t_s < 37), 12:24] = -9.0

    recording = load(chamber.write(tmp_path / "open", touch=opened))
    audited = audit(recording.feet[0], "open")
    (finding,) = audited.findings
    assert finding.effect == "open_triangle"
    assert audited.kept.sum() == len(chamber.SLOTS)
    assert audited.cycles.all()
    out = ~audited.believed[:, 1, 0]
    assert 0.06 < out.mean() < 0.1


def test_noise_that_goes_with_the_load_is_told_and_makes_no_taxel_loose(tmp_path: Path) -> None:
    def restless(t_s: chamber.Array, counts: chamber.Array) -> None:
        bears = np.interp(t_s, *chamber.load()) / 300e3
        counts += np.random.default_rng(8).normal(0.0, 1.0, counts.shape) * 14.0 * bears[:, None]

    recording = load(chamber.write(tmp_path / "restless", touch=restless))
    found = audit(recording.feet[0], "restless")
    (told,) = found.findings
    assert (told.effect, told.where.scope) == ("unknown", "insole")
    assert found.kept.sum() == len(chamber.SLOTS)
    assert found.cycles.all()


def test_the_calmest_taxel_of_a_board_that_bursts_is_not_believed_either(tmp_path: Path) -> None:
    def loud(t_s: chamber.Array, counts: chamber.Array) -> None:
        rows, rng = (t_s > 40) & (t_s < 43), np.random.default_rng(5)
        counts[rows, :23] += rng.normal(0.0, 5.0, (rows.sum(), 23))

    recording = load(chamber.write(tmp_path / "calm", touch=loud))
    found = audit(recording.feet[0], "calm")
    (told,) = found.findings
    assert (told.effect, told.where.ids) == ("noise_burst", ((5,),))
    assert found.believed[:, 1, 11].mean() < 0.98
