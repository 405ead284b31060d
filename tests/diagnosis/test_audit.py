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
