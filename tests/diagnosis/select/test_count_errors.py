"""Shares that are fitted to a part of the rows."""

from __future__ import annotations

import numpy as np

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.select import count_errors

from ..chamber import bouc_wen, write


def test_shares_of_held_out_rows_have_the_bounds_of_the_law(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", bouc_wen(0.4, 60e3), seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    design = block_design(KnownLoad(seen), seen.weight_variance**-0.5)
    chosen = next(k for k, c in enumerate(design.candidates) if c.word == "hysteresis" and c.where.scope == "insole")
    refined = refine(design, (chosen,))
    law = refined.of_laws
    active = count_errors._columns(law)
    own = design.y
    rows = np.arange(own.shape[1]) % 5 != 0
    n = int(np.count_nonzero(law.shares[0]))
    assert n > 0

    def shares(y):
        return count_errors._fit(active, y, law.design, rows)[0][:n]

    bound = law.design.candidates[0].term.sum_bound(True)
    explained = law.design.contribution(law.design.candidates[0], law.shares[0])
    np.testing.assert_allclose(shares(explained).sum(), law.shares[0].sum(), rtol=0.05)
    assert np.all(shares(-explained) >= 0.0)
    assert shares(20.0 * explained).sum() <= 1.05 * bound  # the bound is enforced by a heavily weighted row
