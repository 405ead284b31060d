"""What the sensors of an insole make of a load: the effects and the static curves of `physics.Chain`, for the boards.

The chain has memory and boards ask at moments of their own, so it runs on a grid of GRID_S, and what is between two
of its moments is taken as linear. Answers are those of one run from t = 0, whoever asks for what and in which order.
Converters, digitisers and frames are the boards' own, so the effects OF_BOARDS are not the chain's: they go there.
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
from ..physics.run import Run
from ..skin.geometry import N_TAXELS
from ..skin.layout import Foot, Layout
from .load import Load
from .reference_insole import reference_insole
from .sensors import Temperature

GRID_S = 0.01
OF_BOARDS = ("sample_and_hold", "bit_shift", "jitter", "loss")
_AT_ONCE = 32  # moments of the grid that are worked out together: some 1 ms of a live stream
_KEPT = 96 * _AT_ONCE  # moments, 30 s: whoever asks for what was earlier has it worked out anew


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedInsole:
    """A simulated insole: its boards, where its taxels lie, its true static curves, and what else it does to a load."""

    layout: Layout
    boards: Sequence[Board]
    calibration: Calibration
    effects: Sequence[Effect] = ()

    @property
    def chain(self) -> Chain:
        """All of it but what is the boards' own."""
        kept = [effect for effect in self.effects if effect.law.word not in OF_BOARDS]
        return Chain(kept, self.layout, self.calibration, self.boards)

    def of_boards(self, word: str) -> dict[int, Mapping[str, float]]:
        """By board, the values of the effect `word` on it. SimulationError where it has two."""
        found: dict[int, Mapping[str, float]] = {}
        for effect in self.effects:
            if effect.law.word != word:
                continue
            rows = dict.fromkeys((effect.where.slots(self.layout) // N_TAXELS).tolist())
            for board in dict.fromkeys(self.layout.triangles[row].board for row in rows):
                if board in found:
                    raise SimulationError(
                        f"the effect {word}: where.ids: expected each board once, found board {board} twice: "
                        "it has one converter rate, and one way to the host"
                    )
                found[board] = {name: float(value) for name, value in effect.values.items()}
        return found

    def shifts(self) -> dict[int, dict[int, int]]:
        """By board and triangle, the shift that a `bit_shift` has in truth."""
        found: dict[int, dict[int, int]] = {}
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
                found.setdefault(triangle.board, {})[triangle.triangle] = int(effect.values["shift"])
        return found


class SensedLoad:
    """A Load as boards whose sensors are all alike need it, to read what the sensors of `insoles` read.

    Such a sensor is a line: its pressure is the mean activation times the nominal Pa per count.
    """

    def __init__(
        self, load: Load, insoles: Sequence[SimulatedInsole], temperature_c: Temperature | None = None
    ) -> None:
        """`load` gives the pressure where the taxels really lie; `temperature_c` of all insoles, as for a board."""
        self._load = load
        self._temperature_c = temperature_c
        self._pa_per_count = reference_insole().pa_per_count
        self._insoles: Mapping[Foot, SimulatedInsole] = {insole.layout.foot: insole for insole in insoles}
        self._chains = {foot: insole.chain for foot, insole in self._insoles.items()}
        self._felt: dict[Foot, _Felt] = {}

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """See Load; `t_s` from 0 on."""
        if not len(t_s):
            return self._load.pressure_pa(foot, t_s)
        at = t_s / GRID_S
        before = np.floor(at).astype(np.int64)
        first = int(before.min())
        felt = self._felt.get(foot)
        if felt is None or first < felt.first:
            felt = self._felt[foot] = _Felt(self._chains[foot].forward(), len(self._insoles[foot].layout))
        while felt.end < int(before.max()) + 2:
            self._go_on(foot, felt, first)
        part = (at - before)[:, None, None]
        since, until = felt.at(before), felt.at(before + 1)
        until -= since
        until *= part
        since += until
        return since

    def _go_on(self, foot: Foot, felt: _Felt, needed: int) -> None:
        t_s = np.arange(felt.end, felt.end + _AT_ONCE).astype(np.float64) * GRID_S
        load_pa = self._load.pressure_pa(foot, t_s)
        warm = None if self._temperature_c is None else self._temperature_c(t_s)
        counts = felt.run(load_pa, t_s, warm)
        activation = self._insoles[foot].calibration.baseline_count - counts
        felt.keep(np.where(np.isnan(activation), 0.0, activation) * self._pa_per_count, needed)


class _Felt:
    """One run of a chain, and what it has given last, a row a moment of the grid."""

    def __init__(self, run: Run, n_triangles: int) -> None:
        self.run = run
        self.first = self.end = 0  # of what is kept
        self._rows = np.empty((0, n_triangles, N_TAXELS))

    def keep(self, block: NDArray[np.float64], needed: int) -> None:
        """Add what comes next; what is old may go, but nothing from the moment `needed` on."""
        used = self.end - self.first
        if used + len(block) > len(self._rows):
            oldest = min(needed, max(self.end - _KEPT, self.first))
            kept = self._rows[oldest - self.first : used]
            self._rows = np.empty((2 * max(len(kept), _KEPT), *kept.shape[1:]))
            self._rows[: len(kept)] = kept
            self.first, used = oldest, len(kept)
        self._rows[used : used + len(block)] = block
        self.end += len(block)

    def at(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, n_triangles, 12) of the moments `rows` (n,)."""
        return self._rows[rows - self.first]
