"""The fingerprint of a loose triangle, and what is none."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from insole_daemon.config import Board
from insole_daemon.skin.faults.places import Places
from insole_daemon.skin.faults.triangles import LooseTriangles
from insole_daemon.skin.geometry import THERMAL_PADS
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
N = len(LAYOUT)
OPEN_OR_DEAD = [
    [0] * 9 + [255, 0, 0], [0] * 12, [255] * 12, [255] * 9 + [0, 255, 255],
]  # fmt: skip


def loose_of(counts: np.ndarray, no_load: int = 240) -> np.ndarray:
    boards = {address: Board(address=address, interface="can0", no_load=no_load) for address in (5, 6, 7)}
    found = LooseTriangles(Places(LAYOUT, boards))
    if found.must_update(counts):
        found.update(counts, np.ones(N, bool), 1)
    return found.loose


every_counts = arrays(np.uint8, (N, 12), elements=st.sampled_from([0, 1, 17, 239, 240, 241, 254, 255]))


@given(every_counts, st.integers(0, N - 1), st.sampled_from(OPEN_OR_DEAD))
def test_what_the_firmware_makes_of_an_open_line_is_loose(counts, row, fingerprint):
    counts[row] = fingerprint
    assert loose_of(counts)[row]


@given(every_counts, st.integers(0, N - 1), st.sampled_from(OPEN_OR_DEAD), st.booleans())
def test_one_half_that_is_newer_than_the_fault_is_enough(counts, row, fingerprint, half_a):
    half = slice(0, 7) if half_a else slice(7, 12)
    counts[row, half] = fingerprint[half]
    assert loose_of(counts)[row]


@given(every_counts)
def test_no_load_on_the_taxels_is_loose_while_the_pads_are_in_range(counts):
    counts[:, THERMAL_PADS] = 230
    assert not loose_of(counts).any()


@given(every_counts)
def test_at_rest_on_a_no_load_of_255_is_not_loose(counts):
    counts[:] = np.where(counts < 128, 254, 255)
    assert not loose_of(counts, no_load=255).any()
