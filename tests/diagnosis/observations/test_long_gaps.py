"""Rows of a walk in which much of the load is not read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.observing import observed

from ..foot.shoe import write


@pytest.mark.parametrize(("length_s", "is_used"), [(0.05, True), (1.0, False)])
def test_rows_in_a_long_gap_of_much_of_the_insole_are_not_used(tmp_path, length_s, is_used):
    recording = insole_daemon.load(write(tmp_path / "walk"))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    boards = seen.layout.identities[:, 0]
    readings = []
    for own, board in zip(seen.readings, boards, strict=True):
        kept = (board != boards[0]) | (own.t_s < 10.0) | (own.t_s > 10.0 + length_s)
        readings.append(replace(own, t_s=own.t_s[kept], counts=own.counts[kept], valid=own.valid[kept]))
    found = replace(seen, readings=tuple(readings)).weight_variance
    within = (seen.t_s > 10.0 + 0.2 * length_s) & (seen.t_s < 10.0 + 0.8 * length_s)
    assert within.any()
    assert np.isfinite(seen.weight_variance[within]).all()
    assert np.isfinite(found[within]).all() == is_used
    outside = ~within if is_used else np.abs(seen.t_s - 10.0 - 0.5 * length_s) > length_s
    assert np.array_equal(np.isfinite(found[outside]), np.isfinite(seen.weight_variance[outside]))
