"""How the noise of readings enters columns that are computed from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import LoadEstimate
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.terms import delay, lag
from insole_daemon.recording import counts as counts_file

from ..chamber import LAYOUT
from ..foot.shoe import PA_PER_COUNT, write

NOISE_COUNT = 1.5
AGE_MS = np.repeat([1e-3, 7.0, 12.0], 2)  # of the triangles of three boards: their readings lie between the rows


def walk(folder, sign):
    """Return a walk whose readings have the same noise of NOISE_COUNT, times `sign`."""

    def touch(t_s, read):
        read += sign * np.random.default_rng(5).normal(0.0, NOISE_COUNT, read.shape)

    write(folder, touch=touch)
    (table,) = counts_file.read(folder / "counts.npz", {"left": len(LAYOUT)}).values()
    aged = replace(table, age_ms=np.broadcast_to(AGE_MS.astype(np.float32), table.age_ms.shape))
    counts_file.write(folder / "counts.npz", {"left": aged})
    recording = insole_daemon.load(folder)
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    return LoadEstimate(seen)


@pytest.mark.parametrize(("term", "setting"), [(delay.TERM, {"delay_s": 0.015}), (lag.TERM, {"tau_s": 0.02})])
def test_the_noise_echo_of_a_column_is_that_of_interpolated_readings(tmp_path, term, setting):
    more, less = walk(tmp_path / "more", 1.0), walk(tmp_path / "less", -1.0)
    columns = [term.column_of(load, setting) for load in (more, less)]
    noise_of_rows = (more.observation.by_triangle - less.observation.by_triangle)[..., 0] / 2.0
    noise_of_column = (columns[0].by_triangle - columns[1].by_triangle)[..., 0, 0] / 2.0
    seen = more.observation
    of_readings = np.sum((seen.arms[..., 0] * PA_PER_COUNT * NOISE_COUNT) ** 2, axis=1)
    product, square = (np.mean(each[..., 0, 0] / seen.counting_variance[..., 0], axis=0) for each in columns[0].echo)
    # 1 290 rows: standard deviations of about 4 %.
    np.testing.assert_allclose(-np.mean(noise_of_rows * noise_of_column, axis=0) / of_readings, product, atol=0.1)
    np.testing.assert_allclose(np.mean(noise_of_column**2, axis=0) / of_readings, square, rtol=0.2)
