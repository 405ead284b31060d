"""Apply an insole's effects and true static curves (`physics.Chain`) to a load, for the emulated boards.

The chain has memory, and boards ask for arbitrary times, so the chain runs on a grid of GRID_S with linear
interpolation in between. The results are those of one run from t = 0, in whatever order they are requested. Converters,
digitisers and frames belong to the boards, so the effects OF_BOARDS are not in the chain but passed to the boards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from ..errors import SimulationError
from ..physics.calibration import Calibration
from ..physics.chain import Chain
from ..physics.effect import Effect
from ..physics.run import ChainRun
from ..skin.geometry import N_TAXELS
from ..skin.layout import Foot, Layout
from .load import Load
from .reference_insole import reference_insole
from .sensors import Temperature

GRID_S = 0.01
OF_BOARDS = ("sample_and_hold", "bit_shift", "jitter", "loss")
_BLOCK_POINTS = 32  # grid points computed together; takes about 1 ms in a live stream
_KEPT_POINTS = 96 * _BLOCK_POINTS  # grid points kept, 30 s; earlier ones are computed again on request


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedInsole:
    """A simulated insole: its boards, layout, true static curves and effects."""

    layout: Layout
    boards: Sequence[Board]
    calibration: Calibration
    effects: Sequence[Effect] = ()

    @property
    def chain(self) -> Chain:
        """Return the chain of all effects but those of the boards."""
        chain_effects = [effect for effect in self.effects if effect.law.word not in OF_BOARDS]
        return Chain(chain_effects, self.layout, self.calibration, self.boards)

    def values_by_board(self, word: str) -> dict[int, Mapping[str, float]]:
        """Return the values of the effect `word`, by board; SimulationError if a board has two."""
        by_board: dict[int, Mapping[str, float]] = {}
        for effect in self.effects:
            if effect.law.word != word:
                continue
            rows = dict.fromkeys((effect.where.slots(self.layout) // N_TAXELS).tolist())
            for board in dict.fromkeys(self.layout.triangles[row].board for row in rows):
                if board in by_board:
                    raise SimulationError(
                        f"the effect {word}: where.ids: expected each board once, found board {board} twice: "
                        "it has one converter rate, and one way to the host"
                    )
                by_board[board] = {name: float(value) for name, value in effect.values.items()}
        return by_board

    def real_shifts(self) -> dict[int, dict[int, int]]:
        """Return the real shift of a `bit_shift`, by board and triangle; SimulationError if it is on single taxels."""
        by_board: dict[int, dict[int, int]] = {}
        for effect in self.effects:
            if effect.law.word != "bit_shift":
                continue
            if effect.where.scope == "taxel":
                raise SimulationError(
                    "the effect bit_shift: where.scope: expected insole, board or triangle, found taxel: "
                    "a board has one shift for all taxels of a triangle"
                )
            for row in dict.fromkeys((effect.where.slots(self.layout) // N_TAXELS).tolist()):
                triangle = self.layout.triangles[row]
                by_board.setdefault(triangle.board, {})[triangle.triangle] = int(effect.values["shift"])
        return by_board


class SensedLoad:
    """A load for boards with nominal sensors such that they read what the sensors of `insoles` would read.

    A nominal sensor is linear: its pressure is the mean activation times the nominal Pa per count.
    """

    def __init__(
        self, load: Load, insoles: Sequence[SimulatedInsole], temperature_c: Temperature | None = None
    ) -> None:
        """`load` is the pressure at the taxels' true positions; `temperature_c` is that of all insoles."""
        self._load = load
        self._temperature_c = temperature_c
        self._pa_per_count = reference_insole().pa_per_count
        self._insoles: Mapping[Foot, SimulatedInsole] = {insole.layout.foot: insole for insole in insoles}
        self._chains = {foot: insole.chain for foot, insole in self._insoles.items()}
        self._grid_runs: dict[Foot, _GridRun] = {}

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pressure, see Load; `t_s` ≥ 0."""
        if not len(t_s):
            return self._load.pressure_pa(foot, t_s)
        position = t_s / GRID_S
        before = np.floor(position).astype(np.int64)
        first = int(before.min())
        grid_run = self._grid_runs.get(foot)
        if grid_run is None or first < grid_run.first:
            grid_run = self._grid_runs[foot] = _GridRun(self._chains[foot].forward(), len(self._insoles[foot].layout))
        while grid_run.end < int(before.max()) + 2:
            self._compute_block(foot, grid_run, first)
        fraction = (position - before)[:, None, None]
        lower, upper = grid_run.at(before), grid_run.at(before + 1)
        upper -= lower
        upper *= fraction
        lower += upper
        return lower

    def _compute_block(self, foot: Foot, grid_run: _GridRun, needed: int) -> None:
        t_s = np.arange(grid_run.end, grid_run.end + _BLOCK_POINTS).astype(np.float64) * GRID_S
        load_pa = self._load.pressure_pa(foot, t_s)
        temperature_c = None if self._temperature_c is None else self._temperature_c(t_s)
        counts = grid_run.run(load_pa, t_s, temperature_c)
        activation = self._insoles[foot].calibration.baseline_count - counts
        grid_run.keep(np.where(np.isnan(activation), 0.0, activation) * self._pa_per_count, needed)


class _GridRun:
    """One run of a chain, and its latest results, one row per grid point."""

    def __init__(self, run: ChainRun, n_triangles: int) -> None:
        self.run = run
        self.first = self.end = 0  # range of the kept grid points
        self._rows = np.empty((0, n_triangles, N_TAXELS))

    def keep(self, block: NDArray[np.float64], needed: int) -> None:
        """Append the next block; drop old rows, but none from the grid point `needed` on."""
        used = self.end - self.first
        if used + len(block) > len(self._rows):
            oldest = min(needed, max(self.end - _KEPT_POINTS, self.first))
            kept = self._rows[oldest - self.first : used]
            self._rows = np.empty((2 * max(len(kept), _KEPT_POINTS), *kept.shape[1:]))
            self._rows[: len(kept)] = kept
            self.first, used = oldest, len(kept)
        self._rows[used : used + len(block)] = block
        self.end += len(block)

    def at(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (n, n_triangles, 12) the results at the grid points `rows` (n,)."""
        return self._rows[rows - self.first]
