"""Walking, standing and swaying on the insole, as regions of pressure that come and go."""

import numpy as np

from .geometry import Geometry
from .laws import STEP_S
from .ranges import draw
from .trial import Trial, wandering

ACTIVITIES = ("walking", "mixed", "slow", "standing")
KEPT_S, LEAD_S = 20.0, 10.0
# x mm, y mm (medial is negative on a left foot), sigma mm, share, and when in stance it begins, peaks and ends.
_REGIONS = [
    (30, 4, 17, 1.00, 0.00, 0.16, 0.62),
    (55, 6, 18, 0.45, 0.02, 0.24, 0.70),
    (110, 16, 22, 0.16, 0.08, 0.42, 0.82),
    (178, -18, 13, 0.80, 0.20, 0.72, 0.96),
    (182, 2, 13, 0.95, 0.20, 0.74, 0.97),
    (174, 22, 13, 0.55, 0.16, 0.66, 0.94),
    (222, -14, 11, 0.85, 0.38, 0.85, 1.00),
    (214, 8, 11, 0.35, 0.34, 0.82, 0.99),
]
_STANDING = np.array([0.40, 0.30, 0.10, 0.26, 0.30, 0.20, 0.10, 0.06])
_HEEL = np.array([1.0, 1.0, 0.3, -0.6, -0.6, -0.6, -0.5, -0.5])  # what rises when one leans back
_MEDIAL = np.array([0.0, 0.0, -0.8, 0.8, 0.0, -0.8, 0.6, -0.3])


def _bump(u: np.ndarray, begin: float, peak: float, end: float) -> np.ndarray:
    up = np.clip((u - begin) / (peak - begin), 0, 1)
    down = np.clip((end - u) / (end - peak), 0, 1)
    return np.sin(np.pi / 2 * up) ** 2 * np.sin(np.pi / 2 * down) ** 2


class _Person:
    """One wearer: weight distribution, gait and sway."""

    def __init__(self, rng: np.random.Generator, slow: bool):
        self.rng = rng
        self.shares = np.array([r[3] for r in _REGIONS]) * rng.uniform(0.85, 1.15, len(_REGIONS))
        self.cycle_s = draw(rng, "walking", "slow_step_s" if slow else "step_s")
        self.stance = rng.uniform(0.58, 0.68)

    def steps(self, n: int) -> np.ndarray:
        """(n, regions), no two steps alike."""
        rng, out, at = self.rng, np.zeros((n, len(_REGIONS))), round(0.4 / STEP_S)
        turn = rng.uniform(-0.25, 0.25)
        while True:
            length = round(self.cycle_s * self.stance * rng.normal(1, 0.04) / STEP_S)
            if at + length >= n:
                return out
            u = np.arange(length) / length
            turn = 0.9 * turn + rng.normal(0, 0.05)
            strength = self.shares * (1 + turn * _MEDIAL) * rng.normal(1, 0.07, len(_REGIONS))
            shift = rng.normal(0, 0.01, len(_REGIONS))
            for r, (_, _, _, _, begin, peak, end) in enumerate(_REGIONS):
                out[at : at + length, r] = strength[r] * _bump(u, begin, peak + shift[r], end)
            at += round(self.cycle_s * rng.normal(1, 0.03) / STEP_S)

    def standing(self, n: int) -> np.ndarray:
        """(n, regions), leaning to and fro, with the weight now more and now less on this foot."""
        t = np.arange(n) * STEP_S
        out = np.ones((n, len(_REGIONS))) * _STANDING * self.shares
        for direction, size in ((_HEEL, 0.35), (_MEDIAL, 0.25), (np.ones(len(_REGIONS)), 0.35)):
            sway = sum(
                self.rng.normal() * np.sin(2 * np.pi * f * t + self.rng.uniform(0, 6))
                for f in self.rng.uniform(0.05, 0.7, 6)
            )
            out *= 1 + np.outer(size * np.tanh(0.5 * sway), direction)
        edge = np.clip(np.minimum(t, t[-1] - t) / 0.4, 0, 1)
        return out * (np.sin(np.pi / 2 * edge) ** 2)[:, None]


def _courses(person: _Person, activity: str, n: int) -> np.ndarray:
    if activity == "standing":
        return person.standing(n)
    stand = round(person.rng.uniform(2.0, 4.0) / STEP_S)
    blocks, walking = [person.standing(stand)], True
    while (missing := n - sum(len(b) for b in blocks)) > 0:
        length = missing
        if activity == "mixed":
            length = min(missing, round(person.rng.uniform(*((12, 22) if walking else (6, 14))) / STEP_S))
        if missing - length < 5 / STEP_S:
            length = missing
        blocks.append(person.steps(length) if walking else person.standing(length))
        walking = not walking or activity != "mixed"
    return np.concatenate(blocks)


def walk(rng: np.random.Generator, geometry: Geometry, activity: str) -> Trial:
    """A minute or more of one of the `ACTIVITIES`; the foot is in the air before it."""
    main = draw(rng, "walking", "length_s")
    n = round((main + KEPT_S) / STEP_S)
    courses = _courses(_Person(rng, activity == "slow"), activity, n)
    courses = np.concatenate([np.zeros((round(LEAD_S / STEP_S), len(_REGIONS))), courses])
    side = 1.0 if geometry.foot == "left" else -1.0
    regions = np.array([(x, side * y, sigma) for x, y, sigma, *_ in _REGIONS], float)
    seconds = np.arange(len(courses)) * STEP_S - LEAD_S
    temperature = wandering(rng, seconds, main, draw(rng, "walking", "temperature_swing_k"))
    made = Trial("walk", activity, courses, regions, temperature, LEAD_S, main, 1.0)
    force = made.wrench(geometry.taxel_mm)[:, 0]
    most = draw(rng, "walking", "weight_n") * (0.75 if activity == "standing" else 1.12)
    courses = courses * most / np.quantile(force[force > 0.02 * force.max()], 0.99)
    span = float((courses @ made.field(geometry.taxel_mm.reshape(-1, 2)).T).max())
    return Trial("walk", activity, courses, regions, temperature, LEAD_S, main, span)
