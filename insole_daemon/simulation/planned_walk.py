"""A person who walks by a plan: single stances, with turns, a stumble, standing and a lifted foot.

The effect of each kind of step on force, timing and CoP is an assumption, stated with its constant. Turning loads the
side of the foot towards the inside of the turn: Orendurff et al. 2006, Gait & Posture 23:106.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.draws import Drawn, Draws
from ..physics.portable import sin_turns, weighted_sum
from ..skin.layout import Foot, Layout
from .foot import STANCE, Person, Places, Walk, distribute_standing_force

Array = NDArray[np.float64]
LEAN_IN_TURN = 0.22  # fraction of the force on the edge towards the inside of the turn
SLOWER_IN_TURN = 1.06  # factor of stance and step times
STUMBLE = ((0.62, 0.72), (1.2, 1.1))  # factors of stance and step times of the failing and of the catching step
LIFT_S = 0.15  # time to put the weight on or off while standing


@dataclass(frozen=True, slots=True)
class PlannedStance:
    """One stance and its kind of step; `lean` is the fraction of the force on the lateral edge, medial if negative."""

    foot: Foot
    contact_s: float
    toe_off_s: float
    label: str
    lean: float = 0.0
    share: float = 1.0  # fraction of the weight on this foot while standing


class PlannedWalk(Person):
    """A Person with the stances of a plan, each with the force of a walking step or of standing."""

    def __init__(
        self,
        layouts: Sequence[Layout],
        plan: Sequence[PlannedStance],
        body_mass_kg: float = 63.0,
        seed: int = 0,
        places: Places | None = None,
    ) -> None:
        """`plan`: stances in order of contact that do not overlap on one foot."""
        super().__init__(layouts, body_mass_kg, places)
        self._walk = Walk(layouts, body_mass_kg, seed=seed)
        self.plan = tuple(plan)
        self._stances = {foot: [stance for stance in self.plan if stance.foot == foot] for foot in ("left", "right")}
        self._contacts = {
            foot: np.array([stance.contact_s for stance in stances]) for foot, stances in self._stances.items()
        }

    def region_n(self, foot: Foot, t_s: Array) -> Array:
        """Return (n_times, n_regions) the force on each region."""
        stance_of_row = np.searchsorted(self._contacts[foot], t_s, side="right") - 1
        force_n = np.zeros((len(t_s), 10))
        for index in np.unique(stance_of_row[stance_of_row >= 0]).tolist():
            stance, rows = self._stances[foot][index], stance_of_row == index
            force_n[rows] = self._stance_n(foot, stance, index, t_s[rows])
        return force_n

    def _stance_n(self, foot: Foot, stance: PlannedStance, number: int, t_s: Array) -> Array:
        """Return (n_times, n_regions) the force during one stance."""
        length_s = stance.toe_off_s - stance.contact_s
        if stance.label in ("standing", "one_leg"):
            ramp = np.clip(np.minimum(t_s - stance.contact_s, stance.toe_off_s - t_s) / LIFT_S, 0.0, 1.0)
            sway = 1.0 + 0.04 * sin_turns(0.31 * t_s)
            zeros = np.zeros_like(t_s)
            return distribute_standing_force(
                self.weight_n * stance.share * ramp * sway, 1 + 0.06 * sin_turns(0.23 * t_s), zeros, zeros
            )
        # Use stance `number` of a steady walk of that foot, with its variation, stretched to the planned time.
        phase = (t_s - stance.contact_s) / length_s
        first = number + 1.0 - (0.5 if foot == "right" else 0.0)
        steady_s = (first + STANCE * np.clip(phase, 0.0, 1.0)) * self._walk.stride_s
        steady_n = self._walk.region_n(foot, steady_s) * ((phase >= 0) & (phase < 1))[:, None]
        force = weighted_sum(steady_n, np.ones(10))
        edge = distribute_standing_force(np.ones(1), np.ones(1), np.zeros(1), np.full(1, np.sign(stance.lean)))[0]
        leant: Array = steady_n * (1 - abs(stance.lean)) + abs(stance.lean) * force[:, None] * edge
        return leant


def plan_walk(
    kinds: Sequence[str], seed: int = 0, cadence_per_min: float = 110.0, variation: float = 0.015
) -> Iterator[PlannedStance]:
    """Yield the stances of a person who does `kinds` in turn; step times vary by `variation` (1 σ, as a fraction).

    `walk N`: N steps; the first and the last of each foot are start and stop next to standing · `turn left N`, `turn
    right N`: N steps · `stumble` · `stand S`: on both feet for S seconds · `lift left S`, `lift right S`: this foot in
    the air for S seconds, the other one bears all weight.
    """
    draws = Draws(seed, Drawn.STRIDES, 1)
    stride_s = 120.0 / cadence_per_min
    raw: list[tuple[Foot, float, float, str, float, float]] = []
    now_s, paused = 1.0, True
    foot: Foot = "left"
    for position, kind in enumerate(kinds):
        words = kind.split()
        if words[0] in ("stand", "lift"):
            seconds = float(words[-1])
            if words[0] == "stand":
                raw.append(("left", now_s, now_s + seconds, "standing", 0.0, 0.5))
                raw.append(("right", now_s, now_s + seconds, "standing", 0.0, 0.5))
                now_s += seconds + 0.5
            else:
                lifted: Foot = "left" if words[1] == "left" else "right"
                supporting: Foot = "right" if lifted == "left" else "left"
                begin_s, end_s = now_s + 2.0, now_s + 2.0 + seconds
                raw += [
                    (lifted, now_s, begin_s, "standing", 0.0, 0.5), (lifted, end_s, end_s + 2.5, "standing", 0.0, 0.5),
                    (supporting, now_s, end_s + 2.5, "one_leg", 0.0, 0.75),
                ]  # fmt: skip
                now_s = end_s + 3.0
            paused = True
            continue
        n = len(STUMBLE) if words[0] == "stumble" else int(words[-1])
        following = kinds[position + 1].split()[0] if position + 1 < len(kinds) else "stand"
        for step in range(n):
            jitter = variation * float(draws.normal(1)[0])
            stance_s, step_s, label, lean = STANCE * stride_s, stride_s / 2, "steady", 0.0
            if words[0] == "turn":
                stance_s, step_s, label = stance_s * SLOWER_IN_TURN, step_s * SLOWER_IN_TURN, "turn"
                lean = LEAN_IN_TURN if foot == words[1] else -LEAN_IN_TURN  # inner foot lateral, outer foot medial
            elif words[0] == "stumble":
                label = "stumble"
                stance_s, step_s = stance_s * STUMBLE[step][0], step_s * STUMBLE[step][1]
            elif paused and step < 2:
                label = "start"
            elif following in ("stand", "lift") and step >= n - 2:
                label = "stop"
            raw.append((foot, now_s, now_s + stance_s * (1 + jitter), label, lean, 1.0))
            now_s += step_s * (1 + jitter)
            foot = "right" if foot == "left" else "left"
        paused = False
        if following in ("stand", "lift"):
            now_s += 1.0
    yield from (PlannedStance(*stance) for stance in sorted(raw, key=lambda stance: stance[1]))
