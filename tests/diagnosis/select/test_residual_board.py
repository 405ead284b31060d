"""The board at which an unknown error of the wrench acts."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.observations.walk import observe_walk
from insole_daemon.diagnosis.select.residual_board import residual_board

from ..foot import shoe

NOISE = np.array([3.0, 0.1, 0.1])  # N and N·m


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    recording = insole_daemon.load(shoe.write(tmp_path_factory.mktemp("walk") / "walk"))
    foot = recording.feet[0]
    assert foot.calibration is not None
    return observe_walk(recording, foot, foot.calibration)


@pytest.mark.parametrize("board", [5, 6, 7])
def test_an_error_that_follows_the_load_of_one_board_is_at_that_board(seen, board):
    rng = np.random.default_rng(board)
    of_board = seen.by_triangle[:, seen.layout.identities[:, 0] == board].sum(axis=1)
    residual = 0.2 * np.sin(seen.t_s)[:, None] * of_board + rng.normal(0.0, NOISE, of_board.shape)
    where = residual_board(seen, residual, np.broadcast_to(1.0 / NOISE, of_board.shape))
    assert (where.scope, where.ids) == ("board", ((board,),))


def test_an_error_of_all_boards_is_of_the_insole(seen):
    rng = np.random.default_rng(1)
    residual = 0.2 * np.sin(seen.t_s)[:, None] * seen.wrench + rng.normal(0.0, NOISE, seen.wrench.shape)
    assert residual_board(seen, residual, np.broadcast_to(1.0 / NOISE, residual.shape)).scope == "insole"
