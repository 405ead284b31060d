"""A person who walks by a plan: stances one by one, with turns, a stumble, standing and a lifted foot.

What each kind of step does to force, timing and CoP is an assumption, stated beside it; that turning loads the side of
the foot towards the inside of the turn, Orendurff et al. 2006, Gait & Posture 23:106.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.draws import Drawn, Draws
from ..physics.portable import sin_turns, weighted
from ..skin.layout import Foot, Layout
from .foot import STANCE, Person, Places, Walk, standing

Array = NDArray[np.float64]
LEAN_IN_TURN = 0.22  # share of the force on the edge towards the inside of the turn
SLOWER_IN_TURN = 1.06  # stance and step times
STUMBLE = (
    (0.62, 0.72),
    (1.2, 1.1),
)  # stance and step, of the usual times: the step that fails, and the one that catches
LIFT_S = 0.15  # to put the weight on while standing, and off


@dataclass(frozen=True, slots=True)
class PlannedStance:
    """One stance and what kind of step it is; `lean` is the share of the force on the lateral edge, < 0 medial."""

    foot: Foot
    contact_s: float
    toe_off_s: float
    label: str
    lean: float = 0.0
    share: float = 1.0  # of the weight, of who stands


class PlannedWalk(Person):
    """See Person: the stances of a plan, each with the force of a walking step or of standing."""

    def __init__(
        self,
        layouts: Sequence[Layout],
        plan: Sequence[PlannedStance],
        body_mass_kg: float = 63.0,
        seed: int = 0,
        places: Places | None = None,
    ) -> None:
        """`plan`: stances that do not overlap on one foot, in order of contact."""
        super().__init__(layouts, body_mass_kg, places)
        self._walk = Walk(layouts, body_mass_kg, seed=seed)
        self.plan = tuple(plan)
        self._of = {foot: [stance for stance in self.plan if stance.foot == foot] for foot in ("left", "right")}
        self._contacts = {foot: np.array([stance.contact_s for stance in own]) for foot, own in self._of.items()}

    def region_n(self, foot: Foot, t_s: Array) -> Array:
        """(n_times, n_regions) the force that each region bears."""
        number = np.searchsorted(self._contacts[foot], t_s, side="right") - 1
        found = np.zeros((len(t_s), 10))
        for at in np.unique(number[number >= 0]).tolist():
            stance, rows = self._of[foot][at], number == at
            found[rows] = self._stance_n(foot, stance, at, t_s[rows])
        return found

    def _stance_n(self, foot: Foot, stance: PlannedStance, number: int, t_s: Array) -> Array:
        length_s = stance.toe_off_s - stance.contact_s
        if stance.label in ("standing", "one_leg"):
            ramp = np.clip(np.minimum(t_s - stance.contact_s, stance.toe_off_s - t_s) / LIFT_S, 0.0, 1.0)
            sway = 1.0 + 0.04 * sin_turns(0.31 * t_s)
            flat = np.zeros_like(t_s)
            return standing(self.weight_n * stance.share * ramp * sway, 1 + 0.06 * sin_turns(0.23 * t_s), flat, flat)
        # As if this were stance `number` of a steady walk of that foot: its variation, over the planned time.
        walked = (t_s - stance.contact_s) / length_s
        first = number + 1.0 - (0.5 if foot == "right" else 0.0)
        steady_s = (first + STANCE * np.clip(walked, 0.0, 1.0)) * self._walk.stride_s
        borne = self._walk.region_n(foot, steady_s) * ((walked >= 0) & (walked < 1))[:, None]
        force = weighted(borne, np.ones(10))
        edge = standing(np.ones(1), np.ones(1), np.zeros(1), np.full(1, np.sign(stance.lean)))[0]
        leant: Array = borne * (1 - abs(stance.lean)) + abs(stance.lean) * force[:, None] * edge
        return leant


def plan_walk(
    kinds: Sequence[str], seed: int = 0, cadence_per_min: float = 110.0, variation: float = 0.015
) -> Iterator[PlannedStance]:
    """The stances of a person who does `kinds` in turn; step times vary by `variation` (1 σ, of a step).

    `walk N`: N steps, of which the first and the last of each foot are start and stop where it follows or precedes
    standing · `turn left N`, `turn right N`: N steps · `stumble` · `stand S`: both feet for S seconds · `lift left S`,
    `lift right S`: this foot in the air for S seconds, the other one bears all.
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
                up: Foot = "left" if words[1] == "left" else "right"
                down: Foot = "right" if up == "left" else "left"
                begin_s, end_s = now_s + 2.0, now_s + 2.0 + seconds
                raw += [
                    (up, now_s, begin_s, "standing", 0.0, 0.5), (up, end_s, end_s + 2.5, "standing", 0.0, 0.5),
                    (down, now_s, end_s + 2.5, "one_leg", 0.0, 0.75),
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
    yield from (PlannedStance(*each) for each in sorted(raw, key=lambda each: each[1]))
