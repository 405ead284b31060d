"""Jitter: time stamps are late by random amounts."""

from __future__ import annotations

import numpy as np

from ...skin.geometry import N_TAXELS
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values
from ..past import SignalHistory
from ..sampling import Jitter


def _forward(values: Values, site: Site) -> Operator:
    """Return each board's columns as they were a random delay ago; times never go back."""
    std_s = np.broadcast_to(values["std_s"], site.columns.shape)
    board_of_column = site.layout.identities[site.columns // N_TAXELS, 0]
    boards = []
    for board in np.unique(board_of_column).tolist():
        board_columns = np.flatnonzero(board_of_column == board)
        boards.append((Jitter(float(std_s[board_columns[0]]), site.seed, board), board_columns))
    history, newest_s = SignalHistory(), np.full(len(boards), -np.inf)

    def forward(x: Array, moments: Moments) -> Array:
        wanted = []
        for i, (jitter, columns) in enumerate(boards):
            taken_s = np.maximum.accumulate(moments.t_s - jitter.draw_delays_s(len(x)))
            taken_s = np.maximum(taken_s, newest_s[i])
            newest_s[i] = taken_s[-1]
            wanted.append((taken_s, columns))
        return history.at(x, moments.t_s, wanted)

    return forward


LAW = Law(
    word="jitter",
    order=10,
    domain="count",
    equation="c(t) ← c(t − j), j = |N(0, std²)| drawn anew for each sample of a board; the order stays",
    source="queues and interrupts between tick and stamp: half-normal, an assumption; about 1 ms on a busy bus",
    parameters=(Parameter("std_s", "s", 0.0, 0.1, (1e-4, 5e-3), "scale of the delay, whose mean is 0.8 of it"),),
    forward=_forward,
    inverse=None,
    inverse_is="none: the delay of a single reading is unknown. Correct the mean delay by the time stamp",
    late_s=lambda values: np.sqrt(2.0 / np.pi) * values["std_s"],
    scopes=("insole", "board"),
)
