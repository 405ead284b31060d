"""Loss: lost frames; the count keeps its last received value."""

from __future__ import annotations

import numpy as np

from ...skin.geometry import N_TAXELS
from ..law import Array, Law, Moments, Parameter, Site, Values
from ..sampling import Losses

_IN_HALF_A = 7  # number of taxels


class _FrameLoss:
    """Loses frames of whole boards, in the order they are sent: triangles ascending, half A, half B."""

    def __init__(self, values: Values, site: Site) -> None:
        share, run = (np.broadcast_to(values[name], site.columns.shape) for name in ("share", "run"))
        identities = site.layout.identities[site.columns[::N_TAXELS] // N_TAXELS]
        self._boards = []
        for board in np.unique(identities[:, 0]).tolist():
            rows = np.flatnonzero(identities[:, 0] == board)
            rows = rows[np.argsort(identities[rows, 1])]
            first = rows[0] * N_TAXELS
            self._boards.append((Losses(float(share[first]), float(run[first]), site.seed, board), rows))
        self._last: Array | None = None

    def __call__(self, x: Array, moments: Moments) -> Array:
        n, m = x.shape
        missing = np.zeros((n, m // N_TAXELS, N_TAXELS), np.bool_)
        for losses, rows in self._boards:
            halves = losses.draw_losses(n * 2 * len(rows)).reshape(n, len(rows), 2)
            missing[:, rows, :_IN_HALF_A] = halves[..., :1]
            missing[:, rows, _IN_HALF_A:] = halves[..., 1:]
        received = np.concatenate([x[:1] if self._last is None else self._last[None], x])
        row = np.where(missing.reshape(n, m), 0, np.arange(1, n + 1)[:, None])
        y: Array = np.take_along_axis(received, np.maximum.accumulate(row, axis=0), axis=0)
        self._last = y[-1].copy()
        return y


def _find_problem(values: Values) -> tuple[str, str] | None:
    share, run = float(values["share"].max()), float(values["run"].min())
    if share <= run / (1 + run):
        return None
    return "share", f"expected at most run/(1 + run), which is {run / (1 + run):g}, found {share:g}"


LAW = Law(
    word="loss",
    order=10,
    domain="count",
    equation="c ← the last that came; each frame is lost or not by Gilbert's chain with `share` and mean `run`",
    source="E. N. Gilbert, Bell Syst. Tech. J. 39 (1960) 1253–1265",
    parameters=(
        Parameter("share", "1", 0.0, 0.9, (1e-4, 0.05), "fraction of a board's frames that are lost"),
        Parameter("run", "1", 1.0, 1e5, (1.0, 50.0), "mean number of frames lost in a row"),
    ),
    forward=_FrameLoss,
    inverse=None,
    inverse_is="none: lost readings cannot be restored. Ignore stale readings instead",
    scopes=("insole", "board"),
    find_problem=_find_problem,
)
